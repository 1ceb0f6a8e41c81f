// The frame's overlay, with the selected object highlighted.

/** Colours of the pixels outside the selected object and of its border: red, green, blue, opacity. */
const DIMMED = [0, 0, 0, 150];
const BORDER = [255, 255, 255, 255];

export class Picture {
  #run;
  #frameIds;
  #image = document.getElementById("picture");
  #marks = document.getElementById("marks");
  #box = document.getElementById("frame-picture");
  #frame = -1;
  #object = 0;
  #ids = null;

  /** `onPick` is called with the id that was clicked, 0 for none; `onIds` with the ids in a new frame, as a set. */
  constructor(run, frameIds, { onPick, onIds, onError }) {
    this.#run = run;
    this.#frameIds = frameIds;
    this.onIds = onIds;
    this.onError = onError;
    this.#marks.addEventListener("click", (event) => onPick(this.#idAt(event)));
    this.#marks.addEventListener("pointermove", (event) => {
      const id = this.#idAt(event);
      this.#marks.title = id ? `object ${id}` : "";
    });
    this.#image.addEventListener("error", () => onError(`${this.#file(this.#frame)} cannot be shown`));
  }

  /** Shows a frame. Resolves when its ids are loaded. */
  async show(frame) {
    const camera = this.#run.cameraOf(frame);
    this.#box.style.aspectRatio = `${camera.width} / ${camera.height}`;
    this.#box.style.maxWidth = `calc(var(--picture-height) * ${camera.width / camera.height})`;
    this.#frame = frame;
    this.#image.src = this.#file(frame);
    this.#image.alt = `frame ${this.#run.names[frame]} with its objects`;
    try {
      const ids = await this.#frameIds.of(frame);
      if (frame !== this.#frame) return;
      this.#ids = ids;
    } catch (error) {
      if (frame !== this.#frame) return;
      this.#ids = null;
      this.onError(error.message);
    }
    this.#draw();
    this.onIds(new Set(this.#ids?.ids));
  }

  /** Loads a frame's picture. Resolves when it is loaded or has failed to load. */
  async preload(frame) {
    const image = new Image();
    image.src = this.#file(frame);
    await Promise.allSettled([image.decode(), this.#frameIds.of(frame)]);
  }

  /** Highlights an object, or none. */
  mark(object) {
    this.#object = object;
    this.#draw();
  }

  #file(frame) {
    return `overlay/${encodeURIComponent(this.#run.names[frame])}.jpg`;
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
    if (!this.#ids || !this.#object || !this.#ids.ids.includes(this.#object)) return;
    const { width, height, ids } = this.#ids;
    [this.#marks.width, this.#marks.height] = [width, height];
    const pixels = context.createImageData(width, height);
    const is = (column, row) => ids[row * width + column] === this.#object;
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
