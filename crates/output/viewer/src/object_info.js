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
    if (!object) return this.#place.replaceChildren();
    const title = `Object ${object.id}${object.label ? `: ${object.label}` : ""}`;
    const heading = element("h2", {}, [swatch(object), title]);
    const crop = object.crop ? [cropOf(object, { className: "large", alt: `object ${object.id}` })] : [];
    const facts = this.#facts(object).flatMap(([name, value]) => [
      element("dt", { textContent: name }),
      element("dd", { textContent: value }),
    ]);
    this.#place.replaceChildren(heading, this.#buttons(object), ...crop, element("dl", {}, facts));
    this.#place.scrollTop = 0;
  }

  /** Shows whether the selected object is the only one in the map, and whether it is hidden there. */
  showDrawn(isolated, hidden) {
    this.#isolate?.setAttribute("aria-pressed", String(isolated));
    this.#hide?.setAttribute("aria-pressed", String(hidden));
  }

  #facts(object) {
    const name = (frame) => this.#run.names[frame];
    const metres = (numbers) => numbers.map((number) => number.toFixed(2));
    const facts = [["seen in", `${object.frames.toLocaleString("en")} of ${counted(this.#run.frameCount, "frame")}`]];
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

  #buttons(object) {
    const button = (textContent, act) => {
      const made = element("button", { type: "button", textContent });
      made.addEventListener("click", act);
      return made;
    };
    const buttons = [];
    if (object.seen.length) {
      buttons.push(button("First frame", () => this.#actions.goTo(object.seen[0][0])));
      buttons.push(button("Largest view", () => this.#actions.goTo(object.best)));
    }
    if ((object.gaussians || object.box) && this.#actions.center) {
      buttons.push(button("Centre in map", () => this.#actions.center(object.id)));
      this.#isolate = button("Isolate", () => this.#actions.isolate());
      this.#hide = button("Hide", () => this.#actions.hide());
      buttons.push(this.#isolate, this.#hide);
    }
    if (this.#actions.merge && this.canMerge) buttons.push(button("Merge…", () => this.#actions.merge(object.id)));
    return element("div", { className: "actions" }, buttons);
  }
}
