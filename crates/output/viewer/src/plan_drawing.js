// What is drawn on the plan: footprints, names of rooms, the camera.
//
// A view has `context`, `scale` in pixels per metre, `x` and `y` of the grid's corner in pixels, and the colours `style`.

import { nameOf } from "./element.js";

const CAMERA_COLOR = "#f25c05";
/** Texts are left out where they would be wider than their object, which is at least this wide, pixels. */
const SMALLEST_LABEL = 16;
/** Height of a line, pixels. */
const LINE = 15;
const FONT = "12px system-ui, sans-serif";
const ROOM_FONT = "600 13px system-ui, sans-serif";

/** Draws an object's footprint; bolder if it is marked. */
export function drawFootprint(view, outlines, object, { isMarked, isAny }) {
  const { context, style } = view;
  const shape = new Path2D();
  for (const outline of outlines) {
    for (let index = 0; index < outline.length; index += 2) {
      shape[index ? "lineTo" : "moveTo"](...pixel(view, outline[index] / 100, outline[index + 1] / 100));
    }
    shape.closePath();
  }
  context.globalAlpha = isAny && !isMarked ? 0.45 : 0.9;
  context.fillStyle = `rgb(${object.color.join(" ")})`;
  context.fill(shape, "evenodd");
  context.globalAlpha = 1;
  context.strokeStyle = isMarked ? style.ink : style.paper;
  context.lineWidth = isMarked ? 3 : 1;
  context.stroke(shape);
}

/** Texts that do not cover each other: the first ones win. */
export class Texts {
  #view;
  /** Left, right, top and bottom of what is written, pixels. */
  #taken = [];

  constructor(view) {
    this.#view = view;
    Object.assign(view.context, { textAlign: "center", textBaseline: "middle", lineJoin: "round" });
  }

  /** Writes the names of rooms, or their numbers, with their areas below. */
  addRooms(rooms, origin) {
    for (const { id, name, name_source: source, middle, area_m2: area } of rooms) {
      const [x, y] = pixel(this.#view, middle[0] - origin[0], middle[1] - origin[1]);
      this.#write(ROOM_FONT, name ?? `Room ${id}`, [x, y - 8]);
      this.#write(FONT, `${area.toFixed(1)} m²${source === "derived" ? ", by its objects" : ""}`, [x, y + 8]);
    }
  }

  /** Writes an object's id on its footprint, and its label if there is space. */
  addObject(outlines, object) {
    const { context, scale } = this.#view;
    // Parts may lie far apart: the text is on the largest one.
    const { left, right, low, high } = outlines.map(extent).reduce((best, one) => (area(one) > area(best) ? one : best));
    const [width, height] = [((right - left) / 100) * scale, ((high - low) / 100) * scale];
    if (Math.min(width, height) < SMALLEST_LABEL) return;
    context.font = FONT;
    const texts = [nameOf(object.id, object), `#${object.id}`];
    const text = texts.find((text) => context.measureText(text).width < width);
    if (text) this.#write(FONT, text, pixel(this.#view, (left + right) / 200, (low + high) / 200));
  }

  /** A text with a rim in the colour of the page, so that it can be read on any ground. */
  #write(font, text, [x, y]) {
    const { context, style } = this.#view;
    context.font = font;
    const half = context.measureText(text).width / 2;
    const place = [x - half, x + half, y - LINE / 2, y + LINE / 2];
    const covers = ([left, right, top, bottom]) => left < place[1] && place[0] < right && top < place[3] && place[2] < bottom;
    if (this.#taken.some(covers)) return;
    this.#taken.push(place);
    context.lineWidth = 4;
    context.strokeStyle = style.paper;
    context.strokeText(text, x, y);
    context.fillStyle = style.ink;
    context.fillText(text, x, y);
  }
}

/** Draws the path of the camera, and where it is and looks; `camera` may be missing. */
export function drawCamera(view, path, camera) {
  const { context } = view;
  context.strokeStyle = CAMERA_COLOR;
  context.fillStyle = CAMERA_COLOR;
  context.lineWidth = 1.5;
  context.beginPath();
  path.forEach((place, index) => context[index ? "lineTo" : "moveTo"](...pixel(view, ...place)));
  context.stroke();
  if (!camera) return;
  const [x, y] = pixel(view, ...camera.at);
  const angle = Math.atan2(-camera.direction[1], camera.direction[0]);
  context.beginPath();
  for (const [turn, length] of [[0, 14], [2.5, 8], [-2.5, 8]]) {
    context.lineTo(x + length * Math.cos(angle + turn), y + length * Math.sin(angle + turn));
  }
  context.closePath();
  context.fill();
}

/** True if a place is inside of outlines, centimetres: an odd number of them is to its right. */
export function isInside(outlines, [x, y]) {
  let inside = false;
  for (const outline of outlines) {
    for (let index = 0; index < outline.length; index += 2) {
      const [x1, y1] = [outline[index], outline[index + 1]];
      const [x2, y2] = [outline[(index + 2) % outline.length], outline[(index + 3) % outline.length]];
      if (y1 > y !== y2 > y && x < x1 + ((y - y1) / (y2 - y1)) * (x2 - x1)) inside = !inside;
    }
  }
  return inside;
}

/** Pixel of a place, metres from the grid's corner. */
function pixel({ scale, x, y }, right, up) {
  return [x + right * scale, y - up * scale];
}

function extent(outline) {
  const xs = outline.filter((_, index) => index % 2 === 0);
  const ys = outline.filter((_, index) => index % 2 === 1);
  return { left: Math.min(...xs), right: Math.max(...xs), low: Math.min(...ys), high: Math.max(...ys) };
}

function area({ left, right, low, high }) {
  return (right - left) * (high - low);
}
