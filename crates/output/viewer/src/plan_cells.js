// The cells of the plan as a picture, in the colours of the page's scheme.

/** Codes of cells, as `page/plan.rs` writes them: unknown, occupied, and from 2 on free. */
const OCCUPIED = 1;
const FREE = 2;

/** Colours of the plan: texts for the canvas. */
export function styleOf(root) {
  const style = getComputedStyle(root);
  const of = (name) => style.getPropertyValue(`--${name}`).trim();
  return { ink: of("ink"), paper: of("paper"), muted: of("muted"), wall: of("wall"), free: of("free"), tint: of("tint") };
}

/** A canvas with a pixel for each cell, the row with the highest y first. */
export function cellsPicture({ width, height }, cells, style) {
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  const colors = new Map();
  const colorOf = (code) => {
    if (!colors.has(code)) colors.set(code, pixelOf(context, cellColor(code, style)));
    return colors.get(code);
  };
  // Before the picture exists, the canvas is where colours become numbers.
  const codes = cells.map((code, index) => cells[(height - 1 - Math.floor(index / width)) * width + (index % width)]);
  const pixels = codes.length ? Array.from(codes, colorOf) : [];
  const picture = context.createImageData(width, height);
  pixels.forEach((pixel, index) => picture.data.set(pixel, 4 * index));
  context.putImageData(picture, 0, 0);
  return canvas;
}

/** Colour of a cell; rooms differ in hue. */
function cellColor(code, { wall, free, tint }) {
  if (code === 0) return "transparent";
  if (code === OCCUPIED) return wall;
  return code === FREE ? free : `hsl(${(210 + 67 * (code - FREE - 1)) % 360} ${tint})`;
}

/** Red, green, blue and opacity of a colour. */
function pixelOf(context, color) {
  context.clearRect(0, 0, 1, 1);
  context.fillStyle = color;
  context.fillRect(0, 0, 1, 1);
  return context.getImageData(0, 0, 1, 1).data;
}
