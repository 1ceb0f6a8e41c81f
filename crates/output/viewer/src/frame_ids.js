// The id of every pixel, at a reduced resolution, loaded on demand in chunks of frames.

import { bytesOf } from "./bytes.js";

/** Chunks kept in memory: those around the current frame and the last places visited. */
const KEPT_CHUNKS = 8;

export class FrameIds {
  #length;
  #chunks = new Map();
  #arrived = new Map();
  #remapped;
  #file;

  /**
   * `length` is the number of frames per chunk. Each of `remapped` is a frame, an id in the frames before it, and the id
   * that it turned out to be. `file` begins the names of the files, each of which calls `callback`.
   */
  constructor(length, remapped = [], { file, callback } = { file: "frames", callback: "splatsegFrames" }) {
    this.#length = length;
    this.#remapped = remapped;
    // Each chunk's script calls this: a page opened from disk may load scripts but not fetch files.
    this.#file = file;
    window[callback] = (chunk, frames) => this.#arrived.set(chunk, frames);
  }

  /** The ids of a frame: `{ width, height, ids }`, `ids` row-major; null if it has none. Rejects if its file cannot be loaded. */
  async of(frame) {
    const chunk = Math.floor(frame / this.#length);
    const frames = await this.#chunk(chunk);
    const found = frames[frame - chunk * this.#length];
    if (!found) return null;
    const [width, height, text] = found;
    return { width, height, ids: this.#final(frame, decode(bytesOf(text), width, height)) };
  }

  /** Replaces the ids of a frame by those that they turned out to be. */
  #final(frame, ids) {
    const final = new Map();
    // The last first, so that chains are followed.
    for (const [found, from, into] of this.#remapped.toReversed()) {
      if (found > frame) final.set(from, final.get(into) ?? into);
    }
    if (final.size === 0) return ids;
    return ids.map((id) => final.get(id) ?? id);
  }

  #chunk(number) {
    const known = this.#chunks.get(number);
    const chunk = known ?? this.#load(number);
    // Reinserted last: the least recently used chunk is removed first.
    this.#chunks.delete(number);
    this.#chunks.set(number, chunk);
    if (this.#chunks.size > KEPT_CHUNKS) this.#chunks.delete(this.#chunks.keys().next().value);
    return chunk;
  }

  #load(number) {
    return new Promise((resolve, reject) => {
      const file = `viewer/${this.#file}-${String(number).padStart(3, "0")}.js`;
      const script = document.createElement("script");
      const end = () => {
        const frames = this.#arrived.get(number);
        this.#arrived.delete(number);
        script.remove();
        if (frames) return resolve(frames);
        this.#chunks.delete(number);
        reject(new Error(`${file} cannot be loaded`));
      };
      script.onload = end;
      script.onerror = end;
      script.src = file;
      document.head.append(script);
    });
  }
}

/**
 * Decodes the ids that `page/ids.rs` encodes: repeatedly, the number of pixels equal to the pixel above, the number of
 * following pixels with one other id, and that id.
 */
export function decode(bytes, width, height) {
  let at = 0;
  const number = () => {
    let value = 0;
    for (let shift = 0; at < bytes.length; shift += 7) {
      const byte = bytes[at++];
      value |= (byte & 127) << shift;
      if (byte < 128) break;
    }
    return value;
  };
  const ids = new Uint32Array(width * height);
  let pixel = 0;
  while (pixel < ids.length && at < bytes.length) {
    const same = Math.min(pixel + number(), ids.length);
    for (; pixel < same; pixel++) ids[pixel] = pixel < width ? 0 : ids[pixel - width];
    const end = Math.min(pixel + number(), ids.length);
    ids.fill(number(), pixel, end);
    pixel = end;
  }
  return ids;
}
