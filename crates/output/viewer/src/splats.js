// Draws the Gaussians of the map as round points with their sizes.

import { BufferAttribute, BufferGeometry, Points, ShaderMaterial } from "three";
import { bytesOf, idsOf, wordsOf } from "./bytes.js";

/** Drawn radius of a Gaussian, in standard deviations; neighbours then form a closed surface. */
const RADIUS_IN_SIGMA = 1.7;
/** Minimum width of a point, pixels, so that none vanishes. */
const MIN_PIXELS = 1.5;
/** Number of sampled points that determine the map's centre and extent. */
const MAX_SAMPLES = 10000;
/** Colour of Gaussians without an object. */
const NO_OBJECT = [128, 128, 128];

const VERTEX = `
  uniform float pixels; // of an extent of one metre at a distance of one metre
  uniform float selected;
  uniform float trueColors;
  uniform float showAdded;
  uniform vec3 ground;
  attribute float radius;
  attribute float object;
  attribute float added;
  attribute vec3 objectColor;
  attribute vec3 trueColor;
  varying vec3 tint;
  void main() {
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    gl_Position = projectionMatrix * seen;
    if (added > showAdded) gl_Position = vec4(0.0, 0.0, 2.0, 1.0); // outside of the view
    gl_PointSize = clamp(2.0 * radius * pixels / max(-seen.z, 1e-3), ${MIN_PIXELS.toFixed(1)}, 400.0);
    tint = mix(objectColor, trueColor, trueColors);
    if (selected > 0.0 && object != selected) tint = mix(vec3(dot(tint, vec3(0.3, 0.6, 0.1))), ground, 0.72);
  }`;
const FRAGMENT = `
  varying vec3 tint;
  void main() {
    vec2 place = 2.0 * gl_PointCoord - 1.0;
    float distance2 = dot(place, place);
    if (distance2 > 1.0) discard;
    gl_FragColor = vec4(tint * (1.0 - 0.12 * distance2), 1.0);
  }`;

export class Splats {
  /** `map` is the run's map, `byId` its objects; those of the set `added` can be hidden. */
  constructor(map, byId, added = new Set()) {
    this.count = map.count;
    this.positions = positionsOf(map);
    this.radii = Float32Array.from(wordsOf(map.radii), (part) => (part / 65535) * map.max_radius * RADIUS_IN_SIGMA);
    this.ids = idsOf(map.ids);
    this.added = Uint8Array.from(this.ids, (id) => Number(added.has(id)));
    const objectColors = new Uint8Array(3 * this.count);
    this.ids.forEach((id, index) => objectColors.set(byId.get(id)?.color ?? NO_OBJECT, 3 * index));
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(this.positions, 3));
    geometry.setAttribute("radius", new BufferAttribute(this.radii, 1));
    geometry.setAttribute("object", new BufferAttribute(Float32Array.from(this.ids), 1));
    geometry.setAttribute("added", new BufferAttribute(this.added, 1));
    geometry.setAttribute("objectColor", new BufferAttribute(objectColors, 3, true));
    geometry.setAttribute("trueColor", new BufferAttribute(bytesOf(map.colors), 3, true));
    this.uniforms = {
      pixels: { value: 1 }, selected: { value: 0 }, trueColors: { value: 0 }, showAdded: { value: 1 }, ground: { value: null },
    };
    const material = new ShaderMaterial({ uniforms: this.uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT });
    this.points = new Points(geometry, material);
    this.points.frustumCulled = false;
  }

  /** Releases the memory of the GPU. */
  dispose() {
    this.points.geometry.dispose();
    this.points.material.dispose();
  }

  /** Shows or hides the added objects. */
  showAdded(wanted) {
    this.uniforms.showAdded.value = Number(wanted);
  }

  /**
   * The object of the nearest Gaussian that covers a pixel, as the shader draws them; 0 for none.
   * `matrix` is from world to clip space (16 numbers, column-major), `x` and `y` are pixels from the top left of a
   * view of `width` × `height` pixels, `pixels` is as in the shader, but in these pixels.
   */
  objectAt(matrix, { x, y, width, height, pixels }) {
    let nearest = { depth: Infinity, id: 0 };
    const m = matrix;
    for (let index = 0; index < this.count; index++) {
      if (this.added[index] > this.uniforms.showAdded.value) continue;
      const [px, py, pz] = [this.positions[3 * index], this.positions[3 * index + 1], this.positions[3 * index + 2]];
      const depth = m[3] * px + m[7] * py + m[11] * pz + m[15];
      if (depth < 0.02 || depth >= nearest.depth) continue;
      const dx = ((m[0] * px + m[4] * py + m[8] * pz + m[12]) / depth + 1) * 0.5 * width - x;
      const dy = (1 - (m[1] * px + m[5] * py + m[9] * pz + m[13]) / depth) * 0.5 * height - y;
      const radius = Math.max((this.radii[index] * pixels) / depth, MIN_PIXELS);
      if (dx * dx + dy * dy <= radius * radius) nearest = { depth, id: this.ids[index] };
    }
    return nearest.id;
  }

  /** Centre of the map, and the radius that contains most of it, metres. */
  extent() {
    const samples = Math.min(this.count, MAX_SAMPLES);
    const sample = (index, axis) => this.positions[3 * Math.floor((index * this.count) / samples) + axis];
    const sorted = (value) => Float32Array.from({ length: samples }, (_, index) => value(index)).sort();
    const middle = [0, 1, 2].map((axis) => sorted((index) => sample(index, axis))[samples >> 1]);
    const distance = (index) => Math.hypot(...middle.map((value, axis) => sample(index, axis) - value));
    return { middle, radius: Math.max(sorted(distance)[Math.floor(0.9 * (samples - 1))], 0.05) };
  }
}

/** Positions are stored as fractions of the map's box. */
function positionsOf(map) {
  const parts = wordsOf(map.positions);
  return Float32Array.from(parts, (part, index) => map.min[index % 3] + (part / 65535) * map.size[index % 3]);
}
