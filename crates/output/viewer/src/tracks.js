// The timeline's rows: when each object is seen, and the shown frame.

import { counted, counts, element, nameOf, showRows, swatch } from "./element.js";
import { roundLength } from "./scale_bar.js";

/** Height of a row, pixels, as in the style. */
const ROW = 18;
/** Space at both ends of a row, pixels. */
const MARGIN = 8;
/** Least distance of ticks, pixels. */
const TICK_PIXELS = 80;

export class Tracks {
  #clock;
  #actions;
  #names = document.getElementById("tracks");
  #rows = document.getElementById("rows");
  #spans = document.getElementById("spans");
  #ticks = document.getElementById("ticks");
  #objects;
  #shown;
  #isWanted = () => true;
  #buttons = new Map();
  #selected = 0;
  #frame = 0;
  #isWaiting = false;

  /** `actions`: `{ seek(frame), pick(id) }`. Objects are in the order in which they are first seen. */
  constructor(run, clock, actions) {
    this.#clock = clock;
    this.#actions = actions;
    document.getElementById("unit").textContent = clock.isReal ? "time" : "frame";
    this.update(run.objects);
    this.#names.addEventListener("keydown", (event) => this.#move(event));
    this.#rows.addEventListener("scroll", () => this.#draw());
    for (const canvas of [this.#spans, this.#ticks]) this.#listen(canvas);
    for (const box of [this.#rows, this.#ticks]) new ResizeObserver(() => this.#draw()).observe(box);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#draw());
  }

  #button(id) {
    const button = element("button", { type: "button" });
    button.dataset.object = id;
    button.setAttribute("aria-pressed", String(id === this.#selected));
    button.addEventListener("click", () => this.#actions.pick(id));
    return button;
  }

  /** Shows these objects in the place of those before. */
  update(objects) {
    const first = ({ seen }) => seen[0]?.[0] ?? Infinity;
    const shown = objects.filter((object) => counts(object) && object.seen.length > 0);
    this.#objects = shown.sort((one, other) => first(one) - first(other) || one.id - other.id);
    const known = this.#buttons;
    this.#buttons = new Map(this.#objects.map((object) => [object.id, known.get(object.id) ?? this.#button(object.id)]));
    for (const object of this.#objects) describe(this.#buttons.get(object.id), object);
    this.#showRows();
  }

  /** Shows the rows of the objects for which `isWanted(id)` is true. */
  show(isWanted) {
    this.#isWanted = isWanted;
    this.#showRows();
  }

  #showRows() {
    this.#shown = this.#objects.filter(({ id }) => this.#isWanted(id));
    const buttons = this.#shown.map(({ id }) => this.#buttons.get(id));
    // A button's row goes with it.
    showRows(this.#names, buttons.map((button) => button.parentElement ?? element("li", {}, [button])));
    this.#draw();
  }

  /** Highlights an object, or none, and scrolls to it. */
  mark(id) {
    this.#buttons.get(this.#selected)?.setAttribute("aria-pressed", "false");
    const isNew = this.#selected !== id;
    this.#selected = id;
    this.#buttons.get(id)?.setAttribute("aria-pressed", "true");
    const row = this.#shown.findIndex((object) => object.id === id);
    // The names' own `scrollIntoView` would move the page, too.
    if (row >= 0 && isNew) this.#scrollTo(row * ROW);
    this.#draw();
  }

  #scrollTo(top) {
    const { scrollTop, clientHeight } = this.#rows;
    if (top < scrollTop) this.#rows.scrollTop = top;
    if (top + ROW > scrollTop + clientHeight) this.#rows.scrollTop = top + ROW - clientHeight;
  }

  /** Shows which frame is shown. */
  showFrame(frame) {
    this.#frame = frame;
    this.#draw();
  }

  #listen(canvas) {
    const seek = (event) => {
      const { left, width } = canvas.getBoundingClientRect();
      const part = (event.clientX - left - MARGIN) / (width - 2 * MARGIN);
      this.#actions.seek(this.#clock.frameAt(Math.max(0, part) * this.#clock.length));
    };
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      if (event.pointerType !== "touch") canvas.setPointerCapture(event.pointerId);
      seek(event);
    });
    canvas.addEventListener("pointermove", (event) => (event.buttons & 1 ? seek(event) : undefined));
  }

  /** The up and down keys move from name to name. */
  #move(event) {
    const step = { ArrowDown: "nextElementSibling", ArrowUp: "previousElementSibling" }[event.key];
    const to = step && event.target.closest("li")?.[step];
    if (!to) return;
    event.preventDefault();
    to.firstChild.focus();
  }

  #draw() {
    if (this.#isWaiting) return;
    this.#isWaiting = true;
    requestAnimationFrame(() => {
      this.#isWaiting = false;
      this.#drawTicks();
      this.#drawSpans();
    });
  }

  #drawTicks() {
    const { context, width, height, xOf, color } = this.#prepared(this.#ticks, this.#ticks.clientHeight);
    const perSecond = (width - 2 * MARGIN) / this.#clock.length;
    const step = Math.max(roundLength((2.5 * TICK_PIXELS) / perSecond), this.#clock.finest);
    context.fillStyle = color("--muted");
    context.font = "11px system-ui, sans-serif";
    for (let tick = 0; tick * step < this.#clock.length; tick++) {
      const x = xOf(tick * step);
      context.fillRect(x, height - 5, 1, 5);
      const text = this.#clock.tickText(tick * step, step);
      if (x + 4 + context.measureText(text).width < width) context.fillText(text, x + 3, height - 8);
    }
    this.#drawFrame(context, height, xOf, color);
  }

  #drawSpans() {
    const { context, width, height, xOf, color } = this.#prepared(this.#spans, this.#rows.clientHeight);
    const top = this.#rows.scrollTop;
    const last = Math.min(this.#shown.length, Math.ceil((top + height) / ROW));
    for (let row = Math.floor(top / ROW); row < last; row++) {
      const object = this.#shown[row];
      const y = row * ROW - top;
      if (object.id === this.#selected) {
        context.fillStyle = color("--raised");
        context.fillRect(0, y, width, ROW);
      }
      context.globalAlpha = this.#selected && object.id !== this.#selected ? 0.45 : 1;
      context.fillStyle = `rgb(${object.color.join(" ")})`;
      for (const [from, to] of object.seen) {
        const x = xOf(this.#clock.secondsOf(from));
        context.fillRect(x, y + 4, Math.max(xOf(this.#clock.endOf(to)) - x, 1), ROW - 8);
      }
      context.globalAlpha = 1;
    }
    this.#drawFrame(context, height, xOf, color);
  }

  /** A line at the shown frame. */
  #drawFrame(context, height, xOf, color) {
    context.fillStyle = color("--ink");
    context.fillRect(xOf(this.#clock.secondsOf(this.#frame)) - 1, 0, 2, height);
  }

  /** A cleared canvas, in CSS pixels. */
  #prepared(canvas, height) {
    const width = canvas.clientWidth;
    canvas.style.height = `${height}px`;
    canvas.width = Math.max(1, Math.round(width * devicePixelRatio));
    canvas.height = Math.max(1, Math.round(height * devicePixelRatio));
    const context = canvas.getContext("2d");
    context.scale(devicePixelRatio, devicePixelRatio);
    const xOf = (seconds) => MARGIN + (seconds / this.#clock.length) * (width - 2 * MARGIN);
    const style = getComputedStyle(document.documentElement);
    return { context, width, height, xOf, color: (name) => style.getPropertyValue(name).trim() };
  }
}

/** Writes an object's name into its row. */
function describe(button, object) {
  const name = nameOf(object.id, object);
  button.title = `${name}: ${counted(object.frames, "frame")}`;
  if (button.textContent !== name) button.replaceChildren(swatch(object), name);
}
