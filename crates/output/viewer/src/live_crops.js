// Small pictures of the objects of a run that goes on, cut out of its frames.

/** Size of a crop, pixels. */
const SIZE = [112, 88];
/** A crop is replaced once the object is larger by this factor. */
const LARGER = 1.5;
/** Smaller objects have no crop, pixels. */
const MIN_PIXELS = 60;
/** At most this many are made per frame, so that frames do not wait. */
const PER_FRAME = 6;

export class LiveCrops {
  /** By id: the object's area in the frame of its crop, pixels, and the crop's URL. */
  #crops = new Map();
  #canvas = Object.assign(document.createElement("canvas"), { width: SIZE[0], height: SIZE[1] });

  /** The URL of an object's crop; null if there is none yet. */
  of(id) {
    return this.#crops.get(id)?.url ?? null;
  }

  /** Cuts out the objects that a frame shows better than those before. Returns true if there are new crops. */
  add(image, { width, height, ids }) {
    const better = [...boxesOf(ids, width)].filter(([id, { area }]) => area >= Math.max(MIN_PIXELS, LARGER * (this.#crops.get(id)?.area ?? 0)));
    // Those without a crop first.
    better.sort(([one], [other]) => this.#crops.has(one) - this.#crops.has(other));
    for (const [id, box] of better.slice(0, PER_FRAME)) {
      this.#crops.set(id, { area: box.area, url: this.#cut(image, box, image.naturalWidth / width, image.naturalHeight / height) });
    }
    return better.length > 0;
  }

  /** Cuts out a box with some of its surroundings, in the shape of a crop. */
  #cut(image, { left, right, top, bottom }, across, down) {
    const middle = [((left + right + 1) / 2) * across, ((top + bottom + 1) / 2) * down];
    const whole = [image.naturalWidth, image.naturalHeight];
    const wanted = 1.15 * Math.max(((right - left + 1) * across) / SIZE[0], ((bottom - top + 1) * down) / SIZE[1]);
    const scale = Math.min(wanted, whole[0] / SIZE[0], whole[1] / SIZE[1]);
    const size = SIZE.map((side) => side * scale);
    const corner = middle.map((place, axis) => Math.min(Math.max(place - size[axis] / 2, 0), whole[axis] - size[axis]));
    const context = this.#canvas.getContext("2d");
    context.drawImage(image, ...corner, ...size, 0, 0, ...SIZE);
    return this.#canvas.toDataURL("image/jpeg", 0.8);
  }
}

/** Area and box of each object, pixels. */
function boxesOf(ids, width) {
  const boxes = new Map();
  for (let index = 0; index < ids.length; index++) {
    const id = ids[index];
    if (!id) continue;
    const [x, y] = [index % width, Math.floor(index / width)];
    const box = boxes.get(id);
    if (!box) {
      boxes.set(id, { area: 1, left: x, right: x, top: y, bottom: y });
      continue;
    }
    box.area++;
    box.left = Math.min(box.left, x);
    box.right = Math.max(box.right, x);
    box.bottom = y;
  }
  return boxes;
}
