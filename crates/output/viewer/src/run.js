// The run shown by the page, from `viewer/run.js`.

import { floatsOf } from "./bytes.js";

/** Numbers per pose: position (x, y, z), then the rotation as a quaternion (x, y, z, w), from camera to world. */
const POSE_NUMBERS = 7;

export class Run {
  /** The objects as the run has found them. */
  #found;
  /** For each object that was merged into another one, that one. */
  into = new Map();

  constructor(data) {
    this.scene = data.scene;
    this.version = data.version;
    this.framesPerChunk = data.frames_per_chunk;
    this.names = data.frames;
    /** Timestamps of the frames, seconds; null where a frame has none. */
    this.stamps = data.stamps ?? null;
    this.remapped = data.remapped ?? [];
    this.cameras = data.cameras;
    this.up = data.up;
    /** Origin of the coordinates of poses and map, world coordinates. */
    this.origin = data.origin;
    this.map = data.map;
    /** The floor plan; null if the map shows no floor. */
    this.plan = data.plan ?? null;
    /** What has changed since the loaded map; null without one. */
    this.changes = data.changes ?? null;
    this.#found = data.objects;
    this.setObjects(data.objects);
    this.poses = floatsOf(data.poses);
  }

  setObjects(objects) {
    this.objects = objects;
    this.byId = new Map(objects.map((object) => [object.id, object]));
  }

  /** Changes the objects as a person did. */
  edit(edits) {
    const { objects, into } = edits.applied(this.#found);
    this.into = into;
    this.setObjects(objects);
  }

  get frameCount() {
    return this.names.length;
  }

  /** The intrinsics of a frame's camera. */
  cameraOf(frame) {
    return this.cameras.findLast((camera) => camera.from <= frame) ?? this.cameras[0];
  }

  /** `{ position: [x, y, z], quaternion: [x, y, z, w] }`, from camera to world. */
  poseOf(frame) {
    const start = frame * POSE_NUMBERS;
    const position = this.poses.subarray(start, start + 3);
    return { position, quaternion: this.poses.subarray(start + 3, start + POSE_NUMBERS) };
  }

  /** Ends of the pieces of the camera's path: six coordinates per piece. */
  pathSteps() {
    const steps = [];
    for (let frame = 1; frame < this.frameCount; frame++) {
      steps.push(...this.poseOf(frame - 1).position, ...this.poseOf(frame).position);
    }
    return steps;
  }

  /** Places of the camera in all frames, `[x, y, z]`. */
  places() {
    return this.names.map((_, frame) => Array.from(this.poseOf(frame).position));
  }

  /** Rotations of the camera in all frames. */
  rotations() {
    return this.names.map((_, frame) => this.poseOf(frame).quaternion);
  }
}
