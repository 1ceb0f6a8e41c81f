// Objects found by words, by the program that shows the run.

/** Pause after the last key before a text is sent, milliseconds. */
const TYPING_MS = 300;

export class Words {
  #filter = document.getElementById("filter");
  #ask = null;
  #onFound;

  /** `onFound` is called with the ids of the objects that the program has found. */
  constructor(onFound) {
    this.#onFound = onFound;
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
    this.#filter.placeholder = ask ? "Find an id, a label or words" : "Find an id or a label";
  }

  #find() {
    const text = this.#filter.value.trim();
    if (this.#ask && text && !/^#?\d+$/.test(text)) this.#ask({ ask: "find", text });
  }

  /** Shows the answer to a text, if that is still the one. */
  showFound({ text, objects }) {
    if (text === this.#filter.value.trim()) this.#onFound(objects.map(({ id }) => id));
  }
}
