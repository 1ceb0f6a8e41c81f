"""Mesh primitives in metres, z up, as (points [P, 3], normals [P, 3], quads [Q, 4]), and the Thing built from them."""

import math
from itertools import product

import bpy
import numpy as np
from mathutils import Matrix

TAU, PI = 2 * math.pi, math.pi
SIDES = (-1, 1)


def rotation(axis, angle):
    """A rotation [3, 3] about the axis "X", "Y" or "Z", in radians."""
    return np.array(Matrix.Rotation(angle, 3, axis))


def grid(points, normals=None, wrap=False):
    """Quads over points [U, V, 3]; `wrap` closes them along u."""
    if normals is None:
        normals = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    normals = normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
    index = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    index = np.concatenate([index, index[:1]]) if wrap else index
    quads = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], -1).reshape(-1, 4)
    return points.reshape(-1, 3), normals.reshape(-1, 3), quads


def join(parts):
    """Joins several meshes; entries of a part after the first three are ignored."""
    points, normals, quads = zip(*[part[:3] for part in parts])
    starts = np.cumsum([0] + [len(part) for part in points])
    quads = [part + start for part, start in zip(quads, starts)]
    return np.concatenate(points), np.concatenate(normals), np.concatenate(quads)


def rounded_box(size_x, size_y, size_z, radius=0.008, segments=1):
    """A box centred at the origin with rounded edges."""
    half = np.array([size_x, size_y, size_z]) / 2
    radius = min(radius, half.min() * 0.98)
    steps = radius * np.arange(segments + 1) / segments
    lines = [np.r_[-extent + steps, extent - radius + steps] for extent in half]
    parts = []
    for axis, side in product(range(3), SIDES):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        points = np.zeros((len(lines[u]), len(lines[v]), 3))
        points[..., u], points[..., v], points[..., axis] = lines[u][:, None], lines[v][None], side * half[axis]
        core = np.clip(points, radius - half, half - radius)
        normals = (points - core) / np.linalg.norm(points - core, axis=-1, keepdims=True)
        parts.append(grid(core + radius * normals, normals))
    return join(parts)


def lathe(profile, count=20):
    """A surface of revolution about z from a list of (radius, z); sharp where the profile bends sharply."""
    profile = np.array(profile, float)
    profile = profile[np.r_[True, np.abs(np.diff(profile, axis=0)).sum(1) > 1e-6]]
    step = np.diff(profile, axis=0)
    across = np.stack([step[:, 1], -step[:, 0]], 1) / np.linalg.norm(step, axis=1, keepdims=True)
    angle = np.arange(count) * TAU / count
    circle = np.stack([np.cos(angle), np.sin(angle)], 1)[:, None]

    def around(pairs):
        height = np.broadcast_to(pairs[None, :, 1:], (count, 2, 1))
        return np.concatenate([circle * pairs[None, :, :1], height], -1)

    parts = []
    for k in range(len(step)):
        ends = []
        for other in (k - 1, k + 1):
            smooth = 0 <= other < len(across) and across[k] @ across[other] > 0.6
            ends.append(across[k] + across[other] if smooth else across[k])
        parts.append(grid(around(profile[k : k + 2]), around(np.array(ends)), wrap=True))
    return join(parts)


def tube(points, radius, count=8):
    """A closed tube along a line of points; `radius` is one number or one for each point."""
    points = np.array(points, float)
    along = np.gradient(points, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along).max(0))])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    angle = np.arange(count)[:, None, None] * TAU / count
    normals = np.cos(angle) * side + np.sin(angle) * np.cross(along, side)
    rings = points + np.broadcast_to(np.asarray(radius, float), (len(points),))[:, None] * normals

    def cap(point):
        return np.repeat(point[None, None], count, 0)

    rings = np.concatenate([cap(points[0]), rings[:, :1], rings, rings[:, -1:], cap(points[-1])], 1)
    normals = np.concatenate([cap(-along[0])] * 2 + [normals] + [cap(along[-1])] * 2, 1)
    return grid(rings, normals, wrap=True)


def superellipsoid(a, b, c, upright=0.6, flat=0.35):
    """A superellipsoid with half sizes a, b, c: cushions, bags, animals. Exponents under 1 make it boxy."""
    u, v = (np.arange(24) * TAU / 24)[:, None], np.linspace(-PI / 2, PI / 2, 12)[None]

    def power(x, exponent):
        return np.sign(x) * np.abs(x) ** exponent

    def surface(e1, e2, x, y, z):
        ring = power(np.cos(v), e1)
        return np.stack(
            [x * ring * power(np.cos(u), e2), y * ring * power(np.sin(u), e2), z * power(np.sin(v), e1) + 0 * u], -1
        )

    points = surface(upright, flat, a, b, c)
    return grid(points, surface(2 - upright, 2 - flat, 1 / a, 1 / b, 1 / c), wrap=True)


class Thing:
    """An object: parts with materials, surfaces that carry other objects, and lights. Its front is -y.

    `surfaces` lists (x0, x1, y0, y1, z, clear height above), `lights` (position, watts, colour, radius). `finish` sets
    `width`, `depth` and `height` (the bounding box), `triangles` [F, 3, 3] and Blender's `mesh`.
    """

    imported = False

    def __init__(self, name):
        self.name, self.parts, self.materials, self.surfaces, self.lights = name, [], [], [], []
        self.knee_x = 0.0  # position of a desk's knee space

    def add(self, part, material, at=(0, 0, 0), turn=None):
        points, normals, quads = part
        if turn is not None:
            points, normals = points @ turn.T, normals @ turn.T
        if material not in self.materials:
            self.materials.append(material)
        self.parts.append((points + np.array(at, float), normals, quads, self.materials.index(material)))

    def box(self, material, x, y, bottom, size_x, size_y, size_z, radius=0.006, segments=1, turn=None):
        self.add(rounded_box(size_x, size_y, size_z, radius, segments), material, (x, y, bottom + size_z / 2), turn)

    def turned(self, material, profile, x=0, y=0, z=0, count=20):
        """Adds a lathe."""
        self.add(lathe(profile, count), material, (x, y, z))

    def cylinder(self, material, x, y, z, radius, height):
        self.turned(material, [(0, 0), (radius, 0), (radius, height), (0, height)], x, y, z, 16)

    def tube(self, material, points, radius):
        self.add(tube(points, radius), material)

    def ball(self, material, x, y, bottom, radius):
        t = np.linspace(-PI / 2, PI / 2, 12)
        self.turned(material, np.stack([radius * np.cos(t), radius + radius * np.sin(t)], 1), x, y, bottom, 18)

    def legs(self, material, width, depth, height, kind, radius=0.022):
        """Adds four legs; `kind` is "box", "tube" or "taper" (narrow and splayed at the floor)."""
        for side, end in product(SIDES, SIDES):
            x, y, splay = side * (width / 2 - 0.04), end * (depth / 2 - 0.04), 0.03 * (kind == "taper")
            if kind == "box":
                self.box(material, x, y, 0, 2.2 * radius, 2.2 * radius, height)
            else:
                line = [(x + side * splay, y + end * splay, 0), (x, y, height)]
                self.tube(material, line, [radius * 0.7, radius] if splay else radius)

    def carry(self, width, depth, z, margin):
        """Adds a centred surface for other things, open above."""
        x, y = width / 2 - margin, depth / 2 - margin
        self.surfaces.append((margin - width / 2, x, margin - depth / 2, y, z, 1.0))

    def finish(self, keep_origin=False):
        """Centres the footprint, rests it on z = 0 (unless the origin is kept) and builds Blender's mesh."""
        points, normals, quads = join(self.parts)
        low, high = points.min(0), points.max(0)
        offset = np.zeros(3) if keep_origin else np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
        points, (self.width, self.depth, self.height) = points - offset, high - low
        self.surfaces = [
            (x0 - offset[0], x1 - offset[0], y0 - offset[1], y1 - offset[1], z - offset[2], clear)
            for x0, x1, y0, y1, z, clear in self.surfaces
        ]
        self.lights = [(np.array(position) - offset, *rest) for position, *rest in self.lights]
        facing = np.cross(points[quads[:, 2]] - points[quads[:, 0]], points[quads[:, 3]] - points[quads[:, 1]])
        flip = (facing * normals[quads].mean(1)).sum(1) < 0
        quads[flip] = quads[flip, ::-1]
        self.mesh = self._blender_mesh(points, normals, quads, facing)
        self.mesh.calc_loop_triangles()
        corners = np.zeros(len(self.mesh.loop_triangles) * 3, np.int32)
        self.mesh.loop_triangles.foreach_get("vertices", corners)
        self.triangles = points[corners.reshape(-1, 3)]
        return self

    def _blender_mesh(self, points, normals, quads, facing):
        mesh = bpy.data.meshes.new(self.name)
        mesh.from_pydata(points.tolist(), [], quads.tolist())
        slots = np.concatenate([np.full(len(part[2]), part[3]) for part in self.parts])
        mesh.polygons.foreach_set("material_index", slots)
        mesh.polygons.foreach_set("use_smooth", np.ones(len(quads), bool))
        # Texture coordinates are metres in the axis-aligned plane closest to the quad.
        plane = np.array([[1, 2], [0, 2], [0, 1]])[np.abs(facing).argmax(1)]
        coordinates = np.take_along_axis(points[quads], np.repeat(plane[:, None], 4, 1), 2)
        mesh.uv_layers.new().uv.foreach_set("vector", coordinates.astype(np.float32).ravel())
        mesh.normals_split_custom_set(normals[quads].reshape(-1, 3).tolist())
        for material in self.materials:
            mesh.materials.append(material)
        return mesh


def piece(name):
    """Decorator for a function that adds parts to a new Thing; calling it without the Thing returns the finished
    Thing."""

    def wrap(body):
        def make(paint, *arguments, **options):
            thing = Thing(name)
            body(paint, thing, *arguments, **options)
            return thing.finish()

        make.__doc__ = body.__doc__
        return make

    return wrap
