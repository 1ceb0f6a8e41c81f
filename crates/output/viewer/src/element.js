// Elements of the page. What comes from data goes in as text, never as HTML.

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

/** The picture of an object that the run has cut out; nothing if it is not there. */
export function cropOf(object, properties) {
  const image = element("img", { ...properties, src: object.crop });
  image.addEventListener("error", () => image.remove());
  return image;
}

/** A count with its noun. */
export function counted(count, noun) {
  return `${count.toLocaleString("en")} ${noun}${count === 1 ? "" : "s"}`;
}
