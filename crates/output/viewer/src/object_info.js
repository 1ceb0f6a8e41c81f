// Details of the selected object.

import { counted, cropOf, element, swatch } from "./element.js";

/** Texts for objects in an unusual state of the memory. */
const STATES = {
  tentative: "tentative: seen in one frame only",
  forgotten: "given up: removed, part of another object, or a mistake",
};

export class ObjectInfo {
  #run;
  #actions;
  #place = document.getElementById("info");
  /** What is shown now; null without an object. */
  #shown = null;
  #isolate = null;
  #hide = null;
  /** False as long as objects cannot be merged. */
  canMerge = true;

  /**
   * `actions`: `{ goTo(frame), center(id), isolate(), hide(), merge(id) }`; center, isolate and hide are missing without a map,
   * `merge` if objects can never be merged.
   */
  constructor(run, actions) {
    this.#run = run;
    this.#actions = actions;
    this.show(0);
  }

  /** Shows an object; without one, explains how to select one. */
  show(id) {
    const object = this.#run.byId.get(id);
    this.#place.hidden = !object;
    if (!object) {
      this.#shown = null;
      return this.#place.replaceChildren();
    }
    const actions = this.#actionsOf(object);
    const kind = [id, Boolean(object.crop), ...actions.map(([name]) => name)].join();
    // What is shown already stays in its place, with the focus and the place that it was scrolled to.
    if (this.#shown?.kind !== kind) this.#build(object, actions, kind);
    const { title, crop, list } = this.#shown;
    title.textContent = `Object ${object.id}${object.label ? `: ${object.label}` : ""}`;
    if (crop && crop.getAttribute("src") !== object.crop) crop.src = object.crop;
    const facts = this.#facts(object);
    const text = JSON.stringify(facts);
    if (this.#shown.text === text) return;
    this.#shown.text = text;
    const rows = facts.flatMap(([name, value]) => [
      element("dt", { textContent: name }),
      element("dd", { textContent: value }),
    ]);
    list.replaceChildren(...rows);
  }

  /** Makes the elements for an object; the same button has the focus as before. */
  #build(object, actions, kind) {
    const isOther = this.#shown?.id !== object.id;
    const focused = this.#place.contains(document.activeElement) ? document.activeElement.textContent : null;
    const [title, list] = [element("span"), element("dl")];
    const crop = object.crop ? cropOf(object, { className: "large", alt: `object ${object.id}` }) : null;
    const { scrollTop } = this.#place;
    const buttons = actions.map((action) => this.#button(...action));
    const heading = element("h2", {}, [swatch(object), title]);
    this.#place.replaceChildren(heading, element("div", { className: "actions" }, buttons), ...(crop ? [crop] : []), list);
    this.#shown = { id: object.id, kind, title, crop, list, text: null };
    this.#place.scrollTop = isOther ? 0 : scrollTop;
    if (!isOther && focused) buttons.find(({ textContent }) => textContent === focused)?.focus();
  }

  /** Shows whether the selected object is the only one in the map, and whether it is hidden there. */
  showDrawn(isolated, hidden) {
    this.#isolate?.setAttribute("aria-pressed", String(isolated));
    this.#hide?.setAttribute("aria-pressed", String(hidden));
  }

  #facts(object) {
    const name = (frame) => this.#run.names[frame];
    const metres = (numbers) => numbers.map((number) => number.toFixed(2));
    const facts = [["seen in", this.#seenIn(object.frames, this.#run.frameCount)]];
    if (object.seen.length) {
      facts.push(["first", name(object.seen[0][0])], ["last", name(object.seen.at(-1)[1])]);
      facts.push(["largest", `${object.area.toLocaleString("en")} px in ${name(object.best)}`]);
    }
    if (object.confidence !== null && object.confidence !== undefined) {
      facts.push(["confidence", `${Math.round(100 * object.confidence)} %`]);
    }
    if (object.box) facts.push(["size", `${metres(object.box.size).join(" × ")} m`]);
    if (object.centroid) facts.push(["centroid", `${metres(object.centroid).join(", ")} m`]);
    if (object.gaussians !== null && object.gaussians !== undefined) {
      facts.push(["in the map", counted(object.gaussians, "Gaussian")]);
    }
    if (STATES[object.state]) facts.push(["status", STATES[object.state]]);
    return facts;
  }

  /** A map that was loaded may have been seen in more frames than there are here. */
  #seenIn(frames, all) {
    return frames > all ? counted(frames, "frame") : `${frames.toLocaleString("en")} of ${counted(all, "frame")}`;
  }

  /** Names of the buttons for an object, with what they do. */
  #actionsOf({ id, seen, gaussians, box }) {
    const actions = [];
    if (seen.length) {
      const object = () => this.#run.byId.get(id);
      actions.push(["First frame", () => this.#actions.goTo(object().seen[0][0])]);
      actions.push(["Largest view", () => this.#actions.goTo(object().best)]);
    }
    if ((gaussians || box) && this.#actions.center) {
      actions.push(["Centre in map", () => this.#actions.center(id)]);
      actions.push(["Isolate", () => this.#actions.isolate()], ["Hide", () => this.#actions.hide()]);
    }
    if (this.#actions.merge && this.canMerge) actions.push(["Merge…", () => this.#actions.merge(id)]);
    return actions;
  }

  #button(name, act) {
    const made = element("button", { type: "button", textContent: name });
    made.addEventListener("click", act);
    if (name === "Isolate") this.#isolate = made;
    if (name === "Hide") this.#hide = made;
    return made;
  }
}
