// The directions of the world's axes, and a bar of a round length, in the corners of the map.

import { Quaternion, Vector3 } from "three";
import { byElementId } from "./element.js";

/** Length of an axis, and the greatest one of the bar, pixels. */
const AXIS_PIXELS = 26;
const BAR_PIXELS = 140;
const AXES = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };

/** Draws the axes for a camera, and the bar for a scale, pixels per metre at the middle of the view. */
export function showScale(camera, pixelsPerMetre) {
  const toView = new Quaternion().copy(camera.quaternion).invert();
  for (const [name, axis] of Object.entries(AXES)) {
    const { x, y } = new Vector3(...axis).applyQuaternion(toView).multiplyScalar(AXIS_PIXELS);
    const group = byElementId(`axis-${name}`);
    const [line, text] = group.children;
    line.setAttribute("x2", x.toFixed(1));
    line.setAttribute("y2", (-y).toFixed(1));
    text.setAttribute("x", (1.35 * x).toFixed(1));
    text.setAttribute("y", (-1.35 * y).toFixed(1));
  }
  const length = roundLength(BAR_PIXELS / pixelsPerMetre);
  byElementId("scale-bar").style.width = `${(length * pixelsPerMetre).toFixed(1)}px`;
  byElementId("scale-length").textContent = lengthText(length);
}

/** The greatest of 1, 2, 5, 10 … (or their tenths) that is not above a length. */
export function roundLength(most) {
  const power = 10 ** Math.floor(Math.log10(most));
  return [5, 2, 1].find((part) => part * power <= most * (1 + 1e-9)) * power;
}

function lengthText(metres) {
  if (metres >= 0.999) return `${Math.round(metres)} m`;
  return metres >= 0.00999 ? `${Math.round(100 * metres)} cm` : `${Number((1000 * metres).toPrecision(1))} mm`;
}
