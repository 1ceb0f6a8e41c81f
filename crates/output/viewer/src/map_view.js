// The map in 3D: Gaussians, the camera's path, the camera at the current frame, the box of the selected object.

import { Color, Matrix4, PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { changesOf } from "./change_list.js";
import { firstView } from "./first_view.js";
import { listenToMapKeys } from "./map_keys.js";
import { lines, setLines, unitBox, unitBoxOf } from "./map_lines.js";
import { showScale } from "./map_scale.js";
import { Measure } from "./measure.js";
import { SplatDrawing } from "./splat_drawing.js";
import { Splats } from "./splats.js";

const FIELD_OF_VIEW_DEGREES = 50;
/** Pointer movement, pixels, beyond which a click is a drag. */
const CLICK_PIXELS = 4;
const CAMERA_COLOR = 0xf25c05;
/** The view is widened once the map has grown or moved by this part of its radius, so that it does not move all the time. */
const REFIT_GROWTH = 0.04;
/** A newer up of the run is taken if it differs by more than this angle, radians. */
const UP_ANGLE = 0.02;

export class MapView {
  #run;
  #canvas = document.getElementById("view");
  #stage = document.getElementById("stage");
  #scene = new Scene();
  #follow = false;
  /** For each object that was merged into another one, that one. */
  #into = new Map();
  /** Tells which objects are drawn; null for all. */
  #isShown = null;
  /** True while the map of another run is shown. */
  #isOther = false;
  #frame = 0;
  #drawing;
  #isWaiting = false;
  /** True while something else is shown in its place. */
  #isCovered = false;
  /** True while the camera's pose is unknown. */
  #lost = false;
  /** Called after the user has changed the view. */
  #moved;
  /** True once the user has turned or moved the view. */
  #touched = false;
  /** The extent that the view was last fitted to. */
  #fitted = null;
  /** Part of the map's height above which nothing is drawn. */
  #height = 1;

  /**
   * Throws if the browser has no WebGL. `actions`: `pick(id)` is called with the id that was clicked, 0 for none; `moved()`
   * after the user has changed the view.
   */
  constructor(run, actions) {
    this.#run = run;
    this.renderer = new WebGLRenderer({ canvas: this.#canvas, antialias: true });
    this.#drawing = new SplatDrawing(this.renderer);
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW_DEGREES, 1, 0.02, 1000);
    this.#moved = actions.moved;
    this.#orbit();
    const changes = changesOf(run.changes);
    const added = new Set(changes.flatMap(({ after }) => after?.id ?? []));
    this.splats = this.#splatsOf(run.map, run.byId, added);
    const removed = new Map(changes.flatMap(({ before }) => (before ? [[before.id, before]] : [])));
    this.before = run.changes && this.#splatsOf(run.changes.map_before, removed);
    listenToMapKeys(this.#canvas, () => this.controls, () => {
      this.#touched = true;
      this.#moved?.();
    });
    this.#addLines();
    this.measure = new Measure(this.#scene, () => this.draw());
    if (this.before) this.#addChanges(changes);
    this.#listen(actions.pick);
    this.extent = this.splats.extent();
    this.reset();
    new ResizeObserver(() => (this.#touched || this.#follow ? this.#resize() : this.#fit())).observe(this.#stage);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#paint());
    this.#paint();
  }

  /** Lets the user turn the view around the run's up. */
  #orbit() {
    this.camera.up.fromArray(this.#run.up);
    this.controls = new OrbitControls(this.camera, this.#canvas);
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => (this.#touched = true));
    this.controls.addEventListener("end", () => this.#moved?.());
  }

  /** Takes the run's up, of which a session knows more as it goes on. Returns true if it is another one. */
  #takeUp() {
    if (new Vector3(...this.#run.up).angleTo(this.camera.up) < UP_ANGLE) return false;
    const { target } = this.controls;
    // The controls read up only when they are made.
    this.controls.dispose();
    this.#orbit();
    this.controls.target.copy(target);
    this.controls.update();
    for (const splats of this.#allSplats()) splats.uniforms.up.value.copy(this.camera.up);
    this.cutAbove(this.#height);
    return true;
  }

  /** The Gaussians of a map, as something that is drawn. */
  #splatsOf(map, byId, added, places = this.#run.places()) {
    const splats = new Splats(map, byId, places, added);
    splats.uniforms.up.value = this.camera.up.clone();
    this.#drawing.add(splats);
    return splats;
  }

  /** Schedules a redraw. */
  draw() {
    if (this.#isWaiting || this.#isCovered) return;
    this.#isWaiting = true;
    requestAnimationFrame(() => {
      this.#isWaiting = false;
      this.drawNow();
    });
  }

  /** Stops drawing while something else is shown in its place, or goes on. */
  cover(wanted) {
    this.#isCovered = wanted;
    this.draw();
  }

  /** Draws immediately. */
  drawNow() {
    this.#drawing.draw(this.camera);
    this.renderer.render(this.#scene, this.camera);
    const { clientWidth: width, clientHeight: height } = this.#stage;
    showScale(this.camera, this.#pixelsPerMetre(height) / this.camera.position.distanceTo(this.controls.target));
    this.measure.place(this.camera, width, height);
  }

  /** The map as a PNG file. */
  picture() {
    this.drawNow();
    return new Promise((resolve) => this.#canvas.toBlob(resolve, "image/png"));
  }

  /** Looks at the whole map from above, about in the cameras' viewing direction. */
  reset() {
    this.#touched = false;
    this.#fit();
  }

  /** Level direction in which the cameras looked, a unit vector. */
  #forward() {
    const { up } = this.camera;
    const forward = new Vector3();
    const quaternion = new Quaternion();
    for (const rotation of this.#run.rotations()) {
      forward.add(new Vector3(0, 0, 1).applyQuaternion(quaternion.fromArray(rotation)));
    }
    forward.addScaledVector(up, -forward.dot(up));
    if (forward.length() < 1e-6) forward.set(up.y, up.z, up.x);
    return forward.normalize().toArray();
  }

  /** Fits the whole map into the stage. */
  #fit() {
    const { clientWidth: width, clientHeight: height } = this.#stage;
    const tangent = Math.tan((FIELD_OF_VIEW_DEGREES * Math.PI) / 360);
    const shape = { forward: this.#forward(), up: this.camera.up.toArray(), height: tangent, aspect: width / height || 1 };
    const { position, target } = firstView([...this.splats.samples(), ...this.#run.places().map(shownFromAll)], shape);
    this.#fitted = this.extent;
    this.camera.fov = FIELD_OF_VIEW_DEGREES;
    this.controls.target.fromArray(target);
    this.camera.position.fromArray(position);
    this.#viewChanged();
  }

  /** The view, `[...position, ...target]`, or null as long as it is the first one. */
  get view() {
    return this.#touched ? [...this.camera.position.toArray(), ...this.controls.target.toArray()] : null;
  }

  set view(numbers) {
    this.#touched = true;
    this.camera.position.fromArray(numbers);
    this.controls.target.fromArray(numbers, 3);
    this.#viewChanged();
  }

  /** Shows a newer map in the place of this one. */
  replaceMap(map) {
    const old = this.splats;
    this.splats = this.#splatsOf(map, this.#run.byId);
    for (const [name, uniform] of Object.entries(old.uniforms)) this.splats.uniforms[name].value = uniform.value;
    this.splats.mergeObjects(this.#into, this.#run.byId);
    if (this.#isShown) this.splats.showObjects(this.#isShown);
    this.#drawing.remove(old);
    this.extent = this.splats.extent();
    const { middle, radius } = this.#fitted;
    const moved = new Vector3(...middle).distanceTo(new Vector3(...this.extent.middle));
    const growth = Math.max(moved, this.extent.radius - radius) / radius;
    const isTurned = this.#takeUp();
    if (!this.#touched && !this.#follow && (isTurned || growth > REFIT_GROWTH)) this.#fit();
    else this.#resize();
  }

  /** Shows objects that were merged as the one that they are: `into` has it for each of the others. */
  mergeObjects(into) {
    this.#into = into;
    this.splats.mergeObjects(into, this.#run.byId);
    if (this.#isShown) this.splats.showObjects(this.#isShown);
    this.draw();
  }

  /** Shows the camera's path as it is now. */
  updatePath() {
    setLines(this.path, this.#run.pathSteps());
    this.draw();
  }

  /** Shows the camera's pose at a frame. */
  showFrame(frame) {
    this.#frame = frame;
    const pose = this.#run.poseOf(frame);
    this.#lost = pose === null;
    this.#showFrustum();
    if (this.#lost) return this.draw();
    const { position, quaternion } = pose;
    const { width, height, fx, fy, cx, cy } = this.#run.cameraOf(frame);
    const depth = 0.16 * this.extent.radius;
    // Pixel centres have integer coordinates: the image begins half a pixel before the first centre.
    const corner = (column, row) => [((column - 0.5 - cx) / fx) * depth, ((row - 0.5 - cy) / fy) * depth, depth];
    const corners = [corner(0, 0), corner(width, 0), corner(width, height), corner(0, height)];
    const lines = corners.flatMap((from, index) => [[0, 0, 0], from, from, corners[(index + 1) % 4]]);
    this.frustum.geometry.setPositions(lines.flat());
    this.frustum.position.fromArray(position);
    this.frustum.quaternion.fromArray(quaternion);
    if (this.#follow) this.#lookAsCamera();
    this.draw();
  }

  /** Makes the view follow the camera or stop following it. */
  follow(wanted) {
    this.#follow = wanted;
    this.#showFrustum();
    if (wanted && !this.#lost) this.#lookAsCamera();
    else this.draw();
  }

  showPath(wanted) {
    this.path.visible = wanted;
    this.#showFrustum();
    this.draw();
  }

  #showFrustum() {
    this.frustum.visible = this.path.visible && !this.#follow && !this.#lost;
  }

  /** `true` or `object`. */
  showColors(which) {
    for (const splats of this.#allSplats()) splats.uniforms.trueColors.value = which === "true" ? 1 : 0;
    this.draw();
  }

  /** The map as it is now, `after`, or `before` the changes. */
  showTime(time) {
    this.splats.showAdded(time === "after");
    if (this.before) this.#drawing.show(this.before, time === "before");
    this.draw();
  }

  /** Takes the map of another run, which is shown in the place of this one's. */
  setOther(run) {
    if (this.other) this.#drawing.remove(this.other);
    const min = run.map.min.map((value, axis) => value + run.origin[axis] - this.#run.origin[axis]);
    this.other = this.#splatsOf({ ...run.map, min }, run.byId, new Set(), run.places());
    const { selected, ...others } = this.splats.uniforms;
    for (const [name, uniform] of Object.entries(others)) this.other.uniforms[name].value = uniform.value;
  }

  /** Shows the map of the other run, or this one's. */
  showOther(wanted) {
    this.#isOther = wanted && Boolean(this.other);
    this.#drawing.show(this.splats, !this.#isOther);
    if (this.other) this.#drawing.show(this.other, this.#isOther);
    this.draw();
  }

  /** Shows the objects for which `isShown(id)` is true, and hides the others. */
  showObjects(isShown) {
    this.#isShown = isShown;
    this.splats.showObjects(isShown);
    this.draw();
  }

  /** Leaves out walls and ceilings that are seen from behind, or draws them. */
  cutWalls(wanted) {
    for (const splats of this.#allSplats()) splats.uniforms.cutWalls.value = Number(wanted);
    this.draw();
  }

  /** Leaves out what is above a part of the map's height, from 0 to 1; at 1, nothing. */
  cutAbove(part) {
    this.#height = part;
    const [low, high] = this.splats.heights(this.camera.up.toArray());
    const ceiling = part < 1 ? low + part * (high - low) : 1e6;
    for (const splats of this.#allSplats()) splats.uniforms.ceiling.value = ceiling;
    this.draw();
  }

  /** Shows or hides the boxes of the changes. */
  showChanges(wanted) {
    for (const lines of this.changes ?? []) lines.visible = wanted;
    this.draw();
  }

  /** Highlights an object, or none. */
  mark(id) {
    // Ids of another run are of other objects.
    for (const splats of this.#allSplats()) splats.uniforms.selected.value = splats === this.other ? 0 : id;
    const box = id ? this.#boxOf(id) : null;
    this.box.visible = box !== null;
    if (box) this.box.matrix.copy(box);
    this.draw();
  }

  /** Centres the view on an object, at a distance of at most about three times its size. */
  center(id) {
    this.#centerOn(this.#boxOf(id));
  }

  /** Centres the view on a box of the run's data. */
  centerOn(box) {
    this.#centerOn(this.#matrixOf(box));
  }

  #centerOn(box) {
    if (!box) return;
    this.#touched = true;
    const middle = new Vector3().setFromMatrixPosition(box);
    const size = Math.max(...new Vector3().setFromMatrixScale(box).toArray(), 0.1);
    const back = this.camera.position.clone().sub(this.controls.target);
    back.setLength(Math.min(back.length(), 3 * size + 0.5));
    this.controls.target.copy(middle);
    this.camera.position.copy(middle).add(back);
    this.#viewChanged();
  }

  #boxOf(id) {
    return this.#matrixOf(this.#run.byId.get(id)?.box);
  }

  /** From the unit box to a box of the run's data; `null` without one. */
  #matrixOf(given) {
    if (!given) return null;
    const center = given.center.map((coordinate, axis) => coordinate - this.#run.origin[axis]);
    const size = new Vector3(...given.size);
    return new Matrix4().compose(new Vector3(...center), new Quaternion(...given.rotation), size);
  }

  #lookAsCamera() {
    const { position, quaternion } = this.#run.poseOf(this.#frame);
    const { height, fy } = this.#run.cameraOf(this.#frame);
    this.camera.fov = (2 * Math.atan(height / 2 / fy) * 180) / Math.PI;
    this.camera.position.fromArray(position);
    const forward = new Vector3(0, 0, 1).applyQuaternion(new Quaternion(...quaternion));
    this.controls.target.copy(this.camera.position).add(forward);
    this.#viewChanged();
  }

  #allSplats() {
    return [this.splats, this.before, this.other].filter(Boolean);
  }

  /** The Gaussians at old places, and a box around each place; lines lead from old places to new ones. */
  #addChanges(changes) {
    this.#drawing.show(this.before, false);
    const places = { gone: [], new: [], moved: [] };
    for (const { kind, before, after } of changes) {
      const matrices = [before, after].flatMap((place) => (place ? [this.#matrixOf(place.box)] : []));
      for (const matrix of matrices) places[kind].push(...unitBoxOf(matrix));
      if (matrices.length === 2) {
        for (const matrix of matrices) places[kind].push(...new Vector3().setFromMatrixPosition(matrix).toArray());
      }
    }
    this.changes = Object.entries(places).map(([kind, positions]) => Object.assign(lines(positions, 0), { name: kind }));
    this.#scene.add(...this.changes);
  }

  #addLines() {
    this.path = lines(this.#run.pathSteps(), CAMERA_COLOR);
    this.frustum = lines([], CAMERA_COLOR);
    this.box = lines(unitBox(), 0xffffff);
    this.box.matrixAutoUpdate = false;
    this.box.visible = false;
    this.#scene.add(this.path, this.frustum, this.box);
  }

  #listen(onPick) {
    let pressed = null;
    this.#canvas.addEventListener("pointerdown", (event) => (pressed = { x: event.clientX, y: event.clientY }));
    this.#canvas.addEventListener("pointerup", (event) => {
      const moved = pressed && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y);
      pressed = null;
      if (moved === null || moved > CLICK_PIXELS || event.button !== 0) return;
      const hit = this.#hitAt(event);
      if (!this.measure.isOn) onPick(this.#isOther ? 0 : (hit?.id ?? 0));
      else if (hit) this.measure.add(hit.point);
    });
  }

  #hitAt(event) {
    const { left, top, width, height } = this.#canvas.getBoundingClientRect();
    this.camera.updateMatrixWorld();
    const matrix = this.camera.projectionMatrix.clone().multiply(this.camera.matrixWorldInverse);
    const pixels = this.#pixelsPerMetre(height);
    const view = { x: event.clientX - left, y: event.clientY - top, width, height, pixels };
    return (this.#isOther ? this.other : this.splats).hitAt(matrix.elements, this.camera.position, view);
  }

  /** Size in pixels of one metre at a distance of one metre, in a view of this height. */
  #pixelsPerMetre(height) {
    return height / (2 * Math.tan((this.camera.fov * Math.PI) / 360));
  }

  #viewChanged() {
    this.controls.update();
    this.#resize();
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.#stage;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    const { domElement } = this.renderer;
    this.#drawing.setSize(domElement.width, domElement.height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    const pixels = this.#pixelsPerMetre(domElement.height);
    for (const splats of this.#allSplats()) splats.uniforms.pixels.value = pixels;
    this.draw();
  }

  #paint() {
    const style = getComputedStyle(document.documentElement);
    const ground = new Color().setStyle(style.getPropertyValue("--stage").trim());
    this.renderer.setClearColor(ground);
    // The shader already writes sRGB.
    const { r, g, b } = ground.clone().convertLinearToSRGB();
    this.#drawing.setGround(new Vector3(r, g, b));
    for (const drawn of this.changes ?? []) drawn.material.color.setStyle(style.getPropertyValue(`--${drawn.name}`).trim());
    for (const drawn of [this.box, this.measure.lines]) drawn.material.color.setStyle(style.getPropertyValue("--ink").trim());
    this.draw();
  }
}

/** A place that the first view shows from any side. */
function shownFromAll(position) {
  return { position, facing: [0, 0, 0] };
}
