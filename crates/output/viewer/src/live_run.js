// A run that goes on: what is known of it so far.

import { floatsOf } from "./bytes.js";

/** Maximum number of places of the camera. Beyond it, every second one is removed. */
const MAX_PLACES = 8192;
/** Maximum number of rotations of the camera for the first view of the map. */
const MAX_ROTATIONS = 512;

export class LiveRun {
  scene = "";
  version = "";
  /** Differs between servers. */
  session = "";
  /** Origin of the coordinates of poses and map, world coordinates. */
  origin = [0, 0, 0];
  /** Up in the world, a unit vector: that of the newest map. */
  up = [0, 0, 1];
  map = null;
  /** The floor plan; null if there is none yet. */
  plan = null;
  changes = null;
  objects = [];
  /** For each object that was merged into another one, that one: maps and frames that are under way have the old ids. */
  into = new Map();
  byId = new Map();
  frameCount = 0;
  /** Frames have no names here that parts of the page could go to. */
  names = [];
  #camera = null;
  #pose = null;
  /** Places of the camera, `[x, y, z]`; null where it was lost. */
  #places = [];
  /** Number of frames whose places were in the server's first message. */
  #greeted = 0;
  #rotations = [];

  /** Starts again with a server's first message. */
  greet({ scene, session, version, origin, path, frames }) {
    [this.scene, this.session, this.version, this.origin, this.#greeted] = [scene, session, version, origin, frames];
    const numbers = floatsOf(path);
    this.#places = Array.from({ length: numbers.length / 3 }, (_, place) => {
      const point = [...numbers.subarray(3 * place, 3 * place + 3)];
      return point.every(Number.isFinite) ? point : null;
    });
  }

  /** Records a frame's camera. */
  addFrame({ index, number, camera, origin, pose }) {
    this.frameCount = Math.max(this.frameCount, number + 1);
    this.#camera = camera;
    this.#pose = pose && { position: pose.slice(0, 3), quaternion: pose.slice(3) };
    this.origin = origin;
    // The first frame may be older than the server's first message.
    if (index >= this.#greeted) this.#places.push(this.#pose?.position ?? null);
    if (this.#places.length > MAX_PLACES) this.#places = this.#places.filter((_, place) => place % 2 === 0);
    if (pose) this.#rotations.push(this.#pose.quaternion);
    if (this.#rotations.length > MAX_ROTATIONS) this.#rotations = this.#rotations.filter((_, place) => place % 2 === 0);
  }

  /**
   * `spans` of an object are when it was seen, `[first, last]`, seconds since the first frame. `frames` is the number of frames
   * until then: the picture may be of an earlier one.
   */
  setObjects(objects, frames = 0) {
    this.frameCount = Math.max(this.frameCount, frames);
    // Frames that the page could go to are not kept. A list may be older than a merge.
    this.objects = objects.filter(({ id }) => !this.into.has(id)).map((object) => ({ ...object, seen: [] }));
    this.byId = new Map(this.objects.map((object) => [object.id, object]));
  }

  /** The objects as rows of a timeline. */
  rows() {
    return this.objects.map((object) => ({ ...object, seen: object.spans }));
  }

  /** Objects were merged into one. */
  merge({ ids, into }) {
    for (const id of ids.filter((id) => id !== into)) {
      for (const [from, to] of this.into) if (to === id) this.into.set(from, into);
      this.into.set(id, into);
    }
  }

  /** The newest camera's intrinsics. */
  cameraOf() {
    return this.#camera;
  }

  /** The newest pose; null if the camera is lost. */
  poseOf() {
    return this.#pose;
  }

  pathSteps() {
    const steps = [];
    for (let place = 1; place < this.#places.length; place++) {
      const [from, to] = [this.#places[place - 1], this.#places[place]];
      if (from && to) steps.push(...from, ...to);
    }
    return steps;
  }

  places() {
    return this.#places.filter((place) => place !== null);
  }

  rotations() {
    return this.#rotations;
  }
}
