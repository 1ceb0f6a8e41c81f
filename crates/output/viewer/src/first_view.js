// The view in which the whole map fits into the stage.

/** Angles by which the view may be turned from the cameras' direction, and heights above the horizon, degrees. */
const TURNS = [0, -15, 15, -30, 30, -45, 45];
const HEIGHTS = [35, 45, 55];
/** Part of the points that may be outside at each side: strays far from the rest. */
const OUTSIDE = 0.0005;
/** Part of the stage that the middles of Gaussians may fill; the spots around them reach farther. */
const FILLED = 0.95;
/** What faces away from the middle of the view by less than this cosine may still be seen at its side. */
const GRAZING = 0.25;
/** A view from the cameras' direction is preferred to one that is turned by 45 degrees and fills this much more. */
const PREFERENCE = 0.25;

/**
 * Returns `{ position, target }` of the view that shows all points and fills the stage best. `points` are
 * `{ position, facing }` (what faces away is not drawn), `forward` is the cameras' level direction and `up` the upward
 * one, both unit vectors; `height` is the tangent of half the angle of view, `aspect` the stage's width by its height.
 */
export function firstView(points, { forward, up, height, aspect }) {
  let best = null;
  for (const turn of TURNS) {
    for (const rise of HEIGHTS) {
      const direction = directionOf(forward, up, radians(turn), radians(rise));
      const view = fit(points, direction, up, { x: FILLED * height * aspect, y: FILLED * height });
      const score = view.filled * (1 - (PREFERENCE * Math.abs(turn)) / 45);
      if (!best || score > best.score) best = { ...view, score };
    }
  }
  return best;
}

/** The view of all points in a direction; `tangents` are those of half the angles of view. */
export function fit(points, direction, up, tangents) {
  const right = unit(cross(direction, up));
  const above = cross(right, direction);
  const drawn = points.filter(({ facing }) => dot(facing, direction) <= GRAZING);
  const seen = (drawn.length ? drawn : points).map(({ position }) => [right, above, direction].map((axis) => dot(position, axis)));
  const sides = [["x", 0], ["y", 1]].map(([name, axis]) => {
    const tangent = tangents[name];
    // A point is inside if the camera is below one bound and above the other.
    const least = quantile(seen.map((point) => point[axis] + tangent * point[2]), OUTSIDE);
    const most = quantile(seen.map((point) => point[axis] - tangent * point[2]), 1 - OUTSIDE);
    return { tangent, middle: (least + most) / 2, depth: (least - most) / (2 * tangent) };
  });
  const depth = Math.min(...sides.map((side) => side.depth));
  const camera = [sides[0].middle, sides[1].middle, depth];
  const filled = sides.map(({ tangent }, axis) => {
    const places = seen.map((point) => (point[axis] - camera[axis]) / Math.max(point[2] - depth, 1e-3) / tangent);
    return Math.min((quantile(places, 1 - OUTSIDE) - quantile(places, OUTSIDE)) / 2, 1);
  });
  const far = quantile(seen.map((point) => point[2]), 0.5) - depth;
  const world = (place) => [0, 1, 2].map((axis) => place[0] * right[axis] + place[1] * above[axis] + place[2] * direction[axis]);
  return { position: world(camera), target: world([camera[0], camera[1], depth + far]), filled: filled[0] * filled[1] };
}

/** The level direction turned about `up`, and then pointed down. */
function directionOf(forward, up, turn, down) {
  const aside = cross(forward, up);
  const level = forward.map((value, axis) => value * Math.cos(turn) + aside[axis] * Math.sin(turn));
  return level.map((value, axis) => value * Math.cos(down) - up[axis] * Math.sin(down));
}

function quantile(values, part) {
  return Float64Array.from(values).sort()[Math.round(part * (values.length - 1))];
}

const radians = (degrees) => (degrees * Math.PI) / 180;
const dot = (left, right) => left[0] * right[0] + left[1] * right[1] + left[2] * right[2];
const unit = (vector) => vector.map((value) => value / (Math.hypot(...vector) || 1));
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
