"""Small objects, pictures, lamps and screens: functions that take the room's Paint and return a finished Thing."""

import math

import numpy as np

from .geometry import PI, SIDES, TAU, grid, lathe, piece, rotation, rounded_box, superellipsoid
from .materials import Pattern


@piece("clock")
def clock(paint, thing):
    r, upright = paint.uniform(0.12, 0.18), rotation("X", PI / 2)
    rim = [(0, 0), (r, 0), (r, 0.035), (r * 0.9, 0.035), (r * 0.88, 0.02), (0, 0.02)]
    thing.add(lathe(rim, 32), paint.pick([paint.gloss(), paint.wood(), paint.metal()]), turn=upright)
    thing.add(lathe([(r * 0.88, 0.021), (0, 0.0215)], 32), paint.white(), turn=upright)
    for angle, length in ((paint.uniform(0, 6), 0.5), (paint.uniform(0, 6), 0.75)):
        middle = (math.sin(angle) * r * length / 2, -0.025, math.cos(angle) * r * length / 2)
        thing.add(rounded_box(0.008, 0.004, r * length, 0.001), paint.black(), middle, rotation("Y", angle))
    for angle in np.arange(12) * TAU / 12:
        x, z = math.sin(angle) * r * 0.76, math.cos(angle) * r * 0.76 - 0.006
        thing.box(paint.black(), x, -0.022, z, 0.008, 0.004, 0.012, 0.001)


@piece("picture")
def picture(paint, thing, width, height, standing=False):
    """A framed picture for a wall, or a standing photo for a table."""
    frame = paint.pick([paint.wood(), paint.metal(), paint.black(), paint.white()])
    depth, bar = 0.02, min(width, height) * 0.07
    thing.name, tilt = ("photo", rotation("X", -0.2)) if standing else ("picture", np.eye(3))

    def put(material, x, y, z, *size):
        thing.add(rounded_box(*size, 0.003), material, tilt @ [x, y, z], tilt)

    for side in SIDES:
        put(frame, side * (width - bar) / 2, 0, 0, bar, depth, height)
        put(frame, 0, 0, side * (height - bar) / 2, width - 2 * bar, depth, bar)
    inner_width, inner_height = width - 2 * bar, height - 2 * bar
    put(paint.white() if paint.chance(0.5) else frame, 0, 0.004, 0, inner_width, 0.008, inner_height)
    put(paint.art(), 0, -0.002, 0, inner_width * 0.86, 0.006, inner_height * 0.86)
    if standing:
        put(paint.black(), 0, 0.05, -0.02, 0.03, 0.1, 0.004)


@piece("lamp")
def lamp(paint, thing, floor):
    """A lamp with a shade, for tables or the floor."""
    base = paint.pick([paint.metal(), paint.wood(), paint.ceramic()])
    tints = [(0.9, 0.8, 0.62), (0.85, 0.85, 0.8), paint.colour(saturation=(0.2, 0.5), value=(0.7, 0.9))]
    shade = paint.material("plain", paint.pick(tints), rough=0.9, glow=paint.uniform(0.4, 1.1))
    bounds = ((1.35, 1.65), (0.16, 0.22)) if floor else ((0.32, 0.46), (0.09, 0.13))
    height, r = (paint.uniform(*bound) for bound in bounds)
    shade_height = r * paint.uniform(1.1, 1.5)
    if floor or paint.chance(0.4):
        foot = [(r * 0.8, 0), (r * 0.75, 0.02), (0.012, 0.035)]
    else:
        foot = [(r * 0.5, 0), (r * 0.75, height * 0.18), (r * 0.45, height * 0.42), (0.012, height * 0.5)]
    neck = height - shade_height * 0.4
    thing.turned(base, [(0, 0), *foot, (0.012, neck), (0, neck)])
    narrow, bottom = paint.uniform(0.6, 0.95), height - shade_height
    outline = [(r, bottom), (r * narrow, height), (r * narrow - 0.004, height), (r - 0.004, bottom)]
    thing.turned(shade, outline, count=28)
    watts = paint.uniform(12, 30) if floor else paint.uniform(5, 12)
    thing.lights.append(((0, 0, height - shade_height * 0.3), watts, (1, 0.82, 0.6), 0.04))


@piece("screen")
def screen(paint, thing, width, kind):
    """A screen; `kind` is "laptop", "monitor" or "tv"."""
    thing.name, height, black = kind, width * 0.58, paint.black()
    if paint.chance(0.6):
        image = paint.art(screen=True, glow=0.5)
    else:
        image = paint.material("plain", (0.02, 0.02, 0.025), rough=0.08)
    if kind == "laptop":
        body = paint.pick([paint.metal(), paint.black(), paint.white()])
        thing.box(body, 0, 0, 0, width, width * 0.68, 0.016, 0.004)
        thing.box(black, 0, 0.05 * width, 0.0155, width * 0.88, width * 0.32, 0.003, 0.001)
        lid, middle = rotation("X", -0.28), np.array([0, width * 0.34 + 0.045, 0.012 + height / 2])
        thing.add(rounded_box(width, 0.01, height, 0.003), body, middle, lid)
        front = middle + lid @ [0, -0.0055, 0]
        thing.add(rounded_box(width * 0.94, 0.003, height * 0.9, 0.001), image, front, lid)
    else:
        z = 0.1 if kind == "monitor" else 0.06
        thing.box(black, 0, 0.02, 0, width * 0.4, 0.16, 0.012)
        thing.box(black, 0, 0.04, 0.01, 0.06, 0.03, height * 0.6 + z)
        thing.box(black, 0, 0, z, width, 0.03, height)
        thing.box(image, 0, -0.0155, z + 0.012, width - 0.025, 0.003, height - 0.024, 0.001)


@piece("keyboard")
def keyboard(paint, thing):
    thing.box(paint.pick([paint.black(), paint.white()]), 0, 0, 0, 0.42, 0.14, 0.018, 0.004)
    keys = paint.material("checker", (0.03, 0.03, 0.03), (0.25, 0.25, 0.25), Pattern(50), 0.6)
    thing.box(keys, 0, 0, 0.018, 0.39, 0.115, 0.004, 0.001)


@piece("speaker")
def speaker(paint, thing):
    body, height = paint.pick([paint.wood(), paint.black()]), paint.uniform(0.22, 0.34)
    width = height * 0.62
    thing.box(body, 0, 0, 0, width, width, height)
    for z, radius in ((0.32, 0.36), (0.75, 0.2)):
        r = radius * width
        cone = lathe([(r, 0), (r * 0.9, 0.006), (r * 0.3, -0.004), (0, 0.008)])
        thing.add(cone, paint.metal(), (0, -width / 2, height * z), rotation("X", PI / 2))


@piece("book")
def book(paint, thing, flat=False):
    cover, thick = paint.cover(), paint.uniform(0.03, 0.06)
    depth, height = paint.uniform(0.15, 0.2), paint.uniform(0.19, 0.27)
    for side in SIDES:
        thing.box(cover, side * (thick / 2 - 0.002), 0, 0, 0.004, depth, height, 0.001)
    thing.box(cover, 0, -depth / 2 + 0.003, 0, thick, 0.006, height, 0.002)
    thing.box(paint.white(), 0, 0.003, 0.004, thick - 0.007, depth - 0.012, height - 0.008, 0.001)
    label = paint.cover()
    for z in (0.12, paint.uniform(0.6, 0.8)):
        size = (thick * 0.9, 0.006, height * paint.uniform(0.05, 0.16))
        thing.box(label, 0, -depth / 2 + 0.001, height * z, *size, 0.001)
    if flat:
        turn = rotation("Y", PI / 2)
        thing.parts = [(points @ turn.T, normals @ turn.T, *rest) for points, normals, *rest in thing.parts]


@piece("mug")
def mug(paint, thing):
    glaze, r, h = paint.ceramic(), paint.uniform(0.038, 0.046), paint.uniform(0.085, 0.11)
    outline = [(0, 0), (r * 0.9, 0), (r, 0.01), (r, h), (r - 0.006, h), (r - 0.007, 0.012), (0, 0.01)]
    thing.turned(glaze, outline)
    a = np.linspace(-1.4, 1.4, 8)
    handle = np.stack([r - 0.004 + 0.03 * np.cos(a), 0 * a, h / 2 + 0.032 * np.sin(a)], 1)
    thing.tube(glaze, handle, 0.007)


@piece("bottle")
def bottle(paint, thing):
    r, h = paint.uniform(0.032, 0.045), paint.uniform(0.2, 0.32)
    outline = [(0, 0), (r, 0), (r, h * 0.58), (r * 0.85, h * 0.66), (r * 0.4, h * 0.78), (r * 0.36, h * 0.93)]
    thing.turned(paint.gloss(), [*outline, (0, h * 0.93)])
    thing.cylinder(paint.gloss(), 0, 0, h * 0.9, r * 0.42, h * 0.1)
    thing.turned(paint.ceramic(), [(r + 0.001, h * 0.2), (r + 0.001, h * 0.48)])


@piece("bowl")
def bowl(paint, thing):
    r, h = paint.uniform(0.08, 0.15), paint.uniform(0.05, 0.08)
    outside = [(0, 0), (r * 0.45, 0), (r * 0.8, h * 0.4), (r, h)]
    inside = [(r - 0.008, h), (r * 0.75, h * 0.45), (r * 0.4, 0.012), (0, 0.01)]
    thing.turned(paint.ceramic(), outside + inside, count=24)


@piece("plate")
def plate(paint, thing):
    r = paint.uniform(0.1, 0.13)
    outline = [(0, 0), (r * 0.6, 0), (r, 0.018), (r, 0.022), (r * 0.62, 0.007), (0, 0.006)]
    thing.turned(paint.ceramic(), outline, count=24)


@piece("vase")
def vase(paint, thing):
    h, r, t = paint.uniform(0.18, 0.36), paint.uniform(0.05, 0.08), np.linspace(0, 1, 10)
    radii = r * (0.6 + 0.5 * np.sin(t * PI * paint.uniform(0.9, 1.3) + paint.uniform(-0.2, 0.4)))
    inside = [(radii[-1] - 0.008, h), (radii[-1] - 0.01, h * 0.8), (0, h * 0.8)]
    thing.turned(paint.ceramic(), [(0, 0), *zip(radii, t * h), *inside])


@piece("can")
def can(paint, thing):
    r, h = paint.uniform(0.033, 0.05), paint.uniform(0.1, 0.14)
    outline = [(0, 0), (r * 0.93, 0), (r, 0.006), (r, h - 0.006), (r * 0.93, h), (0, h - 0.004)]
    thing.turned(paint.metal(), outline)
    thing.turned(paint.gloss(), [(r + 0.0007, h * 0.12), (r + 0.0007, h * 0.88)])


@piece("fruit")
def fruit(paint, thing):
    r = paint.uniform(0.033, 0.045)
    colour = paint.colour(paint.pick([0.02, 0.08, 0.14, 0.27]), (0.7, 0.95), (0.55, 0.9))
    thing.ball(paint.material("noise", colour, None, Pattern(30), 0.35), 0, 0, 0, r)
    thing.tube(paint.wood(), [(0, 0, 2 * r - 0.004), (0.004, 0, 2 * r + 0.012)], 0.003)


@piece("ball")
def ball(paint, thing, radius=None):
    texture = paint.pick(["stripes", "plain", "noise", "stripes"])
    r = radius or paint.uniform(0.08, 0.14)
    colour = paint.colour(saturation=(0.5, 0.95), value=(0.4, 0.9))
    second = paint.colour(saturation=(0.1, 0.9), value=(0.5, 0.95))
    material = paint.material(texture, colour, second, Pattern(0.35 / r), paint.uniform(0.2, 0.6))
    thing.ball(material, 0, 0, 0, r)


@piece("block")
def block(paint, thing):
    size = paint.uniform(0.06, 0.1)
    thing.box(paint.gloss(), 0, 0, 0, size, size, size, 0.006, 2)


@piece("box")
def box(paint, thing, size=None):
    """A cardboard box with tape and a label, or a box with a lid."""
    size = size or paint.uniform(0.12, 0.24)
    width, depth = size * paint.uniform(0.8, 1.3), size * paint.uniform(0.7, 1.0)
    height, kind = size * paint.uniform(0.5, 1.0), paint.uniform(0, 1)
    body = paint.card() if kind < 0.5 else paint.paint() if kind < 0.75 else paint.fabric()
    thing.box(body, 0, 0, 0, width, depth, height, 0.003)
    if kind < 0.5:
        tape = paint.material("plain", (0.62, 0.5, 0.3), rough=0.3)
        thing.box(tape, 0, 0, height - 0.001, 0.05, depth * 0.99, 0.003, 0.001)
        label = (width * 0.3, 0.003, height * 0.3)
        thing.box(paint.white(), width * 0.2, -depth / 2, height * 0.45, *label, 0.001)
    else:
        thing.box(paint.paint(), 0, 0, height * 0.82, width + 0.008, depth + 0.008, height * 0.2, 0.003)


@piece("bin")
def bin(paint, thing, radius=None):
    r = radius or paint.uniform(0.12, 0.17)
    h = r * paint.uniform(1.9, 2.5)
    plain = [paint.gloss(), paint.metal()]
    weave = (paint.colour(0.08, (0.4, 0.6), (0.4, 0.7)), paint.colour(0.08, (0.4, 0.6), (0.2, 0.4)))
    material = paint.pick([*plain, paint.material("checker", *weave, Pattern(25), 0.8)])
    outline = [(0, 0), (r * 0.78, 0), (r, h), (r - 0.01, h), (r * 0.76, 0.02), (0, 0.02)]
    thing.turned(material, outline, count=24)


@piece("plant")
def plant(paint, thing, height, pot=None):
    """A plant in a pot; `pot` is the pot's radius."""
    r = pot or height * 0.16
    pot_height, leaf, s = r * paint.uniform(1.4, 2.0), paint.leaf(), np.linspace(0, 1, 7)
    inside = [(r * 0.9, pot_height), (r * 0.86, pot_height * 0.88), (0, pot_height * 0.88)]
    thing.turned(paint.ceramic(), [(0, 0), (r * 0.75, 0), (r, pot_height), *inside])
    soil = paint.material("noise", (0.05, 0.03, 0.02), (0.09, 0.06, 0.04), Pattern(40), 0.95)
    thing.turned(soil, [(r * 0.87, pot_height * 0.87), (0, pot_height * 0.9)])
    wide, steep = paint.uniform(0.05, 0.16), paint.uniform(0.6, 1.25)
    for k in range(int(paint.uniform(11, 20))):
        angle, length = k * 2.4 + paint.uniform(-0.3, 0.3), (height - pot_height) * paint.uniform(0.6, 1.0)
        rise = steep * paint.uniform(0.75, 1.15)
        cos, sin = math.cos(angle), math.sin(angle)
        away = length * 0.62 * s * math.cos(min(rise, 1.45)) + 0.02
        z = pot_height * 0.85 + length * (math.sin(rise) * 1.05 * s - 0.28 * s**2)
        half = wide * length * np.sin(PI * np.clip(s, 0.03, 0.97)) ** 0.8
        middle, side = np.stack([cos * away, sin * away, z], 1), np.stack([-sin * half, cos * half, 0 * half], 1)
        thing.add(grid(np.stack([middle - side, middle - [0, 0, 0.008], middle + side])), leaf)


@piece("suitcase")
def suitcase(paint, thing):
    body = paint.pick([paint.gloss(), paint.fabric()])
    width, depth, height = paint.uniform(0.36, 0.44), paint.uniform(0.2, 0.25), paint.uniform(0.5, 0.64)
    thing.box(body, 0, 0, 0.05, width, depth, height, 0.05, 3)
    for k in (-1, 0, 1):
        thing.box(paint.black(), k * width * 0.28, -depth / 2, 0.12, 0.02, 0.012, height - 0.14, 0.003)
    for side in SIDES:
        thing.ball(paint.black(), side * width * 0.38, 0, 0, 0.03)
        thing.tube(paint.metal(), [(side * 0.08, 0.03, height), (side * 0.08, 0.03, height + 0.14)], 0.007)
    thing.tube(paint.black(), [(-0.09, 0.03, height + 0.14), (0.09, 0.03, height + 0.14)], 0.013)


@piece("backpack")
def backpack(paint, thing):
    body, pocket, a = paint.fabric(), paint.fabric(), np.linspace(-1.2, 1.2, 7)
    thing.add(superellipsoid(0.16, 0.1, 0.22, 0.5, 0.6), body, (0, 0, 0.22))
    thing.add(superellipsoid(0.12, 0.05, 0.1, 0.5, 0.5), pocket, (0, -0.09, 0.14))
    for side in SIDES:
        strap = np.stack([0 * a + side * 0.08, 0.07 + 0.06 * np.cos(a), 0.22 + 0.15 * np.sin(a)], 1)
        thing.tube(pocket, strap, 0.014)


@piece("teddy")
def teddy(paint, thing):
    fur, white = paint.fabric(), paint.white()

    def part(material, half, at, turn=None, exponent=1):
        thing.add(superellipsoid(*half, exponent, exponent), material, at, turn)

    part(fur, (0.085, 0.075, 0.1), (0, 0, 0.1), exponent=0.9)
    part(fur, (0.07, 0.065, 0.065), (0, -0.01, 0.25))
    part(white, (0.03, 0.025, 0.025), (0, -0.07, 0.24))
    for side in SIDES:
        part(fur, (0.026, 0.016, 0.026), (side * 0.055, 0, 0.31))
        part(fur, (0.034, 0.07, 0.034), (side * 0.055, -0.09, 0.034), rotation("Z", -side * 0.3))
        part(fur, (0.028, 0.03, 0.065), (side * 0.095, -0.03, 0.13), rotation("Y", -side * 0.5))
        part(paint.black(), (0.008, 0.008, 0.008), (side * 0.028, -0.07, 0.265))


@piece("shoe")
def shoe(paint, thing):
    thing.add(superellipsoid(0.045, 0.13, 0.022, 0.3, 0.7), paint.white(), (0, 0, 0.022))
    thing.add(superellipsoid(0.042, 0.1, 0.045, 0.6, 0.7), paint.fabric(), (0, -0.022, 0.055))
    thing.add(superellipsoid(0.038, 0.05, 0.05, 0.5, 0.7), paint.fabric(), (0, 0.06, 0.075))


@piece("cushion")
def cushion(paint, thing):
    size = paint.uniform(0.36, 0.46)
    body = superellipsoid(size / 2, size / 2, 0.07, 0.7, 0.3)
    thing.add(body, paint.fabric(), turn=rotation("X", PI / 2 - 0.3))


@piece("pillow")
def pillow(paint, thing):
    body = superellipsoid(paint.uniform(0.28, 0.34), 0.2, 0.065, 0.75, 0.35)
    thing.add(body, paint.pick([paint.white(), paint.fabric()]))
