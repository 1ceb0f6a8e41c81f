// The map in 3D: Gaussians, the camera's path, the camera at the current frame, the box of the selected object.

import { Color, Matrix4, PerspectiveCamera, Quaternion, Scene, Vector3, WebGLRenderer } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import { changesOf } from "./change_list.js";
import { Splats } from "./splats.js";

const FIELD_OF_VIEW_DEGREES = 50;
/** Pointer movement, pixels, beyond which a click is a drag. */
const CLICK_PIXELS = 4;
const CAMERA_COLOR = 0xf25c05;
const LINE_PIXELS = 2;
/** The view is widened once the map has grown or moved by this part of its radius, so that it does not move all the time. */
const REFIT_GROWTH = 0.1;

export class MapView {
  #run;
  #canvas = document.getElementById("view");
  #stage = document.getElementById("stage");
  #scene = new Scene();
  #follow = false;
  #frame = 0;
  #drawing = false;
  /** True while the camera's pose is unknown. */
  #lost = false;
  /** True once the user has turned or moved the view. */
  #touched = false;
  /** The extent that the view was last fitted to. */
  #fitted = null;

  /** Throws if the browser has no WebGL. `onPick` is called with the id that was clicked, 0 for none. */
  constructor(run, onPick) {
    this.#run = run;
    this.renderer = new WebGLRenderer({ canvas: this.#canvas, antialias: false });
    const changes = changesOf(run.changes);
    const added = new Set(changes.flatMap(({ after }) => after?.id ?? []));
    this.splats = new Splats(run.map, run.byId, added);
    const removed = new Map(changes.flatMap(({ before }) => (before ? [[before.id, before]] : [])));
    this.before = run.changes && new Splats(run.changes.map_before, removed);
    this.camera = new PerspectiveCamera(FIELD_OF_VIEW_DEGREES, 1, 0.02, 1000);
    this.camera.up.fromArray(run.up);
    this.controls = new OrbitControls(this.camera, this.#canvas);
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => (this.#touched = true));
    this.#addLines();
    this.#scene.add(this.splats.points);
    if (this.before) this.#addChanges(changes);
    this.#listen(onPick);
    this.extent = this.splats.extent();
    this.reset();
    new ResizeObserver(() => this.#resize()).observe(this.#stage);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#paint());
    this.#paint();
  }

  /** Schedules a redraw. */
  draw() {
    if (this.#drawing) return;
    this.#drawing = true;
    requestAnimationFrame(() => {
      this.#drawing = false;
      this.drawNow();
    });
  }

  /** Draws immediately. */
  drawNow() {
    this.renderer.render(this.#scene, this.camera);
  }

  /** Looks at the whole map from above, in the cameras' viewing direction. */
  reset() {
    const up = new Vector3(...this.#run.up);
    const forward = new Vector3();
    const quaternion = new Quaternion();
    for (const rotation of this.#run.rotations()) {
      forward.add(new Vector3(0, 0, 1).applyQuaternion(quaternion.fromArray(rotation)));
    }
    forward.addScaledVector(up, -forward.dot(up));
    if (forward.length() < 1e-6) forward.set(up.y, up.z, up.x);
    forward.normalize();
    this.#touched = false;
    this.#fitted = this.extent;
    const { middle, radius } = this.extent;
    this.camera.fov = FIELD_OF_VIEW_DEGREES;
    this.controls.target.fromArray(middle);
    this.camera.position.fromArray(middle).addScaledVector(forward, -1.9 * radius).addScaledVector(up, 1.35 * radius);
    this.#viewChanged();
  }

  /** Shows a newer map in the place of this one. */
  replaceMap(map) {
    const old = this.splats;
    this.splats = new Splats(map, this.#run.byId);
    for (const [name, uniform] of Object.entries(old.uniforms)) this.splats.uniforms[name].value = uniform.value;
    this.#scene.remove(old.points);
    this.#scene.add(this.splats.points);
    old.dispose();
    this.extent = this.splats.extent();
    const { middle, radius } = this.#fitted;
    const moved = new Vector3(...middle).distanceTo(new Vector3(...this.extent.middle));
    const growth = Math.max(moved, this.extent.radius - radius) / radius;
    if (!this.#touched && !this.#follow && growth > REFIT_GROWTH) this.#refit();
    else this.#resize();
  }

  /** Shows the whole of a map that has grown, from the same direction. */
  #refit() {
    const { middle, radius } = this.extent;
    const wider = radius / this.#fitted.radius;
    const back = this.camera.position.clone().sub(this.controls.target).multiplyScalar(wider);
    this.#fitted = this.extent;
    this.controls.target.fromArray(middle);
    this.camera.position.fromArray(middle).add(back);
    this.#viewChanged();
  }

  /** Shows the camera's path as it is now. */
  updatePath() {
    const { path } = this;
    // The number of pieces is fixed in a geometry.
    path.geometry.dispose();
    path.geometry = new LineSegmentsGeometry().setPositions(this.#run.pathSteps());
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
    if (this.before) this.before.points.visible = time === "before";
    this.draw();
  }

  /** Shows or hides the boxes of the changes. */
  showChanges(wanted) {
    for (const lines of this.changes ?? []) lines.visible = wanted;
    this.draw();
  }

  /** Highlights an object, or none. */
  mark(id) {
    for (const splats of this.#allSplats()) splats.uniforms.selected.value = id;
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
    return this.before ? [this.splats, this.before] : [this.splats];
  }

  /** The Gaussians at old places, and a box around each place; lines lead from old places to new ones. */
  #addChanges(changes) {
    this.before.points.visible = false;
    this.#scene.add(this.before.points);
    const places = { gone: [], new: [], moved: [] };
    for (const { kind, before, after } of changes) {
      const matrices = [before, after].flatMap((place) => (place ? [this.#matrixOf(place.box)] : []));
      for (const matrix of matrices) places[kind].push(...unitBoxOf(matrix));
      if (matrices.length === 2) {
        for (const matrix of matrices) places[kind].push(...new Vector3().setFromMatrixPosition(matrix).toArray());
      }
    }
    this.changes = Object.entries(places).map(([kind, positions]) => Object.assign(lines(positions, 0), { name: kind }));
    for (const drawn of this.changes) {
      drawn.frustumCulled = false;
      drawn.renderOrder = 1;
      this.#scene.add(drawn);
    }
  }

  #addLines() {
    this.path = lines(this.#run.pathSteps(), CAMERA_COLOR);
    this.frustum = lines([], CAMERA_COLOR);
    this.box = lines(unitBox(), 0xffffff);
    this.box.matrixAutoUpdate = false;
    this.box.visible = false;
    for (const drawn of [this.path, this.frustum, this.box]) {
      drawn.frustumCulled = false;
      drawn.renderOrder = 1;
      this.#scene.add(drawn);
    }
  }

  #listen(onPick) {
    let pressed = null;
    this.#canvas.addEventListener("pointerdown", (event) => (pressed = { x: event.clientX, y: event.clientY }));
    this.#canvas.addEventListener("pointerup", (event) => {
      const moved = pressed && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y);
      pressed = null;
      if (moved !== null && moved <= CLICK_PIXELS && event.button === 0) onPick(this.#objectAt(event));
    });
  }

  #objectAt(event) {
    const { left, top, width, height } = this.#canvas.getBoundingClientRect();
    this.camera.updateMatrixWorld();
    const matrix = this.camera.projectionMatrix.clone().multiply(this.camera.matrixWorldInverse);
    const pixels = this.#pixelsPerMetre(height);
    return this.splats.objectAt(matrix.elements, { x: event.clientX - left, y: event.clientY - top, width, height, pixels });
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
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    const pixels = this.#pixelsPerMetre(this.renderer.domElement.height);
    for (const splats of this.#allSplats()) splats.uniforms.pixels.value = pixels;
    this.draw();
  }

  #paint() {
    const style = getComputedStyle(document.documentElement);
    const ground = new Color().setStyle(style.getPropertyValue("--stage").trim());
    this.renderer.setClearColor(ground);
    // The shader already writes sRGB.
    const { r, g, b } = ground.clone().convertLinearToSRGB();
    for (const splats of this.#allSplats()) splats.uniforms.ground.value = new Vector3(r, g, b);
    for (const drawn of this.changes ?? []) drawn.material.color.setStyle(style.getPropertyValue(`--${drawn.name}`).trim());
    this.box.material.color.setStyle(style.getPropertyValue("--ink").trim());
    this.draw();
  }
}

/** Lines that show through the map: a room's walls would otherwise hide a path inside it. */
function lines(positions, color) {
  const material = new LineMaterial({ color, linewidth: LINE_PIXELS, depthTest: false, transparent: true });
  return new LineSegments2(new LineSegmentsGeometry().setPositions(positions), material);
}

/** The edges of the unit box after a transform. */
function unitBoxOf(matrix) {
  const edges = unitBox();
  const corner = new Vector3();
  for (let start = 0; start < edges.length; start += 3) corner.fromArray(edges, start).applyMatrix4(matrix).toArray(edges, start);
  return edges;
}

/** The twelve edges of the box from -0.5 to 0.5. */
function unitBox() {
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
