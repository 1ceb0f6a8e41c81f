// How finely frames are segmented from now on, as a viewer chooses.

import { byElementId } from "./element.js";

export class LiveDetail {
  #label = byElementId("detail");
  #choice = this.#label.querySelector("select");
  #ask = null;
  /** The choice is sent, and not answered yet. */
  #isAsked = false;

  constructor() {
    this.#choice.addEventListener("change", () => {
      this.#isAsked = this.#ask?.({ ask: "detail", detail: this.#choice.value }) ?? false;
    });
  }

  /** `ask` sends a request; null if the program answers none. */
  answeredBy(ask) {
    this.#ask = ask;
    this.#isAsked = false;
    this.#label.hidden ||= !ask;
  }

  /** The program has done what was asked, or has not. */
  answered() {
    this.#isAsked = false;
  }

  /** Shows the detail of the newest frame; null if it cannot be chosen. */
  show(detail) {
    this.#label.hidden = !this.#ask || detail === null;
    document.documentElement.dataset.detail = detail ?? "";
    if (!this.#isAsked && detail !== null) this.#choice.value = detail;
  }
}
