// The label of the selected object, given by hand.

import { element } from "./element.js";
import { LABEL_LENGTH } from "./edits.js";

export class LabelForm {
  #label = element("input", { maxLength: LABEL_LENGTH, placeholder: "a label, or none" });
  #name = element("span");
  #note = element("span", { className: "note", role: "status" });
  #form;
  #save = null;
  #id = 0;

  /** The form is hidden until `savedBy` is called. */
  constructor() {
    const label = element("label", {}, [this.#name, " is ", this.#label]);
    this.#form = element("form", { className: "bar", hidden: true }, [label, element("button", { textContent: "Save" }), this.#note]);
    this.#form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.#save?.(this.#id, this.#label.value);
    });
    document.getElementById("objects").append(this.#form);
  }

  /** `save(id, label)` is called with a label, empty for none; null if labels cannot be given. */
  savedBy(save) {
    this.#save = save;
    this.#form.hidden = !save || !this.#id;
  }

  /** Says how saving went. */
  say(text) {
    this.#note.textContent = text;
  }

  /** Lets the label be typed. */
  focus() {
    if (!this.#form.hidden) this.#label.select();
  }

  /** Selects an object, 0 for none. */
  select(id, object) {
    if (id !== this.#id) {
      this.#label.value = object?.label ?? "";
      this.#note.textContent = "";
    }
    this.#id = id;
    this.#name.textContent = `#${id}`;
    this.#form.hidden = !this.#save || !id;
  }
}
