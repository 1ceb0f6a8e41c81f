// Elements of the page. Data is inserted as text, never as HTML.

export const byElementId = (id) => document.getElementById(id);

/** Shows a text at a place for notes. */
export function note(place, text) {
  byElementId(place).textContent = text;
  byElementId(place).hidden = false;
}

/** An object's id and name. */
export function nameOf(id, object) {
  return object?.label ? `#${id} ${object.label}` : `#${id}`;
}

/** An element with attributes, properties such as `textContent`, and children. */
export function element(name, properties = {}, children = []) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

/** A square in an object's colour. */
export function swatch(object) {
  const made = element("span", { className: "swatch" });
  made.style.backgroundColor = `rgb(${object.color.join(" ")})`;
  return made;
}

/** Makes `rows` the children of a list. The row with the focus stays in its place, as one that is moved loses it. */
export function showRows(list, rows) {
  const isSame = rows.length === list.children.length && rows.every((row, place) => row === list.children[place]);
  if (isSame) return;
  const focused = rows.findIndex((row) => row.contains(document.activeElement) && row.parentElement === list);
  if (focused < 0) return list.replaceChildren(...rows);
  const wanted = new Set(rows);
  for (const row of [...list.children]) if (!wanted.has(row)) row.remove();
  rows[focused].before(...rows.slice(0, focused));
  rows[focused].after(...rows.slice(focused + 1));
}

/** The crop of an object; removes itself if its file is missing. */
export function cropOf(object, properties) {
  const image = element("img", { ...properties, src: object.crop });
  image.addEventListener("error", () => image.remove());
  return image;
}

/** True if an object counts: it is remembered, or the method has no memory (docs/OBJECTS.md). */
export const counts = ({ state }) => !state || state === "remembered";

/** A count with its noun, in the singular or plural. */
export function counted(count, noun) {
  return `${count.toLocaleString("en")} ${noun}${count === 1 ? "" : "s"}`;
}
