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
