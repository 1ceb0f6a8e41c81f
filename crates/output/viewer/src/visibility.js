// Which objects are drawn in the map: all but hidden ones, or the selected one alone.

import { byElementId } from "./element.js";

export class Visibility {
  /** Ids of hidden objects. */
  hidden = new Set();
  /** True if only the selected object is drawn. */
  isolated = false;
  #selected = 0;
  #changed;
  #button = byElementId("show-all");

  /** `changed(isShown)` is called with a function that tells for an id whether the object is drawn. */
  constructor(changed) {
    this.#changed = changed;
    this.#button.addEventListener("click", () => this.showAll());
  }

  /** Sets the selected object, 0 for none. */
  select(id) {
    const wasIsolated = this.isolated;
    this.isolated &&= id !== 0;
    const moved = this.#selected !== id;
    this.#selected = id;
    if (wasIsolated && moved) this.#tell();
  }

  /** Draws the selected object alone, or all again. */
  toggleIsolated() {
    if (!this.#selected) return;
    this.isolated = !this.isolated;
    this.#tell();
  }

  /** Hides the selected object, or shows it again. */
  toggleHidden() {
    if (!this.#selected) return;
    if (!this.hidden.delete(this.#selected)) this.hidden.add(this.#selected);
    this.#tell();
  }

  /** Hides these objects only. */
  hide(ids) {
    if (ids.length === 0 && this.hidden.size === 0) return;
    this.hidden = new Set(ids);
    this.#tell();
  }

  showAll() {
    this.hidden.clear();
    this.isolated = false;
    this.#tell();
  }

  #tell() {
    this.#button.hidden = this.hidden.size === 0 && !this.isolated;
    this.#button.textContent = this.isolated ? "Show all" : `Show ${this.hidden.size} hidden`;
    this.#changed((id) => (this.isolated ? id === this.#selected : !this.hidden.has(id)));
  }
}
