// Lines in the map.

import { Vector3 } from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";

const LINE_PIXELS = 2;

/**
 * Lines that show through the map: a room's walls would otherwise hide a path inside it. `positions` has six coordinates
 * per piece.
 */
export function lines(positions, color) {
  const material = new LineMaterial({ color, linewidth: LINE_PIXELS, depthTest: false, transparent: true });
  const drawn = new LineSegments2(new LineSegmentsGeometry().setPositions(positions), material);
  drawn.frustumCulled = false;
  drawn.renderOrder = 1;
  return drawn;
}

/** Replaces the pieces of lines. */
export function setLines(drawn, positions) {
  // The number of pieces is fixed in a geometry.
  drawn.geometry.dispose();
  drawn.geometry = new LineSegmentsGeometry().setPositions(positions);
}

/** The edges of the unit box after a transform. */
export function unitBoxOf(matrix) {
  const edges = unitBox();
  const corner = new Vector3();
  for (let start = 0; start < edges.length; start += 3) corner.fromArray(edges, start).applyMatrix4(matrix).toArray(edges, start);
  return edges;
}

/** The twelve edges of the box from -0.5 to 0.5. */
export function unitBox() {
  const edges = [];
  for (let axis = 0; axis < 3; axis++) {
    for (const [u, v] of [[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]]) {
      for (const along of [-0.5, 0.5]) {
        const point = [0, 0, 0];
        [point[axis], point[(axis + 1) % 3], point[(axis + 2) % 3]] = [along, u, v];
        edges.push(...point);
      }
    }
  }
  return edges;
}
