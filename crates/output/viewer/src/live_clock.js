// The time axis of a run that goes on: seconds since its first frame, which stand for frames here.

import { Clock } from "./clock.js";

export class LiveClock extends Clock {
  /** The latest time. */
  now = 0;

  constructor() {
    super(0, null);
    this.isReal = true;
  }

  /** Makes the axis reach a time. */
  reach(seconds) {
    this.now = Math.max(this.now, seconds);
  }

  get length() {
    return Math.max(this.now, 1);
  }

  secondsOf(seconds) {
    return seconds;
  }

  endOf(seconds) {
    return seconds;
  }

  frameAt(seconds) {
    return seconds;
  }
}
