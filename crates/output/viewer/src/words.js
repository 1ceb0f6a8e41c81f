// Objects found by words, and given labels by hand, by the program that shows the run.

import { element } from "./element.js";

/** Pause after the last key before a text is sent, milliseconds. */
const TYPING_MS = 300;

export class Words {
  #filter = document.getElementById("filter");
  #label = element("input", { maxLength: 80, placeholder: "a label, or none" });
  #name = element("span");
  #note = element("span", { className: "note", role: "status" });
  #form;
  #ask = null;
  #onFound;
  #id = 0;

  /** `onFound` is called with the ids of the objects that the program has found. */
  constructor(onFound) {
    this.#onFound = onFound;
    const label = element("label", {}, [this.#name, " is ", this.#label]);
    this.#form = element("form", { className: "bar", hidden: true }, [label, element("button", { textContent: "Save" }), this.#note]);
    this.#form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.#ask?.({ ask: "name", id: this.#id, label: this.#label.value });
    });
    document.getElementById("objects").append(this.#form);
    let typing = 0;
    this.#filter.addEventListener("input", () => {
      clearTimeout(typing);
      this.#onFound([]);
      typing = setTimeout(() => this.#find(), TYPING_MS);
    });
  }

  /** `ask` sends a request; null if the program answers none. */
  answeredBy(ask) {
    this.#ask = ask;
    if (ask) this.#filter.placeholder = "Find an id, a label or words";
    this.#form.hidden = !ask || !this.#id;
  }

  #find() {
    const text = this.#filter.value.trim();
    if (this.#ask && text && !/^#?\d+$/.test(text)) this.#ask({ ask: "find", text });
  }

  /** Shows the answer to a text, if that is still the one. */
  showFound({ text, objects }) {
    if (text === this.#filter.value.trim()) this.#onFound(objects.map(({ id }) => id));
  }

  showNamed({ error }) {
    this.#note.textContent = error ?? "saved";
  }

  /** Selects an object, 0 for none. */
  select(id, object) {
    if (id !== this.#id) {
      this.#label.value = object?.label ?? "";
      this.#note.textContent = "";
    }
    this.#id = id;
    this.#name.textContent = `#${id}`;
    this.#form.hidden = !this.#ask || !id;
  }
}
