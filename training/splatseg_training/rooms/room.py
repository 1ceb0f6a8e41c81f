"""A room's plan: positions of things on floor, walls and surfaces. Metres; x in 0..width, y in 0..depth, z up.

Walls are numbered 0 to 3: y = 0, x = width, y = depth, x = 0.
"""

import math
from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Matrix, Vector

from .assets import SHARE
from .cast import Caster
from .catalogue import FACING, MAKERS, MOST_MODELS, STANDS_ON
from .geometry import PI, TAU, Thing, rotation
from .materials import Paint

LIFT = 0.0008  # gap between a thing and the surface below, so that rays do not hit both


class Light(NamedTuple):
    """An invisible light, as given to `Room.light`."""

    kind: str
    position: tuple
    watts: float
    colour: tuple
    size: float
    aim: tuple
    height: float


class Placed(NamedTuple):
    """A thing at a position in the room; (x, y, z) is the centre of its bottom."""

    thing: Thing
    x: float
    y: float
    z: float
    yaw: float
    object: bpy.types.Object

    @property
    def id(self):
        return self.object.pass_index

    @property
    def footprint(self):
        """Rectangle (x, y, yaw, half width, half depth)."""
        return (self.x, self.y, self.yaw, self.thing.width / 2, self.thing.depth / 2)

    def to_room(self, x, y):
        """Converts a point in the thing's plan to a point in the room."""
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        return self.x + cos * x - sin * y, self.y + sin * x + cos * y


def overlap(first, second, gap=0.0):
    """True if two rectangles (x, y, yaw, half width, half depth) are closer than a gap."""
    boxes = []
    for x, y, yaw, half_width, half_depth in (first, second):
        axes = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
        boxes.append((np.array([x, y]), axes, np.array([half_width, half_depth]) + gap / 2))
    apart = boxes[0][0] - boxes[1][0]
    for normal in np.concatenate([boxes[0][1], boxes[1][1]]):
        if abs(normal @ apart) >= sum((np.abs(axes @ normal) * half).sum() for _, axes, half in boxes):
            return False
    return True


class Room:
    """An empty room for a seed; `shell.build` and `furnish.furnish` fill it, `finish` prepares it for ray casting.

    `names[id - 1]` is an instance's name. With a library, some things are imported meshes.
    """

    def __init__(self, seed, library=None):
        self.rng, self.library = np.random.default_rng(seed), library
        self.paint = Paint(self.rng)
        self.names, self.triangles, self.ids, self.models, self.used = [], [], [], {}, {}
        self.footprints, self.kept_clear = [], []  # rectangles of the floor: occupied, kept free
        self.wall_uses = [[], [], [], []]  # (start, end, bottom, top) on each wall
        self.placed, self.lights = [], []
        self.surfaces = []  # (placed, number of the surface, kind of things for it), still to be filled
        self.imported = 0
        self.target = int(self.rng.integers(62, 91))
        uniform = self.paint.uniform
        self.width, self.depth, self.height = uniform(4, 5.8), uniform(4, 5.4), uniform(2.4, 2.8)
        self.kind, self.window_wall, self.caster = "", 0, None

    def finish(self):
        self.caster = Caster(np.concatenate(self.triangles), np.concatenate(self.ids))

    def choose(self, name, make):
        """Sometimes an imported thing that can replace the named one, otherwise the result of `make`."""
        if self.library is not None and self.paint.chance(SHARE):
            thing = self.library.piece(name, self.paint)
            if thing is not None:
                return thing
        return make()

    def place(self, thing, x, y, z=0.0, yaw=0.0, floor=False):
        """Adds an instance of a thing; with `floor`, its footprint becomes occupied."""
        item = bpy.data.objects.new(thing.name, thing.mesh)
        bpy.context.scene.collection.objects.link(item)
        item.matrix_world = Matrix.Translation((x, y, z)) @ Matrix.Rotation(yaw, 4, "Z")
        self.names.append(thing.name)
        self.imported += thing.imported
        item.pass_index = len(self.names)
        self.triangles.append(thing.triangles @ rotation("Z", yaw).T + [x, y, z])
        self.ids.append(np.full(len(thing.triangles), len(self.names)))
        if floor:
            self.footprints.append((x, y, yaw, thing.width / 2, thing.depth / 2))
        for position, watts, colour, radius in thing.lights:
            self.light("POINT", rotation("Z", yaw) @ position + [x, y, z], watts, colour, radius)
        self.placed.append(Placed(thing, x, y, z, yaw, item))
        return self.placed[-1]

    def light(self, kind, position, watts, colour, size, aim=(0, 0, -1), height=None):
        """Adds an invisible light; `size` is a "POINT"'s radius, an "AREA"'s width, a "SUN"'s angle."""
        self.lights.append(Light(kind, tuple(position), watts, colour, size, tuple(aim), height or size))
        light = bpy.data.lights.new("light", kind)
        light.energy, light.color = watts, colour
        if kind == "POINT":
            light.shadow_soft_size = size
        elif kind == "AREA":
            light.shape, light.size, light.size_y = "RECTANGLE", size, height or size
        else:
            light.angle = size
        item = bpy.data.objects.new("light", light)
        item.location, item.rotation_euler = position, Vector(aim).to_track_quat("-Z", "Y").to_euler()
        item.visible_camera = item.visible_glossy = False
        bpy.context.scene.collection.objects.link(item)

    def wall_length(self, wall):
        return self.width if wall % 2 == 0 else self.depth

    def at(self, wall, along, off):
        """Point and yaw at distances along and from a wall, for a thing with its back to the wall."""
        yaw = (PI, -PI / 2, 0, PI / 2)[wall]
        corner = ((self.width, 0), (self.width, self.depth), (0, self.depth), (0, 0))[wall]
        x = corner[0] + along * math.cos(yaw) + off * math.sin(yaw)
        return x, corner[1] + along * math.sin(yaw) - off * math.cos(yaw), yaw

    def is_free(self, rectangle, gap=0.04, ignored=()):
        """True if a rectangle lies inside the room, clear of all standing things."""
        x, y, yaw, half_width, half_depth = rectangle
        cos, sin = abs(math.cos(yaw)), abs(math.sin(yaw))
        extent_x = cos * half_width + sin * half_depth + 0.01
        extent_y = sin * half_width + cos * half_depth + 0.01
        if not (extent_x <= x <= self.width - extent_x and extent_y <= y <= self.depth - extent_y):
            return False
        others = self.footprints + self.kept_clear
        return not any(overlap(rectangle, other, gap) for other in others if other not in ignored)

    def at_wall(self, thing, walls=(0, 1, 2, 3), tries=50, heights=None, gap=0.02):
        """Places a thing with its back to a wall, or hangs it with its bottom between two heights; None if there is no
        space."""
        for _ in range(tries):
            wall = self.paint.pick(walls)
            length, half = self.wall_length(wall), thing.width / 2
            if length < thing.width + 0.1:
                continue
            along = self.paint.uniform(half + 0.04, length - half - 0.04)
            z = self.paint.uniform(*heights) if heights else 0.0
            top = z + thing.height + (0.35 if thing.name == "wall shelf" else 0)
            use = (along - half - gap, along + half + gap, z, top)
            x, y, yaw = self.at(wall, along, thing.depth / 2 + (0.004 if heights else 0.018))
            rectangle = (x, y, yaw, half, thing.depth / 2)
            if any(use[0] < b and a < use[1] and use[2] < d and c < use[3] for a, b, c, d in self.wall_uses[wall]):
                continue
            if not heights and not self.is_free(rectangle):
                continue
            self.wall_uses[wall].append(use)
            if thing.depth > 0.08 and heights:
                self.kept_clear.append(rectangle)
            return self.place(thing, x, y, z, yaw, not heights)
        return None

    def on_floor(self, thing, tries=60, gap=0.06, yaw=None, inset=None):
        """Places a thing at random on the floor; `inset` is the share of the room at each wall from which its centre is
        excluded."""
        x0, x1, y0, y1 = 0.2, self.width - 0.2, 0.2, self.depth - 0.2
        if inset is not None:
            x0, x1, y0, y1 = (size * k for size in (self.width, self.depth) for k in (inset, 1 - inset))
        uniform = self.paint.uniform
        for _ in range(tries):
            x, y = uniform(x0, x1), uniform(y0, y1)
            angle = uniform(0, TAU) if yaw is None else yaw
            if self.is_free((x, y, angle, thing.width / 2, thing.depth / 2), gap):
                return self.place(thing, x, y, 0, angle, True)
        return None

    def model(self, name):
        """A small object; models are reused, so that a room contains duplicates."""
        models = self.models.setdefault(name, [])
        if len(models) < MOST_MODELS.get(name, 2) and (not models or self.paint.chance(0.4)):
            models.append(self.choose(name, lambda: MAKERS[name](self.paint)))
            return models[-1]
        return self.paint.pick(models)

    def left(self):
        """Number of instances that the room still needs."""
        return self.target - len(self.names)

    def put(self, placed, number, name, at=None, yaw=None, tries=14):
        """Places a small object on a surface of a placed thing, at a point of that thing's plan or at random."""
        x0, x1, y0, y1, z, clear = placed.thing.surfaces[number]
        thing, used = self.model(name), self.used.setdefault((placed.id, number), [])
        uniform = self.paint.uniform
        for _ in range(tries):
            angle = yaw if yaw is not None else uniform(-0.5, 0.5) if name in FACING else uniform(0, TAU)
            cos, sin = abs(math.cos(angle)), abs(math.sin(angle))
            extent_x = cos * thing.width / 2 + sin * thing.depth / 2
            extent_y = sin * thing.width / 2 + cos * thing.depth / 2
            if thing.height > clear or x1 - x0 < 2 * extent_x or y1 - y0 < 2 * extent_y:
                return None
            if at:
                x, y = at
            else:
                x = uniform(x0 + extent_x, x1 - extent_x)
                y = y1 - extent_y if name == "cushion" else uniform(y0 + extent_y, y1 - extent_y)
            rectangle = (x, y, angle, thing.width / 2, thing.depth / 2)
            if any(overlap(rectangle, other, 0.01) for other in used):
                continue
            used.append(rectangle)
            room_x, room_y = placed.to_room(x, y)
            stood = self.place(thing, room_x, room_y, placed.z + z + LIFT, placed.yaw + angle)
            if name == "flatbook":
                self._pile(stood, placed.z + z, clear)
            return stood
        return None

    def _pile(self, bottom, surface, clear):
        """Sometimes piles more books on a book; `surface` is the height at which the book lies."""
        thing, z = bottom.thing, bottom.z
        for _ in range(int(self.rng.integers(0, 4))):
            z += thing.height + LIFT
            above = self.model("flatbook")
            if above.width > thing.width + 0.03 or z - surface + above.height > clear or self.left() < 1:
                break
            thing = above
            self.place(thing, bottom.x, bottom.y, z, bottom.yaw + self.paint.uniform(-0.25, 0.25))

    def books(self, placed, number):
        """Places a row of books, with runs of the same volume, on a surface."""
        x0, x1, y0, y1, z, clear = placed.thing.surfaces[number]
        uniform = self.paint.uniform
        x, end, run = x0, min(x1, x0 + uniform(0.12, 0.42)), 0
        if self.paint.chance(0.4):
            x, end = x1 - (end - x0), x1
        rectangle = ((x + end) / 2, (y0 + y1) / 2, 0, (end - x) / 2, (y1 - y0) / 2)
        self.used.setdefault((placed.id, number), []).append(rectangle)
        while self.left() > 0 and self.names.count("book") < 0.3 * self.target:
            if run <= 0:
                book, run = self.model("book"), int(self.rng.integers(1, 5))
            if book.height > clear or x + book.width > end:
                break
            y = min(y0 + 0.02 + uniform(0, 0.012), y1 - book.depth) + book.depth / 2
            self.place(book, *placed.to_room(x + book.width / 2, y), placed.z + z + LIFT, placed.yaw)
            x, run = x + book.width + 0.0012, run - 1

    def to_fill(self, placed, what):
        """Registers the surfaces of a placed thing and the kind of things for them; returns the placed thing."""
        if placed:
            self.surfaces.extend((placed, number, what) for number in range(len(placed.thing.surfaces)))
        return placed

    def fill(self):
        """Puts one thing on each surface per round until the room has enough."""
        for turn in range(12):
            for index in self.rng.permutation(len(self.surfaces)):
                placed, number, what = self.surfaces[int(index)]
                if self.left() > 0 and (turn or self.paint.chance(0.8)):
                    low = placed.thing.surfaces[number][5] < 0.9
                    if what == "shelf" and turn == 0 and self.paint.chance(0.6) and low:
                        self.books(placed, number)
                    else:
                        self.put(placed, number, self.paint.pick(STANDS_ON[what]), tries=6)

    def clearance(self, x, y):
        """Distance in the plan to the nearest wall or standing object; negative inside."""
        distance = np.minimum.reduce([x, y, self.width - x, self.depth - y]) - 0.12
        for centre_x, centre_y, yaw, half_width, half_depth in self.footprints + self.kept_clear[1:]:
            cos, sin = math.cos(yaw), math.sin(yaw)
            u, v = (x - centre_x) * cos + (y - centre_y) * sin, (y - centre_y) * cos - (x - centre_x) * sin
            out_u, out_v = np.abs(u) - half_width, np.abs(v) - half_depth
            outside = np.hypot(np.maximum(out_u, 0), np.maximum(out_v, 0))
            distance = np.minimum(distance, outside + np.minimum(np.maximum(out_u, out_v), 0))
        return distance
