// Files that the page makes from its data: the map as PLY, the objects as CSV, a picture of the map as PNG.

import { byElementId } from "./element.js";

/** Connects the buttons. `mapOf()` may be missing, and so may the changes by hand. */
export function listenToDownloads(run, mapOf, edits = null) {
  const name = () => (run.scene.split(/[\\/]/).filter(Boolean).pop() ?? "").replace(/[^\w.-]+/g, "_") || "splatseg";
  const onClick = (id, make) => byElementId(id).addEventListener("click", async () => {
    byElementId("downloads").open = false;
    const [data, ending] = await make();
    save(data, `${name()}${ending}`);
  });
  onClick("save-ply", () => [plyOf(run, mapOf()), ".ply"]);
  onClick("save-csv", () => [csvOf(run.objects), "-objects.csv"]);
  onClick("save-png", async () => [await mapOf().picture(), ".png"]);
  onClick("save-edits", () => [edits.lines, "-changes.csv"]);
  byElementId("downloads").addEventListener("toggle", () => {
    byElementId("save-edits").hidden = !edits?.last;
    for (const id of ["save-ply", "save-png"]) byElementId(id).disabled = !mapOf();
  });
}

function save(data, file) {
  const url = URL.createObjectURL(data instanceof Blob ? data : new Blob([data]));
  const link = document.createElement("a");
  Object.assign(link, { href: url, download: file });
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

/**
 * The Gaussians that are drawn, as a binary PLY file: place in world coordinates (metres), the map's colour (sRGB), object
 * id, standard deviation (metres).
 */
export function plyOf(run, map) {
  const { splats } = map;
  const drawn = Array.from({ length: splats.count }, (_, index) => index).filter((index) => splats.shown[index]);
  const header = [
    "ply", "format binary_little_endian 1.0", `element vertex ${drawn.length}`,
    ...["x", "y", "z"].map((axis) => `property double ${axis}`), ...["red", "green", "blue"].map((color) => `property uchar ${color}`),
    "property uint object", "property float radius", "end_header", "",
  ].join("\n");
  const size = 3 * 8 + 3 + 4 + 4;
  const body = new DataView(new ArrayBuffer(size * drawn.length));
  drawn.forEach((index, place) => {
    const at = place * size;
    for (let axis = 0; axis < 3; axis++) {
      body.setFloat64(at + 8 * axis, splats.positions[3 * index + axis] + run.origin[axis], true);
      body.setUint8(at + 24 + axis, splats.colors[3 * index + axis]);
    }
    body.setUint32(at + 27, splats.ids[index], true);
    body.setFloat32(at + 31, splats.sigmaOf(index), true);
  });
  return new Blob([header, body]);
}

/** The objects as CSV. Fields that a run does not have are empty. */
export function csvOf(objects) {
  const triple = (name, unit) => ["x", "y", "z"].map((axis) => `${name}_${axis}_${unit}`);
  const header = ["id", "label", "frames", "first_frame", "last_frame", "largest_px", "confidence", "gaussians", ...triple("centroid", "m"), ...triple("size", "m")];
  const lines = objects.map((object) => {
    const { id, label, frames, seen, area, confidence, gaussians, centroid, box } = object;
    const three = (numbers) => numbers ?? ["", "", ""];
    return [id, label, frames, seen[0]?.[0], seen.at(-1)?.[1], area, confidence, gaussians, ...three(centroid), ...three(box?.size)];
  });
  return [header, ...lines].map((fields) => fields.map(field).join(",")).join("\n") + "\n";
}

function field(value) {
  const text = String(value ?? "");
  return /[",\n\r]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
