// The frame's picture under its overlay, with the selected object highlighted.

import { byElementId } from "./element.js";
import { drawOverlay } from "./overlay.js";

/** Colours of the pixels outside the selected object and of its border: red, green, blue, opacity. */
const DIMMED = [0, 0, 0, 150];
const BORDER = [255, 255, 255, 255];

export class Picture {
  #plain = byElementId("plain");
  #image = byElementId("picture");
  /** The overlay of a frame that comes without one. */
  #drawn = byElementId("drawn");
  #overlay = byElementId("overlay");
  #opacity = byElementId("opacity");
  #marks = byElementId("marks");
  #box = byElementId("frame-picture");
  #tag = byElementId("tag");
  #divider = byElementId("divider");
  #actions;
  #frame = null;
  /** The highlighted objects. */
  #objects = new Set();
  #ids = null;
  /** Where the pointer is, pixels in the window; null if it is not on the picture. */
  #pointer = null;

  /**
   * `actions`: `nameOf(id)` is the name of an object; `onPick(id)` is called with the id that was clicked, 0 for none;
   * `onIds(ids)` with the ids in a new frame, as a set; `onError(text)`.
   */
  constructor(actions) {
    this.#actions = actions;
    this.#marks.addEventListener("click", (event) => actions.onPick(this.#idAt(event)));
    this.#marks.addEventListener("pointermove", ({ clientX, clientY }) => {
      this.#pointer = { clientX, clientY };
      this.#showTag();
    });
    this.#marks.addEventListener("pointerleave", () => {
      this.#pointer = null;
      this.#showTag();
    });
    for (const control of [this.#overlay, this.#opacity]) control.addEventListener("input", () => this.#showOverlay());
    this.#plain.addEventListener("error", () => {
      this.#plain.hidden = true;
      this.#showOverlay();
    });
    this.#image.addEventListener("error", () => actions.onError(`${this.#frame?.url} cannot be shown`));
  }

  /** Opacity of the overlay, percent. */
  get opacity() {
    return this.#overlay.checked ? Number(this.#opacity.value) : 0;
  }

  set opacity(percent) {
    this.#overlay.checked = percent > 0;
    if (percent > 0) this.#opacity.value = String(percent);
    this.#showOverlay();
  }

  /** Shows the picture without its overlay, or with it again. */
  toggleOverlay() {
    this.#overlay.checked = !this.#overlay.checked;
    this.#showOverlay();
  }

  #showOverlay() {
    // Without the picture below, there would be nothing to see.
    for (const overlay of [this.#image, this.#drawn]) overlay.style.opacity = this.#plain.hidden ? "" : String(this.opacity / 100);
    this.#opacity.disabled = !this.#overlay.checked;
    this.#actions.onOpacity?.();
  }

  /**
   * Shows a frame: `{ camera, url, plain, text, ids(), colorOf(id), textOf(id), line }`, `url` and `plain` with and without
   * overlay. Without `url`, the overlay is drawn, in the colours of `colorOf` with the texts of `textOf`; `line` is where two
   * sides meet, a part of the width. Resolves when its ids, `{ width, height, ids }`, are loaded.
   */
  async show(frame) {
    const { camera } = frame;
    this.#box.style.aspectRatio = `${camera.width} / ${camera.height}`;
    this.#box.style.maxWidth = `calc(var(--picture-height) * ${camera.width / camera.height})`;
    this.#frame = frame;
    this.#image.hidden = !frame.url;
    this.#drawn.hidden = Boolean(frame.url);
    if (frame.url) this.#image.src = frame.url;
    this.#plain.hidden = false;
    this.#plain.src = frame.plain;
    this.#showOverlay();
    (frame.url ? this.#image : this.#plain).alt = frame.text;
    try {
      const ids = await frame.ids();
      if (frame !== this.#frame) return;
      this.#ids = ids;
    } catch (error) {
      if (frame !== this.#frame) return;
      this.#ids = null;
      this.#actions.onError(error.message);
    }
    if (!frame.url && this.#ids) drawOverlay(this.#drawn, this.#ids, frame.colorOf, frame.textOf);
    this.#divider.hidden = typeof frame.line !== "number";
    this.#divider.style.left = `${100 * (frame.line ?? 0)}%`;
    this.#draw();
    this.#showTag();
    this.#actions.onIds(new Set(this.#ids?.ids));
  }

  /** Loads a frame's picture. Resolves when it is loaded or has failed to load. */
  async preload(frame) {
    const files = [...(frame.url ? [frame.url] : []), ...(this.opacity < 100 || !frame.url ? [frame.plain] : [])];
    const images = files.map((src) => Object.assign(new Image(), { src }));
    await Promise.allSettled([...images.map((image) => image.decode()), frame.ids()]);
  }

  /** Highlights objects; none for an id of 0, which is that of pixels without an object. */
  mark(objects) {
    this.#objects = new Set(objects);
    this.#objects.delete(0);
    this.#draw();
  }

  /** Shows the name of the object under the pointer. */
  #showTag() {
    const id = this.#pointer ? this.#idAt(this.#pointer) : 0;
    this.#tag.hidden = id === 0;
    if (id === 0) return;
    const { left, top, width } = this.#box.getBoundingClientRect();
    const [x, y] = [this.#pointer.clientX - left, this.#pointer.clientY - top];
    this.#tag.textContent = this.#actions.nameOf(id);
    this.#tag.style.left = x > width / 2 ? "" : `${x + 12}px`;
    this.#tag.style.right = x > width / 2 ? `${width - x + 12}px` : "";
    this.#tag.style.top = `${Math.max(0, y - 28)}px`;
  }

  #idAt(event) {
    if (!this.#ids) return 0;
    const { width, height, ids } = this.#ids;
    const place = this.#marks.getBoundingClientRect();
    const column = Math.floor(((event.clientX - place.left) / place.width) * width);
    const row = Math.floor(((event.clientY - place.top) / place.height) * height);
    const inside = column >= 0 && row >= 0 && column < width && row < height;
    return inside ? ids[row * width + column] : 0;
  }

  #draw() {
    const context = this.#marks.getContext("2d");
    context.clearRect(0, 0, this.#marks.width, this.#marks.height);
    if (!this.#ids || this.#objects.size === 0 || !this.#ids.ids.some((id) => this.#objects.has(id))) return;
    const { width, height, ids } = this.#ids;
    [this.#marks.width, this.#marks.height] = [width, height];
    const pixels = context.createImageData(width, height);
    const marked = Uint8Array.from(ids, (id) => Number(this.#objects.has(id)));
    const is = (column, row) => marked[row * width + column];
    for (let row = 0; row < height; row++) {
      for (let column = 0; column < width; column++) {
        const place = 4 * (row * width + column);
        if (is(column, row)) continue;
        const beside =
          (column > 0 && is(column - 1, row)) || (column + 1 < width && is(column + 1, row)) ||
          (row > 0 && is(column, row - 1)) || (row + 1 < height && is(column, row + 1));
        pixels.data.set(beside ? BORDER : DIMMED, place);
      }
    }
    context.putImageData(pixels, 0, 0);
  }
}
