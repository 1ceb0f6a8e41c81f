// The slider, the play button, and the frames in which the selected object is seen.

/** Interval between frames, milliseconds. */
const INTERVAL_MS = 100;
const FRAMES_PER_JUMP = 10;

export class Timeline {
  #run;
  #actions;
  #slider = document.getElementById("slider");
  #button = document.getElementById("play");
  #presence = document.getElementById("presence");
  #object = null;
  #playing = false;
  frame = 0;

  /** `actions`: `{ show(frame), preload(frame), clear() }`. */
  constructor(run, actions) {
    this.#run = run;
    this.#actions = actions;
    this.#slider.max = String(Math.max(0, run.frameCount - 1));
    this.#slider.addEventListener("input", () => actions.show(Number(this.#slider.value)));
    this.#button.addEventListener("click", () => (this.#playing ? this.pause() : this.play()));
    document.addEventListener("keydown", (event) => this.#key(event));
    new ResizeObserver(() => this.#draw()).observe(this.#presence);
  }

  /** Sets the shown frame. */
  showFrame(frame) {
    this.frame = frame;
    const name = this.#run.names[frame];
    this.#slider.value = String(frame);
    this.#slider.setAttribute("aria-valuetext", name);
    const output = document.getElementById("frame");
    output.textContent = `${frame + 1} / ${this.#run.frameCount} · ${name}`;
    output.title = name;
  }

  /** Shows in which frames an object is seen; `null` for none. */
  mark(object) {
    this.#object = object;
    this.#draw();
  }

  /** Plays from this frame, or from the first if it is the last, until the end. */
  async play() {
    this.#setPlaying(true);
    if (this.frame + 1 >= this.#run.frameCount) this.#actions.show(0);
    while (this.#playing && this.frame + 1 < this.#run.frameCount) {
      const next = this.frame + 1;
      const pause = new Promise((resolve) => setTimeout(resolve, INTERVAL_MS));
      await Promise.all([pause, this.#actions.preload(next)]);
      // The user may have stopped playback or moved the slider in the meantime.
      if (this.#playing && this.frame + 1 === next) this.#actions.show(next);
    }
    this.#setPlaying(false);
  }

  pause() {
    this.#setPlaying(false);
  }

  #setPlaying(playing) {
    this.#playing = playing;
    this.#button.textContent = playing ? "\u275a\u275a" : "\u25b6";
    this.#button.setAttribute("aria-label", playing ? "Pause" : "Play");
  }

  #key(event) {
    if (event.altKey || event.ctrlKey || event.metaKey) return;
    if (event.key === "Escape") return this.#actions.clear();
    const isIn = (elements) => event.target.closest(elements) !== null;
    if (isIn("input[type=search], select")) return;
    if (event.key === " " && !isIn("button, input[type=checkbox]")) {
      event.preventDefault();
      return this.#playing ? this.pause() : this.play();
    }
    // The slider handles arrow keys itself.
    if (isIn("input[type=range]")) return;
    const step = event.shiftKey ? FRAMES_PER_JUMP : 1;
    const to = {
      ArrowLeft: this.frame - step, ArrowRight: this.frame + step, Home: 0, End: this.#run.frameCount - 1,
    }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    this.#actions.show(Math.max(0, Math.min(to, this.#run.frameCount - 1)));
  }

  #draw() {
    const width = Math.max(1, Math.round(this.#presence.clientWidth * devicePixelRatio));
    this.#presence.width = width;
    const context = this.#presence.getContext("2d");
    if (!this.#object) return;
    // The slider's thumb is 16 pixels wide: its centre does not reach the ends.
    const margin = 8 * devicePixelRatio;
    const perFrame = (width - 2 * margin) / Math.max(1, this.#run.frameCount - 1);
    context.fillStyle = `rgb(${this.#object.color.join(" ")})`;
    for (const [first, last] of this.#object.seen) {
      const length = Math.max((last - first + 1) * perFrame, devicePixelRatio);
      context.fillRect(margin + (first - 0.5) * perFrame, 0, length, this.#presence.height);
    }
  }
}
