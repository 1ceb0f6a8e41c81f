// What a person has changed on the page of a finished run: objects that are one, and labels. The files of the run stay as
// they are; the changes are kept in the page's link and by the browser. Those of a link that somebody opens are shown, and kept only once
// they are changed; what the browser has kept before stays kept besides.

import { mergedObject } from "./merged_object.js";

/** Longest label, characters. */
export const LABEL_LENGTH = 80;
/** Begins the names under which browsers keep changes. */
const KEPT = "splatseg edits ";
/** Ends the name under which they keep changes, as texts, in whose place a link's were changed. */
const OTHERS = " others";

export class Edits {
  /** In order: `["merge", id, ...ids]`, of which the first one stays, or `["name", id, label]`, empty for none. */
  #steps = [];
  /** True while the changes are a link's, and not kept. */
  #isOfLink = false;
  /** Texts of changes that are kept besides, the newest first. */
  #others = [];
  #known;
  #key;

  /** The changes of a run; those that the browser has kept. */
  constructor(run) {
    this.#known = new Set(run.objects.map(({ id }) => id));
    this.#key = `${KEPT}${digest(JSON.stringify([run.scene, run.names.length, run.objects.map(({ id, frames, area }) => [id, frames, area])]))}`;
    try {
      this.#steps = this.#checked(localStorage.getItem(this.#key) ?? "[]") ?? [];
      const others = JSON.parse(localStorage.getItem(this.#key + OTHERS) ?? "[]");
      this.#others = others.filter((text) => this.#checked(text));
    } catch {
      // Some browsers keep nothing for pages from disk.
    }
  }

  /** Merges objects into the first one. */
  merge(ids) {
    this.#add(["merge", ...ids]);
  }

  /** Gives an object a label; empty for none. */
  rename(id, label) {
    this.#add(["name", id, label.trim().slice(0, LABEL_LENGTH)]);
  }

  /** Takes the last change back. */
  undo() {
    this.#steps = this.#steps.slice(0, -1);
    this.#keep();
  }

  /** What `undo` would take back, as text; null for nothing. */
  get last() {
    const [kind, id, ...rest] = this.#steps.at(-1) ?? [];
    if (kind === "merge") return `merge of ${[id, ...rest].map((one) => `#${one}`).join(", ")}`;
    return kind ? `label of #${id}` : null;
  }

  /** The changes as text for a link; null for none. */
  get text() {
    return this.#steps.length ? JSON.stringify(this.#steps) : null;
  }

  /** The changes as lines of `splatseg name --labels`: `id,label`, and `merge:12,7` for an object that is part of another one. */
  get lines() {
    const texts = this.#steps.flatMap(([kind, id, ...rest]) =>
      kind === "merge" ? rest.map((other) => `merge:${other},${id}`) : [`${id},"${rest[0].replaceAll('"', '""')}"`],
    );
    return ["id,label", ...texts, ""].join("\n");
  }

  /** Shows the changes of a link, which are not kept yet. Returns false, and nothing is changed, if the text has none. */
  read(text) {
    const steps = this.#checked(text);
    if (!steps) return false;
    if (JSON.stringify(steps) === JSON.stringify(this.#steps)) return true;
    this.#setAside();
    this.#steps = steps;
    this.#isOfLink = true;
    return true;
  }

  /** True if changes are kept besides those that are shown. */
  get hasOthers() {
    return this.#others.some((text) => text !== this.text);
  }

  /** Shows the newest changes that are kept besides, and keeps those that are shown besides, unless they are a link's. */
  showOthers() {
    const next = this.#others.find((text) => text !== this.text);
    if (!next) return;
    const shown = this.#isOfLink || !this.text ? [] : [this.text];
    this.#others = [...this.#others.filter((text) => text !== next), ...shown];
    this.#steps = JSON.parse(next);
    this.#keep();
  }

  /** Objects after the changes, and for each id that is another one's now, that one: `{ objects, into }`. */
  applied(objects) {
    const byId = new Map(objects.map((object) => [object.id, object]));
    const into = new Map();
    for (const [kind, first, ...rest] of this.#steps) {
      const id = into.get(first) ?? first;
      if (kind === "name") byId.set(id, { ...byId.get(id), label: rest[0] || null });
      else for (const other of rest.map((one) => into.get(one) ?? one).filter((one) => one !== id)) {
        byId.set(id, mergedObject(byId.get(id), byId.get(other)));
        byId.delete(other);
        for (const [from, to] of into) if (to === other) into.set(from, id);
        into.set(other, id);
      }
    }
    return { objects: [...byId.values()], into };
  }

  #add(step) {
    this.#steps = [...this.#steps, step];
    this.#keep();
  }

  /** Keeps the changes besides others, unless they are a link's. */
  #setAside() {
    if (!this.#isOfLink && this.text) this.#others = [this.text, ...this.#others.filter((text) => text !== this.text)];
  }

  #keep() {
    this.#isOfLink = false;
    const others = this.#others.filter((text) => text !== this.text);
    this.#others = others;
    try {
      store(this.#key + OTHERS, others.length ? JSON.stringify(others) : null);
      store(this.#key, this.text);
    } catch {
      // The link has them.
    }
  }

  /** Changes of this run's objects in a text; null if it is wrong. */
  #checked(text) {
    let steps = null;
    try {
      steps = JSON.parse(text);
    } catch {
      return null;
    }
    const isId = (id) => this.#known.has(id);
    const isStep = (step) =>
      Array.isArray(step) &&
      ((step[0] === "merge" && step.length > 2 && step.slice(1).every(isId)) ||
        (step[0] === "name" && step.length === 3 && isId(step[1]) && typeof step[2] === "string" && step[2].length <= LABEL_LENGTH));
    return Array.isArray(steps) && steps.every(isStep) ? steps : null;
  }
}

/** Keeps a text in the browser; null removes it. */
function store(key, text) {
  if (text === null) localStorage.removeItem(key);
  else localStorage.setItem(key, text);
}

/** A short number for a text (FNV-1a). */
function digest(text) {
  let sum = 0x811c9dc5;
  for (let at = 0; at < text.length; at++) sum = Math.imul(sum ^ text.charCodeAt(at), 0x01000193);
  return (sum >>> 0).toString(16);
}
