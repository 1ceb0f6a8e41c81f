// Which way walls, ceilings and floors face: the side from which the camera saw them.

/** Side of a cell of the grid on which planes are sought, metres. */
const CELL_M = 0.1;
/** A cell is flat if its points lie this close to a plane, relative to their spread along it (variances). */
const FLATNESS = 0.08;
/** Fewest points around a cell that make a plane. */
const MIN_POINTS = 8;
/** Least cosine between neighbouring cells of one surface. */
const SAME_SURFACE = 0.9;
/** Smaller surfaces belong to furniture, which may be seen from behind, square metres. */
const MIN_AREA_M2 = 1;
/** Corners and things on a wall face as it does up to this many cells away. */
const REACH = 3;
/** Maximum number of places of the camera that are looked at. */
const MAX_PLACES = 64;
/** Cells per axis have numbers below this, so that a cell has one number. */
const SPAN = 4096;

/**
 * Returns for each point (x, y, z in `positions`) the unit vector that its wall, ceiling or floor faces, and zeros for
 * points of other things. `places` are places of the camera, `[x, y, z]`, in the same coordinates.
 */
export function facingOf(positions, places) {
  const facing = new Float32Array(positions.length);
  const step = Math.max(1, Math.ceil(places.length / MAX_PLACES));
  const cameras = places.filter((_, place) => place % step === 0);
  if (cameras.length === 0) return facing;
  const { cells, cellOf } = gridOf(positions);
  for (const [number, cell] of cells) cell.normal = planeOf(cells, number);
  for (const cell of cells.values()) if (cell.normal) turnTo(cell, cameras);
  markSurfaces(cells);
  for (const cell of cells.values()) if (cell.large) cell.direction = cell.normal;
  for (let step = 0; step < REACH; step++) spread(cells);
  for (let index = 0; index < cellOf.length; index++) {
    const { direction } = cells.get(cellOf[index]);
    if (direction) facing.set(direction, 3 * index);
  }
  return facing;
}

/** The cells by their number, with sums over their points: count, x, y, z, xx, xy, xz, yy, yz, zz. */
function gridOf(positions) {
  const cells = new Map();
  const cellOf = new Float64Array(positions.length / 3);
  const low = [Infinity, Infinity, Infinity];
  for (let at = 0; at < positions.length; at++) low[at % 3] = Math.min(low[at % 3], positions[at]);
  for (let index = 0; index < cellOf.length; index++) {
    const [x, y, z] = [0, 1, 2].map((axis) => positions[3 * index + axis] - low[axis]);
    const side = (value) => Math.min(Math.floor(value / CELL_M) + 2, SPAN - 3);
    const number = (side(x) * SPAN + side(y)) * SPAN + side(z);
    cellOf[index] = number;
    let cell = cells.get(number);
    if (!cell) cells.set(number, (cell = { sums: new Float64Array(10), low, normal: null, large: false, direction: null }));
    [1, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z].forEach((value, at) => (cell.sums[at] += value));
  }
  return { cells, cellOf };
}

/** Calls `visit(cell, number)` for the cells around one, itself among them. */
function around(cells, number, visit) {
  for (let x = -1; x <= 1; x++) {
    for (let y = -1; y <= 1; y++) {
      for (let z = -1; z <= 1; z++) {
        const other = number + (x * SPAN + y) * SPAN + z;
        const cell = cells.get(other);
        if (cell) visit(cell, other);
      }
    }
  }
}

/** Unit normal of the plane through the points in and around a cell; null if they are not flat. */
function planeOf(cells, number) {
  const sums = new Float64Array(10);
  around(cells, number, (cell) => cell.sums.forEach((value, at) => (sums[at] += value)));
  const [count, x, y, z] = sums;
  if (count < MIN_POINTS) return null;
  const [mx, my, mz] = [x / count, y / count, z / count];
  const [xx, xy, xz, yy, yz, zz] = sums.subarray(4).map((value) => value / count);
  const matrix = [
    [xx - mx * mx, xy - mx * my, xz - mx * mz],
    [xy - mx * my, yy - my * my, yz - my * mz],
    [xz - mx * mz, yz - my * mz, zz - mz * mz],
  ];
  const { normal, least, middle } = leastDirection(matrix);
  return least <= FLATNESS * middle ? normal : null;
}

/** Eigenvector of the least eigenvalue of a symmetric matrix, and its two least eigenvalues, by Jacobi rotations. */
function leastDirection(a) {
  const v = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  for (let sweep = 0; sweep < 6; sweep++) {
    for (const [p, q] of [[0, 1], [0, 2], [1, 2]]) {
      if (Math.abs(a[p][q]) < 1e-15) continue;
      const half = (a[q][q] - a[p][p]) / (2 * a[p][q]);
      const t = (half < 0 ? -1 : 1) / (Math.abs(half) + Math.hypot(half, 1));
      const [c, s] = [1 / Math.hypot(t, 1), t / Math.hypot(t, 1)];
      for (let k = 0; k < 3; k++) [a[k][p], a[k][q]] = [c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]];
      for (let k = 0; k < 3; k++) [a[p][k], a[q][k]] = [c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]];
      for (let k = 0; k < 3; k++) [v[k][p], v[k][q]] = [c * v[k][p] - s * v[k][q], s * v[k][p] + c * v[k][q]];
    }
  }
  const [least, middle] = [0, 1, 2].sort((one, other) => a[one][one] - a[other][other]);
  return { normal: v.map((row) => row[least]), least: a[least][least], middle: a[middle][middle] };
}

/** Turns a cell's normal to the side of the cameras; near ones count more. */
function turnTo(cell, cameras) {
  const { sums, low, normal } = cell;
  let side = 0;
  for (const camera of cameras) {
    const to = [0, 1, 2].map((axis) => camera[axis] - low[axis] - sums[1 + axis] / sums[0]);
    side += dot(normal, to) / Math.max(dot(to, to), 0.01) ** 1.5;
  }
  if (side < 0) cell.normal = normal.map((value) => -value);
}

/** Marks the cells of large surfaces. */
function markSurfaces(cells) {
  const seen = new Set();
  for (const [start, first] of cells) {
    if (!first.normal || seen.has(start)) continue;
    const [surface, waiting] = [[], [start]];
    seen.add(start);
    while (waiting.length) {
      const number = waiting.pop();
      const { normal } = cells.get(number);
      surface.push(number);
      around(cells, number, (cell, other) => {
        if (!cell.normal || seen.has(other) || dot(cell.normal, normal) < SAME_SURFACE) return;
        seen.add(other);
        waiting.push(other);
      });
    }
    if (surface.length * CELL_M * CELL_M < MIN_AREA_M2) continue;
    for (const number of surface) cells.get(number).large = true;
  }
}

/** Gives cells without a direction the mean one of the cells around them. */
function spread(cells) {
  const found = [];
  for (const [number, cell] of cells) {
    if (cell.direction) continue;
    const sum = [0, 0, 0];
    around(cells, number, ({ direction }) => direction?.forEach((value, axis) => (sum[axis] += value)));
    const length = Math.hypot(...sum);
    if (length > 0.5) found.push([cell, sum.map((value) => value / length)]);
  }
  for (const [cell, direction] of found) cell.direction = direction;
}

function dot(left, right) {
  return left[0] * right[0] + left[1] * right[1] + left[2] * right[2];
}
