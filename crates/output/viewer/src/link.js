// The part of the page's address after `#`: frame, object, and how the map and the picture are shown.

import { byElementId } from "./element.js";

/** The address is changed at most this often, milliseconds: browsers limit it. */
const PAUSE_MS = 400;

export class Link {
  #read;
  #waiting = 0;

  /** `read()` returns the state as an object of texts and numbers; null values are left out. */
  constructor(read) {
    this.#read = read;
    byElementId("link").addEventListener("click", () => this.#copy());
  }

  /** Puts the state into the address soon. */
  change() {
    clearTimeout(this.#waiting);
    this.#waiting = setTimeout(() => this.#write(), PAUSE_MS);
  }

  #write() {
    const state = Object.entries(this.#read()).filter(([, value]) => value !== null);
    try {
      history.replaceState(null, "", `#${state.map(([name, value]) => `${name}=${value}`).join("&")}`);
    } catch {
      // The page works without it, e.g. in a frame of another page.
    }
  }

  async #copy() {
    this.#write();
    const say = (text) => (byElementId("copied").textContent = text);
    try {
      await navigator.clipboard.writeText(location.href);
      say("Copied");
    } catch {
      say("The link is in the address bar");
    }
    setTimeout(() => say(""), 3000);
  }
}

/** The state in an address: `number(name)`, `numbers(name)` and `text(name)`, null where it is missing or wrong. */
export function stateOf(hash) {
  const parts = new URLSearchParams(hash.replace(/^#/, ""));
  const numbers = (name) => {
    const found = (parts.get(name) ?? "").split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
    return found.every(Number.isFinite) ? found : null;
  };
  return { text: (name) => parts.get(name), numbers, number: (name) => numbers(name)?.[0] ?? null };
}
