// The line about the state of a run that goes on, and of the connection to it.

import { byElementId, counted } from "./element.js";

/** A frame older than this is mentioned, milliseconds. */
const OLD_MS = 2000;

export class LiveStatus {
  #line = byElementId("live");
  #state = "waiting";
  #frame = null;
  /** When the frame came. */
  #time = 0;
  #rate = 0;
  #objects = 0;

  constructor() {
    this.#line.hidden = false;
    setInterval(() => this.#show(), 500);
    this.#show();
  }

  /** Shows that the connection is lost. */
  lose() {
    this.#state = "lost";
    this.#show();
  }

  /** Shows that the session has ended. */
  end() {
    this.#state = "ended";
    this.#show();
  }

  /** Shows that there is a connection. */
  connect() {
    this.#state = this.#frame ? "live" : "waiting";
    this.#show();
  }

  /** Frames per second. */
  setRate(rate) {
    this.#rate = rate;
  }

  setObjects(count) {
    this.#objects = count;
    this.#show();
  }

  setFrame(frame) {
    [this.#frame, this.#time, this.#rate, this.#state] = [frame, performance.now(), frame.rate, "live"];
    this.#show();
  }

  #show() {
    document.documentElement.dataset.state = this.#state;
    const isLost = this.#state === "live" && this.#frame?.pose === null;
    this.#line.dataset.state = isLost ? "camera-lost" : this.#state;
    const texts = { waiting: "waiting for the first frame", lost: lostText(), live: this.#facts(), ended: this.#summary() };
    this.#line.textContent = texts[this.#state];
  }

  #summary() {
    const facts = ["the session has ended"];
    if (this.#frame) facts.push(`last frame ${this.#frame.number.toLocaleString("en")}`, counted(this.#objects, "object"));
    return facts.join(" · ");
  }

  #facts() {
    if (!this.#frame) return "";
    const { number, pose_state: poseState, delay, dropped } = this.#frame;
    const age = performance.now() - this.#time;
    const facts = [`frame ${number.toLocaleString("en")}`, `${this.#rate.toFixed(1)} frames/s`];
    if (delay !== null) facts.push(`${delay.toFixed(2)} s behind`);
    facts.push(`${dropped.toLocaleString("en")} dropped`, counted(this.#objects, "object"));
    facts.push({ given: "poses given", tracked: "camera tracked", lost: "camera lost" }[poseState]);
    if (age > OLD_MS) facts.push(`no new frame for ${Math.round(age / 1000)} s`);
    return facts.join(" · ");
  }
}

function lostText() {
  return "connection lost, trying again… If the program was started again, open its new link.";
}
