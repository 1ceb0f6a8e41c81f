// The directions of the world's axes, and a bar of a round length, in the corners of the map.

import { Quaternion, Vector3 } from "three";
import { byElementId } from "./element.js";
import { showBar } from "./scale_bar.js";

/** Length of an axis, pixels. */
const AXIS_PIXELS = 26;
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
  showBar(pixelsPerMetre);
}
