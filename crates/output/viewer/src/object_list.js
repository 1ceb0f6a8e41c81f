// The list of objects.

import { counted, counts, cropOf, element, showRows, swatch } from "./element.js";

/** Sort keys of the list; ties are broken by id. */
const ORDERS = {
  id: () => 0,
  frames: (left, right) => right.frames - left.frames,
  area: (left, right) => (right.area ?? 0) - (left.area ?? 0),
};

export class ObjectList {
  #objects;
  #list = document.getElementById("list");
  #filter = document.getElementById("filter");
  #order = document.getElementById("order");
  #present = document.getElementById("present");
  #all = document.getElementById("all");
  #rows = new Map();
  #ids = new Set();
  /** The objects that the program has found for the text of the filter. */
  #found = new Set();
  #selected = 0;
  #actions;

  /** `actions`: `pick(id)` chooses an object; `filter(isFound)` is called with a function that tells for an id whether it is found. */
  constructor(objects, actions) {
    this.#actions = actions;
    this.#add(objects);
    this.#filter.addEventListener("input", () => {
      this.#show();
      const found = new Set(this.#objects.filter((object) => this.#isFound(object)).map(({ id }) => id));
      actions.filter?.((id) => found.has(id));
    });
    this.#present.addEventListener("change", () => this.#show());
    this.#all.addEventListener("change", () => this.#show());
    this.#order.addEventListener("change", () => this.#sort());
    this.#list.addEventListener("keydown", (event) => this.#move(event));
    this.#sort();
    this.#show();
  }

  /** Shows these objects in the place of those before. */
  update(objects) {
    const ids = new Set(objects.map(({ id }) => id));
    for (const id of [...this.#rows.keys()].filter((id) => !ids.has(id))) this.#rows.delete(id);
    this.#add(objects);
    this.#sort();
    this.#show();
  }

  #add(objects) {
    this.#objects = objects;
    for (const object of objects) {
      const known = this.#rows.get(object.id);
      if (known) describe(known, object);
      else this.#rows.set(object.id, row(object, this.#actions.pick));
    }
  }

  /** Sets the ids of the objects in the current frame. */
  showFrame(ids) {
    this.#ids = ids;
    this.#show();
  }

  /** Shows these objects besides those that the filter finds. */
  showFound(ids) {
    this.#found = new Set(ids);
    this.#show();
  }

  /** Highlights an object, or none, and scrolls to it. */
  mark(id) {
    this.#button(this.#selected)?.setAttribute("aria-pressed", "false");
    const isNew = this.#selected !== id;
    this.#selected = id;
    this.#button(id)?.setAttribute("aria-pressed", "true");
    this.#show();
    if (isNew) this.#button(id)?.scrollIntoView({ block: "nearest" });
  }

  /** Marks the objects that are chosen to be merged. */
  showChosen(ids) {
    for (const [id, row] of this.#rows) row.classList.toggle("chosen", ids.has(id));
  }

  /** Strikes out the objects that the map does not show. */
  showDrawn(isShown) {
    for (const [id, row] of this.#rows) row.classList.toggle("off", !isShown(id));
  }

  #button(id) {
    return this.#rows.get(id)?.firstChild;
  }

  #sort() {
    const order = ORDERS[this.#order.value];
    const sorted = [...this.#objects].sort((left, right) => order(left, right) || left.id - right.id);
    showRows(this.#list, sorted.map((object) => this.#rows.get(object.id)));
  }

  /** True if the text that is looked for fits an object. */
  #isFound({ id, label }) {
    const wanted = this.#filter.value.trim().replace(/^#/, "").toLowerCase();
    return String(id).startsWith(wanted) || (label ?? "").toLowerCase().includes(wanted) || this.#found.has(id);
  }

  #show() {
    let shown = 0;
    for (const object of this.#objects) {
      const { id } = object;
      const found = this.#isFound(object);
      const here = this.#ids.has(id);
      // Tentative and forgotten objects are folded away, unless they are looked for. The selected object stays in the list
      // while the video moves on.
      const folded = !counts(object) && !this.#all.checked && this.#filter.value === "";
      const visible = found && ((!folded && (here || !this.#present.checked)) || id === this.#selected);
      this.#rows.get(id).hidden = !visible;
      this.#button(id).classList.toggle("absent", !here);
      shown += visible ? 1 : 0;
    }
    document.getElementById("none").hidden = shown > 0;
    const of = (state) => this.#objects.filter((object) => object.state === state).length;
    const others = ["tentative", "forgotten"].map((state) => [of(state), state]).filter(([count]) => count > 0);
    this.#all.parentElement.hidden = others.length === 0;
    this.#all.nextElementSibling.textContent = others.map(([count, state]) => `${count.toLocaleString("en")} ${state}`).join(", ");
  }

  /** The up and down keys move from row to row. */
  #move(event) {
    const step = { ArrowDown: "nextElementSibling", ArrowUp: "previousElementSibling" }[event.key];
    let to = step && event.target.closest("li")?.[step];
    while (to?.hidden) to = to[step];
    if (!to) return;
    event.preventDefault();
    to.firstChild.focus();
  }
}

function row(object, onPick) {
  const button = element("button", { type: "button" }, [
    swatch(object),
    element("span", { className: "id", textContent: `#${object.id}` }),
    element("span", { className: "label" }),
    element("span", { className: "count", title: "frames that show it" }),
  ]);
  button.dataset.object = object.id;
  button.setAttribute("aria-pressed", "false");
  button.addEventListener("click", () => onPick(object.id));
  const made = element("li", {}, [button]);
  describe(made, object);
  return made;
}

/** Writes an object's label, number of frames and crop into its row. */
function describe(row, object) {
  const crop = row.querySelector(".crop");
  if (crop && object.crop && crop.getAttribute("src") !== object.crop) crop.src = object.crop;
  if (!crop && object.crop) row.querySelector(".swatch").after(cropOf(object, { className: "crop", alt: "", loading: "lazy" }));
  row.querySelector(".label").textContent = object.label ?? "";
  const [number, noun] = counted(object.frames, "frame").split(" ");
  row.querySelector(".count").replaceChildren(number, element("span", { className: "aside", textContent: ` ${noun}` }));
}
