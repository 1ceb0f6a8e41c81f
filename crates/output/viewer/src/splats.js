// The Gaussians of the map: their data, what hides them, and which one is at a pixel.

import { BufferAttribute, BufferGeometry } from "three";
import { bytesOf, idsOf, wordsOf } from "./bytes.js";
import { facingOf } from "./facing.js";

/** Drawn radius of a Gaussian, in standard deviations. */
export const RADIUS_IN_SIGMA = 2.2;
/** Part of the drawn radius within which a Gaussian hides what is behind it; neighbours then form a closed surface. */
export const OPAQUE_PART = 0.8;
/** Gaussians this far behind the nearest one are blended with it, in drawn radii. */
export const BLENDED_RADII = 1.5;
/** Minimum width of a point, pixels, so that none vanishes. */
export const MIN_PIXELS = 1.5;
/** Number of sampled points that determine the map's centre, extent and first view. */
const MAX_SAMPLES = 4000;
/** Colour of Gaussians without an object. */
const NO_OBJECT = [128, 128, 128];

export class Splats {
  /** The ids in the map's data. */
  #found;

  /** `map` is the run's map, `byId` its objects; those of the set `added` can be hidden. `places` are the camera's. */
  constructor(map, byId, places, added = new Set()) {
    this.count = map.count;
    this.positions = positionsOf(map);
    this.radii = Float32Array.from(wordsOf(map.radii), (part) => (part / 65535) * map.max_radius * RADIUS_IN_SIGMA);
    this.ids = idsOf(map.ids);
    this.#found = this.ids.slice();
    this.added = Uint8Array.from(this.ids, (id) => Number(added.has(id)));
    this.facing = facingOf(this.positions, places);
    this.shown = new Uint8Array(this.count).fill(1);
    this.colors = bytesOf(map.colors);
    this.objectColors = new Uint8Array(3 * this.count);
    this.#paint(byId);
    this.geometry = this.#geometry();
    /** What the shaders are told. `ceiling` is the height above which nothing is drawn, along `up`. */
    this.uniforms = {
      pixels: { value: 1 }, selected: { value: 0 }, trueColors: { value: 0 }, showAdded: { value: 1 }, ground: { value: null },
      cutWalls: { value: 1 }, ceiling: { value: 1e6 }, up: { value: null },
    };
  }

  #geometry() {
    const geometry = new BufferGeometry();
    const attributes = {
      position: [this.positions, 3], radius: [this.radii, 1], object: [Float32Array.from(this.ids), 1], added: [this.added, 1],
      shown: [this.shown, 1], facing: [this.facing, 3],
    };
    for (const [name, [values, size]] of Object.entries(attributes)) geometry.setAttribute(name, new BufferAttribute(values, size));
    geometry.setAttribute("objectColor", new BufferAttribute(this.objectColors, 3, true));
    geometry.setAttribute("trueColor", new BufferAttribute(this.colors, 3, true));
    return geometry;
  }

  #paint(byId) {
    const colors = new Map();
    this.ids.forEach((id, index) => {
      if (!colors.has(id)) colors.set(id, byId.get(id)?.color ?? NO_OBJECT);
      this.objectColors.set(colors.get(id), 3 * index);
    });
  }

  /** Shows objects that were merged as the one that they are: `into` has it for each of the others. */
  mergeObjects(into, byId) {
    this.#found.forEach((id, index) => (this.ids[index] = into.get(id) ?? id));
    this.#paint(byId);
    const { object, objectColor } = this.geometry.attributes;
    object.array.set(this.ids);
    object.needsUpdate = objectColor.needsUpdate = true;
  }

  /** Releases the memory of the GPU. */
  dispose() {
    this.geometry.dispose();
  }

  /** Shows or hides the added objects. */
  showAdded(wanted) {
    this.uniforms.showAdded.value = Number(wanted);
  }

  /** Shows the objects for which `isShown(id)` is true, and hides the others. */
  showObjects(isShown) {
    const known = new Map();
    this.ids.forEach((id, index) => {
      if (!known.has(id)) known.set(id, Number(isShown(id)));
      this.shown[index] = known.get(id);
    });
    this.geometry.getAttribute("shown").needsUpdate = true;
  }

  /** True if a Gaussian is not drawn for an eye at this place; the shader decides in the same way. */
  isHidden(index, eye) {
    const { uniforms, positions, facing } = this;
    if (!this.shown[index] || this.added[index] > uniforms.showAdded.value) return true;
    const at = 3 * index;
    const up = uniforms.up.value;
    if (up.x * positions[at] + up.y * positions[at + 1] + up.z * positions[at + 2] > uniforms.ceiling.value) return true;
    if (!uniforms.cutWalls.value || (uniforms.selected.value && this.ids[index] === uniforms.selected.value)) return false;
    return facing[at] * (eye.x - positions[at]) + facing[at + 1] * (eye.y - positions[at + 1]) + facing[at + 2] * (eye.z - positions[at + 2]) < 0;
  }

  /** Standard deviation of a Gaussian, metres. */
  sigmaOf(index) {
    return this.radii[index] / RADIUS_IN_SIGMA;
  }

  /**
   * What is drawn at a pixel: `{ id, point }`, an object and a place `[x, y, z]`, or null. `matrix` is from world to clip
   * space (16 numbers, column-major), `eye` the camera's place; `x` and `y` are pixels from the top left of a view of
   * `width` × `height` pixels, `pixels` is as in the shader, but in these pixels.
   */
  hitAt(matrix, eye, view) {
    const covering = this.#covering(matrix, eye, view);
    const opaque = covering.filter(({ distance2 }) => distance2 <= OPAQUE_PART ** 2);
    if (opaque.length === 0) return null;
    const nearest = opaque.reduce((one, other) => (other.depth < one.depth ? other : one));
    const end = nearest.depth + BLENDED_RADII * this.radii[nearest.index];
    const weights = new Map();
    for (const { index, depth, distance2 } of covering) {
      if (depth > end) continue;
      const weight = Math.exp(-0.5 * RADIUS_IN_SIGMA ** 2 * distance2);
      weights.set(this.ids[index], (weights.get(this.ids[index]) ?? 0) + weight);
    }
    const [[id]] = [...weights].sort((one, other) => other[1] - one[1]);
    return { id, point: Array.from(this.positions.subarray(3 * nearest.index, 3 * nearest.index + 3)) };
  }

  /** The Gaussians that cover a pixel: index, depth, and squared distance to the middle in drawn radii. */
  #covering(m, eye, { x, y, width, height, pixels }) {
    const found = [];
    for (let index = 0; index < this.count; index++) {
      const [px, py, pz] = [this.positions[3 * index], this.positions[3 * index + 1], this.positions[3 * index + 2]];
      const depth = m[3] * px + m[7] * py + m[11] * pz + m[15];
      if (depth < 0.02) continue;
      const radius = Math.max((this.radii[index] * pixels) / depth, MIN_PIXELS);
      const dx = ((m[0] * px + m[4] * py + m[8] * pz + m[12]) / depth + 1) * 0.5 * width - x;
      const dy = (1 - (m[1] * px + m[5] * py + m[9] * pz + m[13]) / depth) * 0.5 * height - y;
      const distance2 = (dx * dx + dy * dy) / (radius * radius);
      if (distance2 <= 1 && !this.isHidden(index, eye)) found.push({ index, depth, distance2 });
    }
    return found;
  }

  /** Evenly spread points: `{ position, facing }`. */
  samples() {
    const samples = Math.min(this.count, MAX_SAMPLES);
    return Array.from({ length: samples }, (_, sample) => {
      const at = 3 * Math.floor((sample * this.count) / samples);
      return { position: this.positions.subarray(at, at + 3), facing: this.facing.subarray(at, at + 3) };
    });
  }

  /** Centre of the map, and the radius that contains most of it, metres. */
  extent() {
    const samples = this.samples().map(({ position }) => position);
    const sorted = (value) => Float32Array.from(samples, value).sort();
    const middle = [0, 1, 2].map((axis) => sorted((position) => position[axis])[samples.length >> 1]);
    const distances = sorted((position) => Math.hypot(...middle.map((value, axis) => position[axis] - value)));
    return { middle, radius: Math.max(distances[Math.floor(0.9 * (samples.length - 1))], 0.05) };
  }

  /** Least and greatest height along `up`, metres; a few strays may be beyond. */
  heights(up) {
    const heights = this.samples().map(({ position }) => position[0] * up[0] + position[1] * up[1] + position[2] * up[2]);
    const sorted = Float32Array.from(heights).sort();
    return [sorted[Math.floor(0.005 * (sorted.length - 1))], sorted[Math.ceil(0.995 * (sorted.length - 1))]];
  }
}

/** Positions are stored as fractions of the map's box. */
function positionsOf(map) {
  const parts = wordsOf(map.positions);
  return Float32Array.from(parts, (part, index) => map.min[index % 3] + (part / 65535) * map.size[index % 3]);
}
