// Moving and zooming the plan: with the mouse, with fingers, and with keys.

/** Pointer movement, pixels, beyond which a click is a drag. */
const CLICK_PIXELS = 4;
/** Factor of one key press, and of a turn of the wheel by 100 pixels. */
const ZOOM = 1.2;
/** Movement of one key press, pixels. */
const STEP = 40;
/** Least and greatest scale, pixels per metre. */
const SCALES = [2, 2000];

export class PlanMotion {
  /** Pixels per metre. */
  scale = 50;
  /** Pixel of the grid's corner with the lowest x and y; pixels count downwards. */
  x = 0;
  y = 0;
  /** True once the user has moved the plan. */
  isTouched = false;
  #canvas;
  #moved;
  /** Pressed pointers: where they were last. */
  #pointers = new Map();
  /** True while nothing has moved since the first press. */
  #isClick = false;
  #start = null;

  /** `actions`: `moved()` after each change, `click(x, y)` with a pixel of the canvas. */
  constructor(canvas, { moved, click }) {
    this.#canvas = canvas;
    this.#moved = moved;
    canvas.addEventListener("pointerdown", (event) => this.#press(event));
    canvas.addEventListener("pointermove", (event) => this.#drag(event));
    canvas.addEventListener("pointercancel", ({ pointerId }) => this.#pointers.delete(pointerId));
    canvas.addEventListener("pointerup", (event) => {
      const wasPressed = this.#pointers.delete(event.pointerId);
      if (wasPressed && this.#isClick && event.button === 0) click(...this.#placeOf(event));
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.#zoom(ZOOM ** (-event.deltaY / 100), this.#placeOf(event));
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this.#key(event));
    // A click does not give the focus: arrow keys go on moving the frame.
    canvas.addEventListener("mousedown", (event) => {
      event.preventDefault();
      document.activeElement?.blur();
    });
  }

  /** Fits a plan of this size, metres, into a window, pixels. */
  fit([wide, high], [width, height], margin) {
    this.scale = Math.min((width - 2 * margin) / wide, (height - 2 * margin) / high);
    this.x = (width - wide * this.scale) / 2;
    this.y = (height + high * this.scale) / 2;
  }

  #placeOf({ clientX, clientY }) {
    const { left, top } = this.#canvas.getBoundingClientRect();
    return [clientX - left, clientY - top];
  }

  #press(event) {
    this.#canvas.setPointerCapture(event.pointerId);
    this.#pointers.set(event.pointerId, this.#placeOf(event));
    this.#isClick = this.#pointers.size === 1;
    this.#start = this.#placeOf(event);
  }

  #drag(event) {
    const before = this.#pointers.get(event.pointerId);
    if (!before) return;
    const now = this.#placeOf(event);
    if (this.#isClick && Math.hypot(now[0] - this.#start[0], now[1] - this.#start[1]) <= CLICK_PIXELS) return;
    this.#isClick = false;
    this.#pointers.set(event.pointerId, now);
    const other = [...this.#pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (!other) return this.#move(now[0] - before[0], now[1] - before[1]);
    const apart = (place) => Math.max(Math.hypot(place[0] - other[0], place[1] - other[1]), 1);
    this.#zoom(apart(now) / apart(before), other);
  }

  #key(event) {
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    const acts = {
      ArrowLeft: () => this.#move(STEP, 0),
      ArrowRight: () => this.#move(-STEP, 0),
      ArrowUp: () => this.#move(0, STEP),
      ArrowDown: () => this.#move(0, -STEP),
      "+": () => this.#zoom(ZOOM, [width / 2, height / 2]),
      "-": () => this.#zoom(1 / ZOOM, [width / 2, height / 2]),
    };
    if (!acts[event.key] || event.altKey || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    // Elsewhere, arrows move the frame.
    event.stopPropagation();
    acts[event.key]();
  }

  #move(right, down) {
    this.isTouched = true;
    this.x += right;
    this.y += down;
    this.#moved();
  }

  /** Enlarges the plan; this pixel stays where it is. */
  #zoom(factor, [x, y]) {
    const scale = Math.min(Math.max(this.scale * factor, SCALES[0]), SCALES[1]);
    const part = scale / this.scale;
    this.scale = scale;
    this.#move((x - this.x) * (1 - part), (y - this.y) * (1 - part));
  }
}
