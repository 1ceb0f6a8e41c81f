"""Furniture: functions that take the room's Paint and sizes in metres and return a finished Thing."""

import math
from itertools import product

import numpy as np

from .geometry import PI, SIDES, TAU, grid, piece, rotation


@piece("table")
def table(paint, thing, width, depth, height, desk=False):
    """A table, sometimes round, or a desk, often with drawers on one side."""
    thing.name, wood, thick = "desk" if desk else "table", paint.wood(), paint.uniform(0.025, 0.045)
    other = paint.pick([wood, wood, paint.metal(), paint.wood()])
    below = height - thick
    if not desk and abs(width - depth) < 0.25 and paint.chance(0.6):
        width = depth = min(width, depth)
        half = width / 2
        rim = [(0, below), (half - 0.01, below), (half, height - thick / 2), (half - 0.01, height), (0, height)]
        thing.turned(wood, rim, count=36)
        foot = [(0, 0), (width * 0.3, 0), (width * 0.28, 0.02), (0.05, 0.05), (0.035, height / 2)]
        thing.turned(other, [*foot, (0.05, below), (0, below)])
        width, depth = width * 0.72, depth * 0.72
    else:
        thing.box(wood, 0, 0, below, width, depth, thick)
        kind = paint.pick(["box", "tube", "taper"])
        thing.legs(other, width, depth, below, kind, paint.uniform(0.018, 0.03))
        if paint.chance(0.5):
            for side in SIDES:
                thing.box(other, 0, side * (depth / 2 - 0.05), below - 0.07, width - 0.1, 0.02, 0.07)
        if desk and paint.chance(0.7):
            _desk_drawers(paint, thing, wood, width, depth, below)
    thing.carry(width, depth, height, 0.03)


def _desk_drawers(paint, thing, wood, width, depth, below):
    side = paint.pick([-1, 1])
    x, thing.knee_x = side * (width / 2 - 0.21), -side * 0.17
    thing.box(wood, x, 0.02, 0.12, 0.34, depth - 0.12, below - 0.12)
    for k in range(3):
        bottom, height = 0.14 + k * (below - 0.14) / 3, (below - 0.14) / 3 - 0.015
        thing.box(paint.paint(), x, 0.02 - (depth - 0.12) / 2 - 0.008, bottom, 0.32, 0.016, height)
        y, z = -depth / 2 + 0.05, bottom + height * 0.6
        thing.tube(paint.metal(), [(x - 0.06, y, z), (x + 0.06, y, z)], 0.007)


@piece("chair")
def chair(paint, thing, kind=None):
    """A chair; `kind` is "slat", "panel", "shell" or "office"."""
    kind = kind or paint.pick(["slat", "panel", "shell", "office"])
    wood, metal = paint.wood(), paint.metal()
    width, depth, seat = paint.uniform(0.4, 0.46), paint.uniform(0.4, 0.45), paint.uniform(0.43, 0.47)
    if kind == "office":
        _office_chair(paint, thing, metal, seat)
    elif kind == "shell":
        _shell_chair(paint, thing, (wood, metal), width, depth, seat)
    else:
        thing.box(paint.pick([wood, paint.fabric()]), 0, 0, seat - 0.04, width, depth, 0.045, 0.012, 2)
        thing.legs(wood, width + 0.02, depth + 0.02, seat - 0.03, "box", 0.017)
        back = depth / 2 - 0.03
        for side in SIDES:
            thing.box(wood, side * (width / 2 - 0.03), back, seat, 0.034, 0.034, 0.45)
        if kind == "slat":
            for k in range(3):
                thing.box(wood, 0, back, seat + 0.1 + 0.12 * k, width - 0.08, 0.018, 0.06)
        else:
            thing.box(paint.pick([wood, paint.fabric()]), 0, back, seat + 0.14, width - 0.05, 0.03, 0.3, 0.01, 2)


def _office_chair(paint, thing, metal, seat):
    cloth = paint.pick([paint.fabric(), paint.black(), paint.fabric()])
    for k in range(5):
        x, y = 0.27 * math.cos(TAU * k / 5), 0.27 * math.sin(TAU * k / 5)
        thing.tube(metal, [(0, 0, 0.1), (x, y, 0.06)], [0.025, 0.018])
        thing.ball(paint.black(), x, y, 0, 0.028)
    thing.cylinder(metal, 0, 0, 0.08, 0.03, seat - 0.12)
    thing.box(cloth, 0, 0, seat - 0.05, 0.48, 0.46, 0.08, 0.035, 3)
    thing.box(metal, 0, 0.24, seat - 0.02, 0.05, 0.02, 0.3)
    thing.box(cloth, 0, 0.22, seat + 0.14, 0.44, 0.06, paint.uniform(0.36, 0.52), 0.028, 3, rotation("X", -0.1))


def _shell_chair(paint, thing, leg_materials, width, depth, seat):
    """A seat and back made of one bent sheet."""
    gloss = paint.gloss()
    u, v = np.linspace(-1, 1, 11)[:, None], np.linspace(0, 1, 14)[None]
    x = u * width / 2 * (1 - 0.1 * v**4)
    y = -depth / 2 + depth * np.minimum(v / 0.55, 1) + 0.08 * np.clip((v - 0.5) / 0.5, 0, 1) + 0 * u
    z = seat - 0.02 + 0.05 * u**2 + 0.38 * np.clip((v - 0.45) / 0.55, 0, 1) ** 1.2
    upper = np.stack([x, y, z], -1)
    lower = upper + np.array([0, 0.004, -0.012])
    edges = [(upper[0], lower[0]), (upper[-1], lower[-1]), (upper[:, 0], lower[:, 0]), (upper[:, -1], lower[:, -1])]
    for sheet in (upper, lower, *(np.stack(edge, 1) for edge in edges)):
        thing.add(grid(sheet), gloss)
    thing.legs(paint.pick(leg_materials), width - 0.06, depth - 0.06, seat - 0.03, "taper", 0.014)


@piece("stool")
def stool(paint, thing):
    wood, top = paint.wood(), paint.pick([paint.fabric(), paint.wood(), paint.gloss()])
    h, r = paint.uniform(0.42, 0.62), paint.uniform(0.15, 0.19)
    rim = [(0, h - 0.05), (r - 0.01, h - 0.05), (r, h - 0.035), (r, h - 0.01), (r - 0.012, h), (0, h)]
    thing.turned(top, rim, count=24)
    thing.legs(wood, r * 1.5, r * 1.5, h - 0.04, "taper", 0.016)


@piece("shelf")
def shelf(paint, thing, width, depth, height, count):
    """A shelf with `count` stacked compartments."""
    wood, thick = paint.wood(), 0.022
    inside = width - 2 * thick
    for side in SIDES:
        thing.box(wood, side * (width - thick) / 2, 0, 0, thick, depth, height, 0.003)
    thing.box(paint.pick([wood, paint.paint()]), 0, depth / 2 - 0.006, 0.04, inside, 0.012, height - 0.04, 0.002)
    gap = (height - 0.06 - thick) / count
    for k in range(count + 1):
        z = 0.06 + k * gap
        thing.box(wood, 0, 0, z, inside, depth - 0.012, thick, 0.003)
        if k < count:
            x0, x1, y0, y1 = -width / 2 + thick + 0.01, width / 2 - thick - 0.01, -depth / 2 + 0.01, depth / 2 - 0.02
            thing.surfaces.append((x0, x1, y0, y1, z + thick, gap - thick - 0.015))
    thing.box(wood, 0, 0, 0, inside, depth - 0.04, 0.06, 0.003)
    if height < 1.5:
        thing.carry(width, depth, 0.06 + count * gap + thick, 0.02)


@piece("wall shelf")
def wall_shelf(paint, thing):
    width, depth, wood = paint.uniform(0.6, 1.0), 0.24, paint.wood()
    thing.box(wood, 0, 0, 0.06, width, depth, 0.025)
    for side in SIDES:
        thing.box(wood, side * width * 0.35, 0.06, 0, 0.02, 0.1, 0.06)
    x, y = width / 2 - 0.02, depth / 2 - 0.01
    thing.surfaces.append((-width / 2 + 0.02, x, -depth / 2 + 0.01, y, 0.085, 0.35))


@piece("cabinet")
def cabinet(paint, thing, width, depth, height, rows, columns, name="cabinet"):
    """A chest of drawers, cupboard or wardrobe with rows × columns of fronts."""
    thing.name, body = name, paint.pick([paint.wood(), paint.paint(), paint.wood()])
    front, metal = paint.pick([body, body, paint.paint(), paint.wood()]), paint.metal()
    leg = paint.pick([0.03, 0.1])
    thing.box(body, 0, 0, leg, width, depth, height - leg)
    if leg > 0.05:
        thing.legs(paint.pick([body, metal]), width, depth, leg, "taper")
    else:
        thing.box(paint.black(), 0, 0.02, 0, width - 0.04, depth - 0.06, leg)
    wide, high, bar = width / columns, (height - leg - 0.03) / rows, paint.chance(0.5)
    for column, row in product(range(columns), range(rows)):
        x, z, tall = -width / 2 + (column + 0.5) * wide, leg + 0.015 + row * high, high > wide
        thing.box(front, x, -depth / 2 - 0.007, z + 0.006, wide - 0.014, 0.018, high - 0.012, 0.004)
        handle_x = (x + (wide / 2 - 0.05) * (1 if column % 2 == 0 else -1)) if tall else x
        handle_z, y = z + high * (0.55 if tall else 0.65), -depth / 2 - 0.03
        if bar:
            dx, dz = (0, 0.07) if tall else (0.06, 0)
            thing.tube(metal, [(handle_x - dx, y, handle_z - dz), (handle_x + dx, y, handle_z + dz)], 0.007)
        else:
            thing.ball(metal, handle_x, y, handle_z, 0.014)
    if height < 1.4:
        thing.carry(width, depth, height, 0.03)


@piece("fridge")
def fridge(paint, thing):
    body = paint.pick([paint.white(), paint.metal(), paint.gloss()])
    thing.box(paint.black(), 0, 0.02, 0, 0.56, 0.54, 0.05)
    thing.box(body, 0, 0.02, 0.05, 0.6, 0.58, 1.6, 0.02, 2)
    for bottom, height in ((0.06, 1.0), (1.075, 0.565)):
        thing.box(body, 0, -0.3, bottom, 0.6, 0.05, height, 0.015, 2)
        line = [(0.24, -0.345, bottom + height * 0.35), (0.24, -0.345, bottom + height * 0.75)]
        thing.tube(paint.metal(), line, 0.011)


@piece("sofa")
def sofa(paint, thing, seats):
    """A sofa; an armchair with one seat."""
    thing.name, cloth, wood = "sofa" if seats > 1 else "armchair", paint.fabric(), paint.wood()
    arm, seat, depth = paint.uniform(0.12, 0.2), paint.uniform(0.58, 0.68), paint.uniform(0.8, 0.9)
    height = paint.uniform(0.38, 0.44)
    width, radius = seats * seat + 2 * arm, paint.uniform(0.03, 0.07)
    cushion = paint.pick([cloth, cloth, paint.fabric()])
    thing.legs(wood, width - 0.04, depth - 0.04, 0.1, "taper")
    thing.box(cloth, 0, -0.01, 0.08, width - 0.03, depth - 0.03, height - 0.2, 0.02, 2)
    for side in SIDES:
        thing.box(cloth, side * (width - arm) / 2, 0, 0.08, arm, depth, height + 0.12, radius, 3)
    thing.box(cloth, 0, depth / 2 - 0.1, 0.08, width - arm, 0.2, height + 0.34, radius, 3)
    for k in range(seats):
        x = (k - (seats - 1) / 2) * seat
        thing.box(cushion, x, -0.09, height - 0.13, seat - 0.008, depth - 0.2, 0.14, 0.04, 3)
        back = (seat - 0.012, 0.15, 0.36)
        thing.box(cushion, x, depth / 2 - 0.25, height + 0.005, *back, 0.05, 3, rotation("X", -0.12))
    x, y = seats * seat / 2 - 0.02, depth / 2 - 0.33
    thing.surfaces.append((-seats * seat / 2 + 0.02, x, -depth / 2 + 0.05, y, height + 0.0105, 0.6))


@piece("bed")
def bed(paint, thing, width):
    """A bed; its surfaces are the pillow end and the rest of the duvet."""
    wood, cloth, white, length = paint.wood(), paint.fabric(), paint.white(), 2.0
    height = paint.uniform(0.26, 0.34)
    thing.box(wood, 0, 0, 0.1, width, length, height - 0.1, 0.01)
    thing.legs(wood, width, length, 0.12, "box", 0.03)
    board = paint.pick([wood, cloth])
    thing.box(board, 0, length / 2 + 0.02, 0, width + 0.02, 0.06, paint.uniform(0.8, 1.15), 0.02, 2)
    thing.box(white, 0, -0.02, height - 0.02, width - 0.05, length - 0.08, 0.22, 0.06, 3)
    thing.box(cloth, 0, -0.3, height + 0.03, width + 0.015, length - 0.58, 0.19, 0.05, 3)
    if paint.chance(0.5):
        thing.box(paint.fabric(), 0, -length / 2 + 0.35, height + 0.02, width + 0.03, 0.5, 0.212, 0.05, 3)
    end = (-width / 2 + 0.08, width / 2 - 0.08, length / 2 - 0.5, length / 2 - 0.08, height + 0.2, 0.7)
    rest = (-width / 2 + 0.1, width / 2 - 0.1, -length / 2 + 0.7, length / 2 - 0.66, height + 0.222, 0.7)
    thing.surfaces += [end, rest]


@piece("rug")
def rug(paint, thing, width, depth):
    outer, inner = paint.fabric(), paint.fabric()
    if paint.chance(0.3):
        r = min(width, depth) / 2
        thing.turned(outer, [(0, 0), (r, 0), (r, 0.006), (r * 0.82, 0.007), (0, 0.0065)], count=40)
        thing.turned(inner, [(r * 0.8, 0.0075), (r * 0.5, 0.0075)], count=40)
    else:
        thing.box(outer, 0, 0, 0, width, depth, 0.006, 0.002)
        thing.box(inner, 0, 0, 0.001, width * 0.86, depth * 0.8, 0.0065, 0.001)


@piece("curtain")
def curtain(paint, thing, width, height):
    u, v = np.linspace(0, 1, 60)[:, None], np.linspace(0, 1, 8)[None]
    fold = 0.03 * np.sin(u * 2 * PI * round(width / 0.11)) * (0.6 + 0.4 * v)
    x = (u - 0.5) * width * (1 - 0.12 * np.sin(v * PI))
    thing.add(grid(np.stack([x, fold + 0 * v, (1 - v) * height + 0 * u], -1)), paint.fabric())


@piece("radiator")
def radiator(paint, thing):
    white, count = paint.white(), int(paint.uniform(8, 16))
    for k in range(count):
        thing.box(white, k * 0.07, 0, 0.1, 0.055, 0.08, 0.5, 0.02, 2)
    for z in (0.14, 0.52):
        thing.tube(white, [(-0.02, 0, z), (count * 0.07 - 0.05, 0, z)], 0.018)
    for k in (0, count - 1):
        thing.box(white, k * 0.07, 0, 0, 0.03, 0.03, 0.12)


@piece("door")
def door(paint, thing):
    leaf = paint.pick([paint.wood(), paint.white(), paint.paint()])
    frame = paint.pick([paint.white(), paint.wood()])
    for side in SIDES:
        thing.box(frame, side * 0.47, 0, 0, 0.07, 0.06, 2.07)
    thing.box(frame, 0, 0, 2.0, 1.01, 0.06, 0.07)
    thing.box(leaf, 0, 0.008, 0.005, 0.86, 0.04, 1.99)
    for (z, height), side in product(((0.2, 0.7), (1.1, 0.75)), SIDES):
        thing.box(leaf, side * 0.2, -0.012, z, 0.3, 0.012, height, 0.005)
    thing.tube(paint.metal(), [(0.36, -0.01, 1.0), (0.36, -0.06, 1.0), (0.26, -0.065, 1.0)], 0.011)
