// Playback: the play button, its speed, the slider, and keys that move the frame.

const FRAMES_PER_JUMP = 10;
/** Pause between two looks at the clock, milliseconds. */
const PAUSE_MS = 10;
/** Keys that are typed into these, or move their choice. */
const TAKES_KEYS = "input:not([type=checkbox], [type=range]), select, dialog";

export class Timeline {
  #run;
  #clock;
  #actions;
  #slider = document.getElementById("slider");
  #button = document.getElementById("play");
  #speed = document.getElementById("speed");
  #playing = false;
  frame = 0;

  /** `actions`: `{ show(frame), preload(frame) }`. */
  constructor(run, clock, actions) {
    this.#run = run;
    this.#clock = clock;
    this.#actions = actions;
    this.#slider.max = String(Math.max(0, run.frameCount - 1));
    this.#slider.addEventListener("input", () => actions.show(Number(this.#slider.value)));
    this.#button.addEventListener("click", () => (this.#playing ? this.pause() : this.play()));
    document.addEventListener("keydown", (event) => this.#key(event));
  }

  /** Sets the shown frame. */
  showFrame(frame) {
    this.frame = frame;
    const name = this.#run.names[frame];
    const time = this.#clock.textOf(frame);
    this.#slider.value = String(frame);
    this.#slider.setAttribute("aria-valuetext", time ? `${name}, ${time}` : name);
    const output = document.getElementById("frame");
    output.textContent = [`${frame + 1} / ${this.#run.frameCount}`, name, ...(time ? [time] : [])].join(" · ");
    output.title = output.textContent;
  }

  /**
   * Plays from this frame, or from the first if it is the last, until the end. Frames that cannot be loaded and drawn in
   * time are left out.
   */
  async play() {
    this.#setPlaying(true);
    if (this.frame + 1 >= this.#run.frameCount) this.#actions.show(0);
    let [shown, start, from, speed] = [this.frame, performance.now(), this.#clock.secondsOf(this.frame), this.#speed.value];
    while (this.#playing && this.frame + 1 < this.#run.frameCount) {
      await new Promise((resolve) => setTimeout(resolve, PAUSE_MS));
      // The user may have moved the slider or changed the speed in the meantime.
      if (this.frame !== shown || this.#speed.value !== speed) {
        [shown, start, from, speed] = [this.frame, performance.now(), this.#clock.secondsOf(this.frame), this.#speed.value];
      }
      const next = this.#clock.frameAt(from + ((performance.now() - start) / 1000) * Number(speed));
      if (next === shown) continue;
      await this.#actions.preload(next);
      if (!this.#playing || this.frame !== shown) continue;
      shown = next;
      this.#actions.show(next);
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
    const isIn = (elements) => event.target.closest?.(elements);
    if (isIn(TAKES_KEYS)) return;
    if (event.key === " " && !isIn("button, summary, input[type=checkbox]")) {
      event.preventDefault();
      return this.#playing ? this.pause() : this.play();
    }
    // Sliders handle arrow keys themselves.
    if (isIn("input[type=range]")) return;
    const step = event.shiftKey ? FRAMES_PER_JUMP : 1;
    const to = {
      ArrowLeft: this.frame - step, ArrowRight: this.frame + step, Home: 0, End: this.#run.frameCount - 1,
    }[event.key];
    if (to === undefined) return;
    event.preventDefault();
    this.#actions.show(Math.max(0, Math.min(to, this.#run.frameCount - 1)));
  }
}
