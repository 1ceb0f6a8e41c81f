// Choosing objects that are one thing, to merge them.

import { byElementId, element } from "./element.js";

export class Merging {
  /** The chosen objects; empty while none are being chosen. */
  #ids = new Set();
  #actions;
  #bar = byElementId("merging");

  /**
   * `actions`: `merge(ids)` with at least two objects, the oldest first; `changed(ids)` when the choice changes, empty when it
   * ends; `nameOf(id)`.
   */
  constructor(actions) {
    this.#actions = actions;
    byElementId("merge").addEventListener("click", () => this.finish());
    byElementId("merge-cancel").addEventListener("click", () => this.stop());
  }

  /** True while objects are being chosen. */
  get isOn() {
    return this.#ids.size > 0;
  }

  /** Begins with an object, or merges what was chosen. */
  turn(id) {
    if (this.isOn) return this.finish();
    if (id) this.toggle(id);
  }

  /** Adds an object, or leaves it out again. */
  toggle(id) {
    if (!this.#ids.delete(id)) this.#ids.add(id);
    this.#show();
  }

  /** Merges the chosen objects, if there are two. */
  finish() {
    if (this.#ids.size < 2) return;
    const ids = [...this.#ids].sort((one, other) => one - other);
    this.stop();
    this.#actions.merge(ids);
  }

  /** Chooses no longer. Returns false if nothing was chosen. */
  stop() {
    const wasOn = this.isOn;
    this.#ids.clear();
    this.#show();
    return wasOn;
  }

  #show() {
    const chosen = [...this.#ids];
    this.#bar.hidden = chosen.length === 0;
    byElementId("merge").disabled = chosen.length < 2;
    const names = chosen.map((id) => element("b", { textContent: this.#actions.nameOf(id) }));
    const said = chosen.length < 2 ? ": click what is the same object" : " are one object";
    byElementId("merging-ids").replaceChildren(...names.flatMap((name, at) => (at ? [" + ", name] : [name])), said);
    this.#actions.changed(new Set(chosen));
  }
}
