// Distances between two places that the user clicks in the map.

import { Vector3 } from "three";
import { byElementId } from "./element.js";
import { lines, setLines } from "./map_lines.js";

/** Half the size of the cross at a place, metres. */
const CROSS_M = 0.02;

export class Measure {
  #points = [];
  #label = byElementId("length");
  #button = byElementId("measure");
  #changed;

  /** Adds its lines to a scene; `changed` is called when they change. */
  constructor(scene, changed) {
    this.#changed = changed;
    this.lines = lines([], 0xffffff);
    scene.add(this.lines);
    this.isOn = false;
    this.#show();
  }

  /** Starts or stops measuring. */
  turn(on) {
    this.isOn = on;
    this.#points = [];
    this.#button.setAttribute("aria-pressed", String(on));
    this.#show();
  }

  /** Takes a place `[x, y, z]`; the third one starts again. */
  add(point) {
    if (this.#points.length === 2) this.#points = [];
    this.#points.push(point);
    this.#show();
  }

  /** Length of the line, metres; null before there are two places. */
  get length() {
    if (this.#points.length < 2) return null;
    return Math.hypot(...this.#points[0].map((value, axis) => value - this.#points[1][axis]));
  }

  #show() {
    const crosses = this.#points.flatMap((point) => [0, 1, 2].flatMap((axis) => [-CROSS_M, CROSS_M].flatMap((side) => {
      const end = [...point];
      end[axis] += side;
      return end;
    })));
    setLines(this.lines, [...crosses, ...(this.#points.length === 2 ? this.#points.flat() : [])]);
    this.#label.hidden = !this.isOn;
    const texts = ["Click a place in the map.", "Click the other place."];
    this.#label.textContent = this.length === null ? texts[this.#points.length] : `${this.length.toFixed(3)} m`;
    this.#changed();
  }

  /** Puts the length beside its line. */
  place(camera, width, height) {
    if (this.length === null) {
      this.#label.style.transform = "";
      return;
    }
    const middle = this.#points[0].map((value, axis) => (value + this.#points[1][axis]) / 2);
    const { x, y } = new Vector3(...middle).project(camera);
    const within = (place, size) => Math.min(Math.max(place, 8), size - 90).toFixed(0);
    this.#label.style.transform = `translate(${within(((x + 1) / 2) * width + 8, width)}px, ${within(((1 - y) / 2) * height, height + 50)}px)`;
  }
}
