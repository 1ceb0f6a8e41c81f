// When the frames of a run were taken.

/** Without timestamps, frames are shown at this rate. */
const FRAMES_PER_SECOND = 10;
/** A frame lasts at most this many times as long as the median frame. */
const LONGEST = 5;
/** Timestamps after this are dates: seconds since 1970. */
const DATES_FROM = 1e8;

export class Clock {
  /** `stamps` are the frames' timestamps, seconds; missing or null where a frame has none. */
  constructor(frameCount, stamps) {
    const all = stamps?.length === frameCount && stamps.every((stamp, frame) => stamp !== null && stamp >= (stamps[frame - 1] ?? stamp));
    this.frameCount = frameCount;
    /** True if the frames have timestamps in order. */
    this.isReal = Boolean(all) && stamps[frameCount - 1] > stamps[0];
    this.stamps = this.isReal ? stamps : null;
    const pauses = this.isReal ? stamps.slice(1).map((stamp, frame) => stamp - stamps[frame]).sort((one, other) => one - other) : [];
    this.#usual = pauses[pauses.length >> 1] || 1 / FRAMES_PER_SECOND;
  }

  /** Usual time between frames, seconds. */
  #usual;

  /** Seconds from the first frame to a frame. */
  secondsOf(frame) {
    return this.isReal ? this.stamps[frame] - this.stamps[0] : frame / FRAMES_PER_SECOND;
  }

  /** Seconds from the first frame to the end of a frame. */
  endOf(frame) {
    const start = this.secondsOf(frame);
    const next = frame + 1 < this.frameCount ? this.secondsOf(frame + 1) : Infinity;
    return Math.min(next, start + (next === Infinity ? 1 : LONGEST) * this.#usual);
  }

  /** Seconds that all frames last. */
  get length() {
    return this.frameCount ? this.endOf(this.frameCount - 1) : 1;
  }

  /** The last frame that starts at or before a time, seconds since the first. */
  frameAt(seconds) {
    let [low, high] = [0, Math.max(0, this.frameCount - 1)];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      // Sums of steps may be below the stamps that they lead to.
      if (this.secondsOf(middle) <= seconds + 1e-6) low = middle;
      else high = middle - 1;
    }
    return low;
  }

  /** A frame's time, as text; empty without timestamps. */
  textOf(frame) {
    if (!this.isReal) return "";
    const stamp = this.stamps[frame];
    const date = stamp > DATES_FROM ? new Date(1000 * stamp).toISOString().replace("T", " ").replace("Z", " UTC") : `stamp ${stamp.toFixed(3)} s`;
    return `${durationText(this.secondsOf(frame), 2)} · ${date}`;
  }

  /** Text of a place on the axis: a time, or a frame's number without timestamps. */
  tickText(seconds, step) {
    if (!this.isReal) return Math.round(seconds * FRAMES_PER_SECOND).toLocaleString("en");
    return durationText(seconds, Math.max(0, Math.ceil(-Math.log10(step) - 1e-9)));
  }

  /** Shortest distance of the axis's ticks, seconds. */
  get finest() {
    return this.isReal ? 1e-3 : 1 / FRAMES_PER_SECOND;
  }
}

/** A duration in seconds, or minutes and seconds. */
function durationText(exact, digits) {
  // Rounded first: 59.996 s is a minute.
  const seconds = Number(exact.toFixed(digits));
  if (seconds < 60) return `${seconds.toFixed(digits)} s`;
  const minutes = Math.floor(seconds / 60);
  const rest = (seconds - 60 * minutes).toFixed(digits);
  return `${minutes}:${rest.padStart(digits ? 3 + digits : 2, "0")}`;
}
