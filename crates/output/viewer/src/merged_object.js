// Two objects of a run's data as one.

import { counts } from "./element.js";
import { inverse, turned } from "./rotation.js";

/** The first object, with what is known of the second one, too. Its id, colour and label stay, unless it has no label. */
export function mergedObject(one, other) {
  const seen = union(one.seen, other.seen);
  const larger = other.area > one.area ? other : one;
  return {
    ...one,
    label: one.label ?? other.label,
    state: [one, other].find(counts)?.state ?? one.state,
    seen,
    frames: seen.length ? seen.reduce((sum, [first, last]) => sum + last - first + 1, 0) : Math.max(one.frames, other.frames),
    area: larger.area,
    best: larger.best,
    crop: larger.crop ?? one.crop ?? other.crop,
    confidence: mean([one.confidence, other.confidence], [one.frames, other.frames]),
    gaussians: one.gaussians || other.gaussians ? (one.gaussians ?? 0) + (other.gaussians ?? 0) : one.gaussians,
    centroid: meanPlace([one.centroid, other.centroid], [one.gaussians, other.gaussians]),
    box: one.box && other.box ? around(one.box, other.box) : (one.box ?? other.box),
  };
}

/** Stretches `[first, last]` of frames that are in either list. */
function union(one, other) {
  const joined = [];
  for (const [first, last] of [...one, ...other].sort(([left], [right]) => left - right)) {
    const before = joined.at(-1);
    if (before && first <= before[1] + 1) before[1] = Math.max(before[1], last);
    else joined.push([first, last]);
  }
  return joined;
}

/** Mean of the values that there are, by weight. */
function mean(values, weights) {
  const known = values.map((value, at) => [value, weights[at] || 1]).filter(([value]) => value !== null && value !== undefined);
  const sum = known.reduce((sum, [, weight]) => sum + weight, 0);
  return sum ? known.reduce((total, [value, weight]) => total + value * weight, 0) / sum : values[0];
}

function meanPlace(places, weights) {
  if (!places[0] || !places[1]) return places[0] ?? places[1];
  return [0, 1, 2].map((axis) => mean(places.map((place) => place[axis]), weights));
}

/** The smallest box with the axes of the first one around both. */
function around(one, other) {
  const back = inverse(one.rotation);
  const corners = [one, other].flatMap(({ center, size, rotation }) =>
    Array.from({ length: 8 }, (_, corner) => {
      const half = size.map((side, axis) => (corner & (1 << axis) ? 0.5 : -0.5) * side);
      const place = turned(rotation, half).map((value, axis) => value + center[axis] - one.center[axis]);
      return turned(back, place);
    }),
  );
  const ends = [0, 1, 2].map((axis) => corners.map((corner) => corner[axis])).map((values) => [Math.min(...values), Math.max(...values)]);
  const middle = turned(one.rotation, ends.map(([low, high]) => (low + high) / 2));
  return { ...one, center: middle.map((value, axis) => value + one.center[axis]), size: ends.map(([low, high]) => high - low) };
}
