// The map from above: rooms with their names, walls, footprints of objects, the camera's path. It takes the place of the
// 3D view while it is on.

import { bytesOf } from "./bytes.js";
import { byElementId, counts } from "./element.js";
import { decode } from "./frame_ids.js";
import { cellsPicture, styleOf } from "./plan_cells.js";
import { Texts, drawCamera, drawFootprint, isInside } from "./plan_drawing.js";
import { PlanMotion } from "./plan_motion.js";
import { turned } from "./rotation.js";
import { showBar } from "./scale_bar.js";

/** Empty margin around the plan, pixels. */
const MARGIN = 12;

export class PlanView {
  isOn = false;
  #run;
  #plan;
  #canvas = byElementId("plan");
  #stage = byElementId("stage");
  #button = byElementId("plan-button");
  #cells;
  #picture;
  #style;
  #selected = 0;
  #frame = 0;
  #isShown = () => true;
  #motion;
  #isWaiting = false;
  #turned;

  /** `actions`: `pick(id)` after a click on an object, 0 for none; `turned(on)` when it was turned on or off. */
  constructor(run, actions) {
    this.#run = run;
    this.#turned = actions.turned;
    this.#read();
    this.#motion = new PlanMotion(this.#canvas, {
      moved: () => this.#draw(),
      click: (x, y) => actions.pick(this.#objectAt(x, y)),
    });
    this.#button.hidden = false;
    this.#button.addEventListener("click", () => this.turn(!this.isOn));
    byElementId("reset").addEventListener("click", () => this.isOn && this.reset());
    byElementId("path").addEventListener("change", () => this.#draw());
    new ResizeObserver(() => this.#resize()).observe(this.#stage);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#paint());
    this.#paint();
  }

  /** Reads the run's plan, with merged objects as the one that they are. */
  #read() {
    const { width, height, cells, objects } = this.#run.plan;
    this.#plan = { ...this.#run.plan, objects: objects.map((object) => ({ ...object, id: this.#run.into.get(object.id) ?? object.id })) };
    this.#cells = decode(bytesOf(cells), width, height);
  }

  /** The run has a newer plan, or none any more. What the user looks at stays where it is. */
  update() {
    this.#button.hidden = !this.#run.plan;
    if (!this.#run.plan) return this.isOn && this.turn(false);
    const before = this.#plan.origin;
    this.#read();
    const { scale } = this.#motion;
    this.#motion.x += (this.#plan.origin[0] - before[0]) * scale;
    this.#motion.y -= (this.#plan.origin[1] - before[1]) * scale;
    this.#paint();
    this.#resize();
  }

  /** Shows the plan, or the map in 3D; without a plan, the map. */
  turn(wanted) {
    const on = wanted && Boolean(this.#run.plan);
    this.isOn = on;
    this.#stage.parentElement.classList.toggle("planned", on);
    this.#canvas.hidden = !on;
    this.#button.setAttribute("aria-pressed", String(on));
    this.#turned(on);
    this.#resize();
  }

  /** Shows the whole plan. */
  reset() {
    this.#motion.isTouched = false;
    this.#resize();
  }

  mark(id) {
    this.#selected = id;
    this.#draw();
  }

  /** Draws objects that were merged as the one that they are. */
  mergeObjects() {
    if (this.#run.plan) this.#read();
    this.#draw();
  }

  showFrame(frame) {
    this.#frame = frame;
    this.#draw();
  }

  /** Draws the objects for which `isShown(id)` is true. */
  showObjects(isShown) {
    this.#isShown = isShown;
    this.#draw();
  }

  /** Pixel in the page's window of a place of the plan, metres from the grid's corner; for tests. */
  pixelOf(x, y) {
    const { left, top } = this.#canvas.getBoundingClientRect();
    const { scale, x: startX, y: startY } = this.#motion;
    return [left + startX + x * scale, top + startY - y * scale];
  }

  /** The smallest drawn object at a pixel of the canvas; 0 for none. */
  #objectAt(pixelX, pixelY) {
    const { scale, x, y } = this.#motion;
    const place = [(100 * (pixelX - x)) / scale, (100 * (y - pixelY)) / scale];
    // Large ones come first.
    const found = this.#plan.objects.findLast(({ id, outlines }) => this.#isDrawn(id) && isInside(outlines, place));
    return found?.id ?? 0;
  }

  /** Tentative and forgotten objects are not drawn: they may be mistakes. */
  #isDrawn(id) {
    const object = this.#run.byId.get(id);
    return Boolean(object) && counts(object) && this.#isShown(id);
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.#stage;
    if (!this.isOn || !width || !height) return;
    const ratio = Math.min(devicePixelRatio, 2);
    Object.assign(this.#canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    const { resolution } = this.#plan;
    const size = [this.#plan.width * resolution, this.#plan.height * resolution];
    if (!this.#motion.isTouched) this.#motion.fit(size, [width, height], MARGIN);
    this.drawNow();
  }

  #paint() {
    this.#style = styleOf(document.documentElement);
    this.#picture = cellsPicture(this.#plan, this.#cells, this.#style);
    this.#draw();
  }

  #draw() {
    if (this.#isWaiting || !this.isOn) return;
    this.#isWaiting = true;
    requestAnimationFrame(() => {
      this.#isWaiting = false;
      this.drawNow();
    });
  }

  /** Draws immediately. */
  drawNow() {
    if (!this.isOn) return;
    const { width, height, resolution, objects, rooms, origin } = this.#plan;
    const { scale, x, y } = this.#motion;
    const context = this.#canvas.getContext("2d");
    const ratio = this.#canvas.width / this.#stage.clientWidth;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, this.#canvas.width, this.#canvas.height);
    context.imageSmoothingEnabled = false;
    const [wide, high] = [width * resolution * scale, height * resolution * scale];
    context.drawImage(this.#picture, x, y - high, wide, high);
    const view = { context, scale, x, y, style: this.#style };
    const drawn = objects.filter(({ id }) => this.#isDrawn(id));
    for (const { id, outlines } of drawn) {
      drawFootprint(view, outlines, this.#run.byId.get(id), { isMarked: id === this.#selected, isAny: this.#selected !== 0 });
    }
    if (byElementId("path").checked) drawCamera(view, this.#cameraPath(), this.#run.frameCount ? this.#camera() : null);
    const texts = new Texts(view);
    const marked = drawn.filter(({ id }) => id === this.#selected);
    for (const { id, outlines } of marked) texts.addObject(outlines, this.#run.byId.get(id));
    texts.addRooms(rooms, origin);
    for (const { id, outlines } of drawn) texts.addObject(outlines, this.#run.byId.get(id));
    showBar(scale);
  }

  /** Places of the camera in all frames, metres from the grid's corner. */
  #cameraPath() {
    return this.#run.places().map((place) => this.#onPlan(place));
  }

  /** Where the camera is and where it looks at this frame; null if it is lost. */
  #camera() {
    const pose = this.#run.poseOf(this.#frame);
    if (!pose) return null;
    const { position, quaternion } = pose;
    const ahead = turned(quaternion, [0, 0, 1]);
    const from = this.#onPlan(position);
    const to = this.#onPlan(Array.from(position, (value, axis) => value + ahead[axis]));
    return { at: from, direction: [to[0] - from[0], to[1] - from[1]] };
  }

  /** A place relative to the run's origin, on the plan. */
  #onPlan(place) {
    const { rotation, run_origin: start, origin } = this.#plan;
    const [x, y] = turned(rotation, place);
    return [x + start[0] - origin[0], y + start[1] - origin[1]];
  }
}
