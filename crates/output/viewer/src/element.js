// Elements of the page. Data is inserted as text, never as HTML.

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

/** A count with its noun, in the singular or plural. */
export function counted(count, noun) {
  return `${count.toLocaleString("en")} ${noun}${count === 1 ? "" : "s"}`;
}
