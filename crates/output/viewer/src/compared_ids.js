// The ids of ground truth or of another run, in the place of a run's own or beside them. `page/compared.rs` writes them.

import { byElementId, element } from "./element.js";
import { FrameIds } from "./frame_ids.js";

/** Added to ids of the other side that are no object of the run, so that they are none of its ids. */
const OTHERS = 2 ** 31;
/** Their colours, by id. */
const GREYS = [90, 120, 150, 180];
/** What is shown: own ids, those of the other side, or own ones left and the others right of a line. */
const CHOICES = ["own", "other", "both"];

export class ComparedIds {
  #frames;
  #own;
  #choice = byElementId("ids");
  #line = byElementId("line");
  #changed;

  /** `comparison` is the page's data about it, `changed()` is called when something else is to be shown. */
  constructor(comparison, run, changed) {
    this.#frames = new FrameIds(run.framesPerChunk, [], { file: "compared", callback: "splatsegCompared" });
    this.#own = new Map(comparison.pairs);
    this.#changed = changed;
    const texts = { own: "this run", other: comparison.name, both: `this run | ${comparison.name}` };
    this.#choice.replaceChildren(...CHOICES.map((value) => element("option", { value, textContent: texts[value] })));
    byElementId("figure").textContent = `${comparison.name}: ${comparison.figure}`;
    for (const part of document.querySelectorAll(".compared")) part.hidden = false;
    this.#choice.addEventListener("change", () => this.#show());
    this.#line.addEventListener("input", () => this.#changed());
    this.#line.hidden = true;
  }

  /** What is shown: one of `own`, `other` and `both`. */
  get shown() {
    return this.#choice.value;
  }

  set shown(value) {
    this.#choice.value = CHOICES.includes(value) ? value : "own";
    this.#show();
  }

  /** Shows the next choice. */
  turn() {
    this.shown = CHOICES[(CHOICES.indexOf(this.shown) + 1) % CHOICES.length];
  }

  #show() {
    this.#line.hidden = this.shown !== "both";
    this.#changed();
  }

  /** Where the line between both is, a part of the picture's width; null without one. */
  get line() {
    return this.shown === "both" ? Number(this.#line.value) / 100 : null;
  }

  /** The ids to show in a frame with these own ids; `into` has for merged objects what they are. */
  async of(frame, own, into) {
    if (this.shown === "own") return own;
    const other = await this.#frames.of(frame);
    // Frames without ground truth.
    if (!other) return { ...own, ids: new Uint32Array(own.ids.length) };
    const named = (id) => {
      const partner = this.#own.get(id);
      return id === 0 ? 0 : partner === undefined ? OTHERS + id : (into.get(partner) ?? partner);
    };
    const ids = other.ids.map(named);
    if (this.shown === "other" || own.ids.length !== ids.length) return { ...other, ids };
    const end = Math.round(this.line * own.width);
    return { ...own, ids: own.ids.map((id, pixel) => (pixel % own.width < end ? id : ids[pixel])) };
  }

  /** Name of an id that is no object of the run; null if it is one. */
  nameOf(id) {
    return id > OTHERS ? `${id - OTHERS}?` : null;
  }

  /** Colour of an id that is no object of the run; null if it is one. */
  colorOf(id) {
    return id > OTHERS ? Array(3).fill(GREYS[id % GREYS.length]) : null;
  }
}
