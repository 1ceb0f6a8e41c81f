"""Walls, floor, ceiling, window with daylight, door and ceiling lamp. They have the room's first ids."""

import math
from itertools import product

import numpy as np

from . import furniture
from .geometry import SIDES, Thing, rounded_box

THICKNESS = 0.14  # of the walls, metres


def build(room):
    """Adds the shell to an empty room: ids 1 to 4 are the walls, 5 the floor, 6 the ceiling."""
    paint = room.paint
    plain = paint.wallpaper()
    accent = paint.wallpaper(True) if paint.chance(0.5) else plain
    trim = paint.pick([paint.white(), paint.wood()])
    window_wall, door_wall = (int(k) for k in room.rng.permutation(4)[:2])
    width, bottom, top = paint.uniform(1.1, 1.8), paint.uniform(0.8, 1.0), paint.uniform(1.95, 2.15)
    along = paint.uniform(width / 2 + 0.5, room.wall_length(window_wall) - width / 2 - 0.5)
    hole = (along, width, bottom, top)
    accent_wall = int(room.rng.integers(4))
    for wall in range(4):
        material = accent if wall == accent_wall else plain
        _wall(room, wall, material, trim, hole if wall == window_wall else None)
    _slabs(room)
    room.window_wall = window_wall
    _window(room, window_wall, *hole)
    _door(room, door_wall)
    _ceiling_lamp(room)


def _wall(room, wall, material, trim, hole):
    """A wall with a skirting board; a hole for the window splits it into eight boxes."""
    thing, length = Thing("wall"), room.wall_length(wall)
    xs, zs = [-THICKNESS, length + THICKNESS], [0, room.height]
    if hole:
        along, width, bottom, top = hole
        xs, zs = [xs[0], along - width / 2, along + width / 2, xs[1]], [0, bottom, top, room.height]
    for i, j in product(range(len(xs) - 1), range(len(zs) - 1)):
        if not hole or (i, j) != (1, 1):
            part = rounded_box(xs[i + 1] - xs[i], THICKNESS, zs[j + 1] - zs[j], 0.0005)
            thing.add(part, material, ((xs[i] + xs[i + 1]) / 2, THICKNESS / 2, (zs[j] + zs[j + 1]) / 2))
    thing.box(trim, length / 2, -0.006, 0, length - 0.03, 0.012, 0.08, 0.003)
    x, y, yaw = room.at(wall, 0, 0)
    room.place(thing.finish(keep_origin=True), x, y, 0, yaw)


def _slabs(room):
    paint, x, y = room.paint, room.width / 2, room.depth / 2
    floor = paint.flooring()
    ceiling = paint.material("plain", paint.colour(0.1, (0, 0.05), (0.85, 0.95)), rough=0.9)
    for name, material, z in (("floor", floor, -0.1), ("ceiling", ceiling, room.height)):
        thing = Thing(name)
        thing.box(material, x, y, z, room.width + 0.3, room.depth + 0.3, 0.1, 0.001)
        room.place(thing.finish(keep_origin=True), 0, 0)


def _window(room, wall, along, width, bottom, top):
    """A window with a bright view, a matching area light, perhaps the sun and curtains."""
    paint = room.paint
    thing, frame, height = Thing("window"), paint.white() if paint.chance(0.7) else paint.wood(), top - bottom
    for x in (-width / 2 + 0.025, 0, width / 2 - 0.025):
        thing.box(frame, x, 0.05, 0, 0.05, 0.06, height)
    for z in (0, height - 0.05):
        thing.box(frame, 0, 0.05, z, width, 0.06, 0.05)
    thing.box(frame, 0, -0.03, -0.03, width + 0.1, 0.2, 0.03)
    pixels = _view(paint)
    view = paint.material("image", (1, 1, 1), pixels=pixels, glow=paint.uniform(1.5, 3.0))
    thing.add(rounded_box(width - 0.06, 0.008, height - 0.06, 0.001), view, (0, 0.07, height / 2))
    x, y, yaw = room.at(wall, along, 0)
    item = room.place(thing.finish(keep_origin=True), x, y, bottom, yaw).object
    item.visible_diffuse = item.visible_shadow = False
    inward_x, inward_y, day = math.sin(yaw), -math.cos(yaw), paint.uniform(0.3, 1.0)
    centre = (x + 0.03 * inward_x, y + 0.03 * inward_y, bottom + height / 2)
    sky = paint.pick([(0.8, 0.9, 1), (1, 0.95, 0.88)])
    room.light("AREA", centre, 90 * day, sky, width * 0.9, (inward_x, inward_y, -0.15), height * 0.9)
    if paint.chance(0.45):
        side, strength = paint.uniform(-0.6, 0.6), paint.uniform(2, 7) * day
        aim = (inward_x - inward_y * side, inward_y + inward_x * side, -paint.uniform(0.5, 1.0))
        room.light("SUN", (0, 0, 5), strength, (1, 0.93, 0.8), 0.02, aim)
    room.wall_uses[wall].append((along - width / 2 - 0.05, along + width / 2 + 0.05, bottom - 0.05, room.height))
    if paint.chance(0.55):
        curtain = furniture.curtain(paint, 0.4, top + 0.05)
        for t in (along + side * (width / 2 + 0.22) for side in SIDES):
            x, y, yaw = room.at(wall, t, 0.08)
            room.place(curtain, x, y, 0.03, yaw)
            room.wall_uses[wall].append((t - 0.26, t + 0.26, 0, room.height))
            room.footprints.append((x, y, yaw, 0.22, 0.05))


def _view(paint):
    """Sky, hills and houses, [96, 96, 3] in 0..1."""
    y, x = np.mgrid[0:96, 0:96] / 96
    ranges = ((0.58, (0.1, 0.4), (0.9, 1)), (0.3, (0.3, 0.6), (0.3, 0.6)), (0.08, (0.1, 0.4), (0.5, 0.8)))
    sky, grass, house = (np.array(paint.colour(*bounds)) for bounds in ranges)
    horizon = 0.5 + 0.1 * np.sin(x * paint.uniform(3, 9) + paint.uniform(0, 6)) + 0.03 * np.sin(x * 40)
    pixels = np.where((y > horizon)[..., None], grass, sky)
    for _ in range(4):
        left, width, top = paint.uniform(0, 0.9), paint.uniform(0.1, 0.25), paint.uniform(0.2, 0.6)
        pixels[(x > left) & (x < left + width) & (y > top)] = house * paint.uniform(0.6, 1.1)
    return np.clip(pixels, 0, 1)


def _door(room, wall):
    """A door, with clear floor in front."""
    thing, length = furniture.door(room.paint), room.wall_length(wall)
    along = room.paint.pick([0.65, length - 0.65, length / 2])
    x, y, yaw = room.at(wall, along, thing.depth / 2 + 0.014)
    room.place(thing, x, y, 0, yaw)
    room.wall_uses[wall].append((along - 0.55, along + 0.55, 0, 2.2))
    room.kept_clear.append((*room.at(wall, along, 0.4), 0.5, 0.4))


def _ceiling_lamp(room):
    paint = room.paint
    thing, drop = Thing("ceiling lamp"), paint.uniform(0.12, 0.5)
    tint = paint.pick([(1, 0.9, 0.75), (1, 0.96, 0.9), (0.92, 0.96, 1)])
    shade = paint.material("plain", (0.95, 0.9, 0.8), rough=0.8, glow=paint.uniform(1.0, 2.0))
    thing.cylinder(paint.metal(), 0, 0, -0.02, 0.06, 0.02)
    thing.tube(paint.metal(), [(0, 0, -0.01), (0, 0, -drop)], 0.006)
    r = paint.uniform(0.12, 0.22)
    globe = [(0, -drop - r), (r * 0.7, -drop - r * 0.8), (r, -drop - r * 0.4), (r * 0.6, -drop), (0, -drop + 0.01)]
    cone = [(r * 1.2, -drop - r), (r * 0.4, -drop), (0.02, -drop + 0.01), (0.02, -drop), (r * 1.18, -drop - r)]
    thing.turned(shade, globe if paint.chance(0.5) else cone, count=24)
    thing.finish(keep_origin=True)
    x = room.width / 2 + paint.uniform(-0.4, 0.4)
    room.place(thing, x, room.depth / 2 + paint.uniform(-0.4, 0.4), room.height - 0.001)
    middle, z = (room.width / 2, room.depth / 2), room.height - drop - r
    room.light("AREA", (*middle, z - 0.06), paint.uniform(35, 75), tint, 0.3)
    room.light("POINT", (*middle, z - 0.08), paint.uniform(15, 35), tint, 0.12)
