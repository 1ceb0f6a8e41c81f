// Draws Gaussians as soft spots that blend into surfaces.
//
// First, the depth of the nearest surface is drawn, moved a little away from the eye. Then, all Gaussians in front of it
// are added up with their weights, and the sum is divided by that of the weights: no sorting is needed. This is surface
// splatting (Botsch and others, 2005) with round splats.

import {
  Color, CustomBlending, HalfFloatType, Mesh, NearestFilter, OneFactor, OrthographicCamera, PlaneGeometry, Points, Scene, ShaderMaterial,
  WebGLRenderTarget,
} from "three";
import { BLENDED_RADII, MIN_PIXELS, OPAQUE_PART, RADIUS_IN_SIGMA } from "./splats.js";

/** Part of their colour that other objects lose while one is selected. */
const DIMMED = 0.62;

const number = (value) => value.toFixed(4);

const VERTEX = `
  uniform float pixels; // of an extent of one metre at a distance of one metre
  uniform float selected;
  uniform float trueColors;
  uniform float showAdded;
  uniform float cutWalls;
  uniform float ceiling;
  uniform vec3 up;
  uniform vec3 ground;
  attribute float radius;
  attribute float object;
  attribute float added;
  attribute float shown;
  attribute vec3 facing;
  attribute vec3 objectColor;
  attribute vec3 trueColor;
  varying vec3 tint;
  void main() {
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    float size = 2.0 * radius * pixels / max(-seen.z, 1e-3);
    #ifdef DEPTH
      seen.xyz *= 1.0 + ${number(BLENDED_RADII)} * radius / max(length(seen.xyz), 1e-3);
    #endif
    gl_Position = projectionMatrix * seen;
    bool isSelected = selected > 0.0 && object == selected;
    bool isHidden = added > showAdded || shown < 0.5 || dot(position, up) > ceiling;
    bool isBehind = cutWalls > 0.5 && !isSelected && dot(facing, cameraPosition - position) < 0.0;
    if (isHidden || isBehind) gl_Position = vec4(0.0, 0.0, 2.0, 1.0); // outside of the view
    gl_PointSize = clamp(size, ${number(MIN_PIXELS)}, 400.0);
    tint = mix(objectColor, trueColor, trueColors);
    if (selected > 0.0 && !isSelected) tint = mix(tint, ground, ${number(DIMMED)});
  }`;
const FRAGMENT = `
  varying vec3 tint;
  void main() {
    vec2 place = 2.0 * gl_PointCoord - 1.0;
    float distance2 = dot(place, place);
    #ifdef WEIGHTED
      if (distance2 > 1.0) discard;
      float weight = exp(${number(-0.5 * RADIUS_IN_SIGMA ** 2)} * distance2);
      gl_FragColor = vec4(tint * weight, weight);
    #else
      if (distance2 > ${number(OPAQUE_PART ** 2)}) discard;
      gl_FragColor = vec4(tint, 1.0);
    #endif
  }`;
const COMPOSE = `
  uniform sampler2D sums;
  uniform vec3 ground;
  void main() {
    vec4 sum = texelFetch(sums, ivec2(gl_FragCoord.xy), 0);
    // The edge of a surface fades.
    float cover = smoothstep(0.05, 0.25, sum.a);
    gl_FragColor = vec4(mix(ground, sum.rgb / max(sum.a, 1e-4), cover), 1.0);
  }`;

export class SplatDrawing {
  #renderer;
  #depth = new Scene();
  #weighted = new Scene();
  #compose = new Scene();
  #flatCamera = new OrthographicCamera(-1, 1, 1, -1, 0, 1);
  #drawn = new Map();
  #clearColor = new Color();
  /** Sums of colours and weights; null if the browser cannot add half floats, and opaque discs are drawn instead. */
  #target = null;

  constructor(renderer) {
    this.#renderer = renderer;
    renderer.autoClear = false;
    const canAdd = ["EXT_color_buffer_float", "EXT_color_buffer_half_float"].some((name) => renderer.extensions.has(name));
    if (!canAdd) return;
    this.#target = new WebGLRenderTarget(1, 1, { type: HalfFloatType, minFilter: NearestFilter, magFilter: NearestFilter });
    const uniforms = { sums: { value: this.#target.texture }, ground: { value: null } };
    const vertexShader = "void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }";
    const material = new ShaderMaterial({ uniforms, vertexShader, fragmentShader: COMPOSE, depthTest: false, depthWrite: false });
    this.composed = new Mesh(new PlaneGeometry(2, 2), material);
    this.composed.frustumCulled = false;
    this.#compose.add(this.composed);
  }

  /** Adds Gaussians. */
  add(splats) {
    const { geometry, uniforms } = splats;
    const material = (defines, more) => new ShaderMaterial({ uniforms, defines, vertexShader: VERTEX, fragmentShader: FRAGMENT, ...more });
    const added = { blending: CustomBlending, blendSrc: OneFactor, blendDst: OneFactor, transparent: true, depthWrite: false };
    const points = [
      new Points(geometry, this.#target ? material({ DEPTH: 1 }, { colorWrite: false }) : material({}, {})),
      new Points(geometry, material({ WEIGHTED: 1 }, added)),
    ];
    for (const drawn of points) drawn.frustumCulled = false;
    this.#depth.add(points[0]);
    if (this.#target) this.#weighted.add(points[1]);
    this.#drawn.set(splats, points);
  }

  /** Removes Gaussians, and releases their memory. */
  remove(splats) {
    for (const points of this.#drawn.get(splats)) {
      points.removeFromParent();
      points.material.dispose();
    }
    this.#drawn.delete(splats);
    splats.dispose();
  }

  /** Shows or hides Gaussians. */
  show(splats, wanted) {
    for (const points of this.#drawn.get(splats)) points.visible = wanted;
  }

  /** Sets the size of the canvas, pixels. */
  setSize(width, height) {
    this.#target?.setSize(width, height);
  }

  /** Sets the colour of the ground, sRGB from 0 to 1. */
  setGround(ground) {
    for (const splats of this.#drawn.keys()) splats.uniforms.ground.value = ground;
    if (this.composed) this.composed.material.uniforms.ground.value = ground;
  }

  /** Draws all Gaussians as the camera sees them. */
  draw(camera) {
    const renderer = this.#renderer;
    renderer.clear();
    if (!this.#target) return renderer.render(this.#depth, camera);
    const alpha = renderer.getClearAlpha();
    renderer.setRenderTarget(this.#target);
    const color = renderer.getClearColor(this.#clearColor);
    renderer.setClearColor(0, 0);
    renderer.clear();
    renderer.render(this.#depth, camera);
    renderer.render(this.#weighted, camera);
    renderer.setRenderTarget(null);
    renderer.setClearColor(color, alpha);
    renderer.render(this.#compose, this.#flatCamera);
  }
}
