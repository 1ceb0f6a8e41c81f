"""Furniture from a folder of meshes, scaled, rotated and coloured for a room."""

import os
import sys

import bpy
import numpy as np
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from .geometry import Thing, rotation
from .kinds import STANDS_FOR, guess
from .meshes import ENDINGS, read_mesh

SHARE = 0.45  # share of a room's things taken from the library, if it has their kind
BROKEN = (ArithmeticError, AttributeError, LookupError, OSError, RuntimeError, SyntaxError, TypeError, ValueError)
LARGEST = (2.7, 2.3, 2.3)  # metres; wider, deeper and higher pieces do not fit a room


class Library:
    """The meshes of a folder and its subfolders, read on first use."""

    def __init__(self, folder):
        self.by_kind, self.read = {}, {}
        for root, folders, names in os.walk(folder):
            folders.sort()
            for name in sorted(names):
                stem, ending = os.path.splitext(name)
                kind = guess(stem) if ending.lower() in ENDINGS else None
                if kind:
                    self.by_kind.setdefault(kind.name, []).append((os.path.join(root, name), kind))
        if not self.by_kind:
            raise ValueError(f"{folder}: no meshes that rooms can use; expected {', '.join(ENDINGS)}")

    def piece(self, wanted, paint):
        """A random Thing that can replace the wanted one, or None.

        A file that cannot be read is reported once and not tried again.
        """
        kinds, heights = STANDS_FOR.get(wanted, ((), None))
        entries = [entry for kind in kinds for entry in self.by_kind.get(kind, [])]
        for _ in range(4 if entries else 0):
            path, kind = paint.pick(entries)
            source = self.load(path, kind)
            if source is not None:
                thing = source.piece(heights if kind.axis == "height" else None, paint)
                if all(size <= most for size, most in zip((thing.width, thing.depth, thing.height), LARGEST)):
                    return thing
        return None

    def load(self, path, kind):
        if path not in self.read:
            try:
                self.read[path] = Source(read_mesh(path), kind, path.lower().endswith(".dae"))
            except BROKEN as error:
                reason = str(error).strip().splitlines() or [type(error).__name__]
                print(f"warning: {path}: skipped: {reason[-1]}", file=sys.stderr, flush=True)
                self.read[path] = None
        return self.read[path]


class Source:
    """A mesh of the library, rotated so that its front is -y, its back +y, and its longer side along x."""

    def __init__(self, mesh, kind, metric):
        """`metric`: the file's sizes are real sizes in metres."""
        self.mesh, self.kind, self.metric = mesh, kind, metric
        self.vertices = mesh.vertices @ rotation("Z", self._yaw()).T
        low, high = self.vertices.min(0), self.vertices.max(0)
        self.vertices = self.vertices - [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]
        self.size = high - low

    def _yaw(self):
        size = np.ptp(self.mesh.vertices, axis=0)
        quarter = np.pi / 2
        if self.kind.back == "top":
            return self._yaw_of_backrest()
        wide = size[0] >= size[1]
        if self.kind.back == "none":
            return 0.0 if wide else quarter
        square = max(size[:2]) < 1.2 * min(size[:2])
        turns = np.arange(4) * quarter if square else np.array([0, 2]) * quarter + (0 if wide else quarter)
        depths = [self._depth_of_side(turn) for turn in turns]
        return float(turns[np.argmax(depths) if self.kind.back == "rough" else np.argmin(depths)])

    def _yaw_of_backrest(self):
        """The quarter turn that moves the highest parts, by area, to +y."""
        corners = self.mesh.vertices[self.mesh.faces]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        low, high = self.mesh.vertices.min(0), self.mesh.vertices.max(0)
        middle = (corners.mean(1) - low) / np.maximum(high - low, 1e-9) - 0.5
        weight = area * (middle[:, 2] > 0.2)
        x, y = (weight[:, None] * middle[:, :2]).sum(0) / max(weight.sum(), 1e-12)
        if abs(x) > abs(y) + 0.05:
            return np.pi / 2 if x > 0 else -np.pi / 2
        return np.pi if y < -0.05 else 0.0

    def _depth_of_side(self, turn):
        """Mean depth of the mesh behind the +y side of its bounding box after a turn; 0 for a flat back.

        Shelves are open in front, and doors have handles there.
        """
        vertices = self.mesh.vertices @ rotation("Z", turn).T
        low, high = vertices.min(0), vertices.max(0)
        size = np.maximum(high - low, 1e-9)
        tree = tree_of(((vertices - low) / size)[self.mesh.faces])
        total = 0.0
        for x in np.linspace(0.06, 0.94, 9):
            for z in np.linspace(0.06, 0.94, 9):
                distance = tree.ray_cast((x, 1.1, z), (0, -1, 0))[3]
                total += 1.1 if distance is None else distance
        return total

    def piece(self, heights, paint):
        """A Thing of a random size and, half of the time, random colours; `heights`: bounds, None for the kind's own."""
        scale = self._scale(heights, paint)
        triangles = (self.vertices * scale)[self.mesh.faces]
        thing = Thing(self.kind.name)
        thing.imported = True
        thing.width, thing.depth, thing.height = (float(size) for size in self.size * scale)
        thing.triangles = triangles
        thing.surfaces = find_surfaces(triangles)
        thing.mesh = self._blender_mesh(triangles, paint)
        return thing

    def _scale(self, heights, paint):
        """Factors [3] for x, y and z; the sides differ a little, so that no two chairs are alike."""
        kind, size = self.kind, self.size
        along = {"height": size[2], "width": max(size[:2]), "largest": max(size)}[kind.axis]
        low, high = heights or (kind.low, kind.high)
        keep = heights is None and (self.metric or kind.name != "other" and low <= along <= high)
        scale = 1.0 if keep else paint.uniform(low, high) / along
        factors = scale * np.array([paint.uniform(0.94, 1.06), paint.uniform(0.94, 1.06), 1.0])
        if kind.name == "rug":  # thin: furniture stands on it
            factors[2] = paint.uniform(0.004, 0.01) / max(size[2], 0.001)
        return factors

    def _blender_mesh(self, triangles, paint):
        count = len(triangles)
        mesh = bpy.data.meshes.new(self.kind.name)
        mesh.from_pydata(triangles.reshape(-1, 3).tolist(), [], np.arange(count * 3).reshape(-1, 3).tolist())
        mesh.polygons.foreach_set("material_index", self.mesh.slots.astype(np.int32))
        coordinates = np.ascontiguousarray(self.mesh.coordinates, np.float32)
        mesh.uv_layers.new().uv.foreach_set("vector", coordinates.ravel())
        recolour = paint.uniform(0, 1) < 0.5
        for finish in self.mesh.finishes:
            if recolour:
                mesh.materials.append(paint.pick([paint.paint, paint.wood, paint.fabric, paint.gloss])())
            else:
                mesh.materials.append(paint.imported(finish.colour, finish.image))
        return mesh


def tree_of(triangles):
    """A BVH tree for casting rays against triangles [F, 3, 3]."""
    corners = np.arange(len(triangles) * 3).reshape(-1, 3).tolist()
    return BVHTree.FromPolygons(triangles.reshape(-1, 3).tolist(), corners, all_triangles=True)


def find_surfaces(triangles, cells=18, most=6):
    """Horizontal rectangles of a piece on which things can stand: boards, tops, seats.

    Returns up to `most` of (x0, x1, y0, y1, z, clear height above) in metres, lowest first; `triangles` is [F, 3, 3],
    standing on z = 0 with its middle at x = y = 0.
    """
    half_x, half_y, top = np.abs(triangles[..., 0]).max(), np.abs(triangles[..., 1]).max(), triangles[..., 2].max()
    tree, step = tree_of(triangles), np.array([2 * half_x, 2 * half_y]) / cells
    hits = []  # column, row, height, clear height
    for i in range(cells):
        for j in range(cells):
            x, y = -half_x + (i + 0.5) * step[0], -half_y + (j + 0.5) * step[1]
            hits += [(i, j, z, clear) for z, clear in _levels(tree, x, y, top)]
    hits, found = np.array(hits).reshape(-1, 4), []
    while len(found) < most and len(hits) >= 0.1 * cells**2:
        counts, edges = np.histogram(hits[:, 2], bins=np.arange(0, top + 0.04, 0.012))
        middle = np.median(hits[(hits[:, 2] >= edges[counts.argmax()]) & (hits[:, 2] <= edges[counts.argmax() + 1]), 2])
        near = np.abs(hits[:, 2] - middle) < 0.012
        level, hits = hits[near], hits[~near]
        if len(level) < 0.1 * cells**2:
            break
        mask = np.zeros((cells, cells), bool)
        mask[level[:, 0].astype(int), level[:, 1].astype(int)] = True
        i0, i1, j0, j1 = largest_rectangle(mask)
        inside = level[(level[:, 0] >= i0) & (level[:, 0] < i1) & (level[:, 1] >= j0) & (level[:, 1] < j1)]
        x0, x1, y0, y1 = i0 * step[0] - half_x, i1 * step[0] - half_x, j0 * step[1] - half_y, j1 * step[1] - half_y
        if min(x1 - x0, y1 - y0) > 0.14:
            edge = 0.015
            surface = (x0 + edge, x1 - edge, y0 + edge, y1 - edge, inside[:, 2].max(), inside[:, 3].min() - 0.015)
            found.append(tuple(float(value) for value in surface))
    return sorted(found, key=lambda surface: surface[4])


def _levels(tree, x, y, top):
    """Heights at (x, y) of upward-facing surfaces with at least 12 cm of clear height above, and that clear height."""
    z, above = top + 0.01, top + 0.8
    for _ in range(40):
        point, normal, _, _ = tree.ray_cast(Vector((x, y, z)), Vector((0, 0, -1)))
        if point is None:
            return
        if abs(normal.z) > 0.95 and above - point.z > 0.12 and point.z > 0.05:
            yield point.z, above - point.z
        above, z = point.z, point.z - 0.0015


def largest_rectangle(mask):
    """The largest rectangle of true cells: start and end row, start and end column."""
    best, found = 0, (0, 0, 0, 0)
    for first in range(len(mask)):
        rows = np.ones(mask.shape[1], bool)
        for last in range(first, len(mask)):
            rows &= mask[last]
            padded = np.diff(np.r_[0, rows.astype(int), 0])
            starts, ends = np.nonzero(padded == 1)[0], np.nonzero(padded == -1)[0]
            if not len(starts):
                break
            widest = (ends - starts).argmax()
            area = (last - first + 1) * (ends - starts)[widest]
            if area > best:
                best, found = area, (first, last + 1, int(starts[widest]), int(ends[widest]))
    return found
