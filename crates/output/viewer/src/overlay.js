// Draws the objects of a frame over its picture, as the overlays of a finished run show them.

/** Opacity of an object's colour, from 0 to 255. */
const TINT = 128;
/** Pixels as numbers: red in the lowest byte, then green, blue and opacity. */
const BORDER = 0xffffffff;
const packed = ([red, green, blue]) => ((TINT << 24) | (blue << 16) | (green << 8) | red) >>> 0;
/** An object is numbered where this many pixels around are its own. */
const ROOM = 9;

/**
 * Draws ids, `{ width, height, ids }`, into a canvas of the same size; `colorOf(id)` is the colour of an object, `textOf(id)`
 * what is written on it.
 */
export function drawOverlay(canvas, { width, height, ids }, colorOf, textOf = String) {
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext("2d");
  const picture = context.createImageData(width, height);
  const pixels = new Uint32Array(picture.data.buffer);
  const colors = new Map([[0, 0]]);
  for (let row = 0; row < height; row++) {
    for (let column = 0; column < width; column++) {
      const index = row * width + column;
      const id = ids[index];
      const isBorder = (column + 1 < width && ids[index + 1] !== id) || (row + 1 < height && ids[index + width] !== id);
      if (!colors.has(id)) colors.set(id, packed(colorOf(id)));
      pixels[index] = isBorder ? BORDER : colors.get(id);
    }
  }
  context.putImageData(picture, 0, 0);
  context.font = "600 14px system-ui, sans-serif";
  [context.textAlign, context.textBaseline, context.lineWidth] = ["center", "middle", 3];
  for (const [id, { index }] of innermost(ids, width, height)) {
    const place = [index % width, Math.floor(index / width)];
    context.strokeText(textOf(id), ...place);
    context.fillStyle = "#fff";
    context.fillText(textOf(id), ...place);
  }
}

/** For each object with room for its number, the pixel farthest from its border. */
function innermost(ids, width, height) {
  const distance = new Uint16Array(ids.length);
  const near = (index, other) => (ids[other] === ids[index] ? distance[other] + 1 : 1);
  for (let index = 0; index < ids.length; index++) {
    const [column, row] = [index % width, Math.floor(index / width)];
    distance[index] = column === 0 || row === 0 ? 1 : Math.min(near(index, index - 1), near(index, index - width));
  }
  const found = new Map();
  for (let index = ids.length - 1; index >= 0; index--) {
    const [column, row] = [index % width, Math.floor(index / width)];
    const after = column === width - 1 || row === height - 1 ? 1 : Math.min(near(index, index + 1), near(index, index + width));
    distance[index] = Math.min(distance[index], after);
    const id = ids[index];
    if (id && distance[index] >= ROOM && distance[index] > (found.get(id)?.clearance ?? 0)) {
      found.set(id, { index, clearance: distance[index] });
    }
  }
  return found;
}
