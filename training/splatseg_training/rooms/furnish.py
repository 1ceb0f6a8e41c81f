"""Furnishes a room: furniture groups for the kind of room, things on walls and floor, and small objects."""

from . import furniture, things
from .catalogue import STANDS_ON
from .geometry import PI, SIDES


def furnish(room):
    """Furnishes a room with a finished shell; sets its kind."""
    paint = room.paint
    room.kind = kind = paint.pick(["living", "bedroom", "office", "dining", "studio"])
    if kind in ("living", "studio"):
        seats = 3 if kind == "living" and max(room.width, room.depth) > 4.6 else 2
        lounge(room, seats, 1 if kind == "studio" else 2)
    if kind in ("bedroom", "studio"):
        sleep(room, paint.pick([0.95, 1.4, 1.6]) if kind == "bedroom" else 0.95)
    if kind == "bedroom":
        room.at_wall(room.choose("wardrobe", lambda: _wardrobe(paint)))
        chests(room)
    if kind == "office":
        desks(room, int(paint.uniform(2, 4)))
        shelves(room, 2)
        chests(room, 2)
        dine(room, paint.uniform(0.8, 1.2), paint.uniform(0.7, 0.8), 3)
    if kind == "dining":
        dine(room, paint.uniform(1.3, 1.8), paint.uniform(0.8, 0.95), 6)
        room.at_wall(room.choose("fridge", lambda: furniture.fridge(paint)))
        chests(room, 2)
    if kind != "office" and paint.chance(0.75):
        desks(room, 1)
    if kind == "studio":
        dine(room, paint.uniform(0.75, 0.9), paint.uniform(0.7, 0.8), 2)
    shelves(room, 2 if kind != "office" else 1)
    chests(room)
    if kind != "living" and paint.chance(0.7):
        rug = room.choose("rug", lambda: furniture.rug(paint, paint.uniform(1.3, 2.0), paint.uniform(0.9, 1.4)))
        x, y = (paint.uniform(size * 0.4, size * 0.6) for size in (room.width, room.depth))
        room.place(rug, x, y, 0.0012, paint.pick([0, PI / 2, 0.3]))
    if room.library is not None:
        fixtures(room)
    hang(room)
    for _ in range(int(paint.uniform(6, 13))):
        drop(room)
    room.fill()


def _wardrobe(paint):
    size = (paint.uniform(0.9, 1.5), paint.uniform(0.52, 0.6), paint.uniform(1.8, 2.1))
    return furniture.cabinet(paint, *size, 1, int(paint.uniform(2, 4)), "wardrobe")


def shelves(room, count):
    """Places shelves at the walls, often of the same model."""
    paint = room.paint

    def make(heights, compartments, widths):
        size = (paint.uniform(*widths), paint.uniform(0.25, 0.32), paint.uniform(*heights))
        return furniture.shelf(paint, *size, int(paint.uniform(*compartments)))

    model = room.choose("shelf", lambda: make((1.0, 2.0), (3, 6), (0.6, 1.1)))
    for _ in range(count):
        thing = model if paint.chance(0.6) else make((0.8, 1.9), (2, 5), (0.6, 1.0))
        room.to_fill(room.at_wall(thing), "shelf")


def chests(room, count=1, low=False):
    """Places equal chests of drawers at the walls; returns them, with None for each that found no place."""
    paint = room.paint

    def make():
        heights = (0.45, 0.6) if low else (0.65, 1.0)
        size = (paint.uniform(0.7, 1.4), paint.uniform(0.38, 0.48), paint.uniform(*heights))
        return furniture.cabinet(paint, *size, int(paint.uniform(1, 4)), int(paint.uniform(1, 4)))

    model = room.choose("cabinet", make)
    return [room.to_fill(room.at_wall(model), "cabinet") for _ in range(count)]


def seat(room, chair, table, x, y, yaw):
    """Places a chair at a table, possibly partly under it; the position is in the table's plan."""
    turn = table.yaw + yaw + room.paint.uniform(-0.35, 0.35) * room.paint.chance(0.6)
    place = (*table.to_room(x, y), turn, chair.width / 2, chair.depth / 2)
    if room.is_free(place, 0.02, ignored=[table.footprint]):
        room.place(chair, place[0], place[1], 0, turn, True)


def desks(room, count):
    """Places desks with a monitor, a keyboard and a chair."""
    paint = room.paint

    def make():
        return furniture.table(paint, paint.uniform(1.2, 1.5), paint.uniform(0.6, 0.7), paint.uniform(0.71, 0.75), True)

    desk = room.choose("desk", make)
    chair = room.choose("chair", lambda: furniture.chair(paint, paint.pick(["office", "office", None])))
    for _ in range(count):
        placed = room.at_wall(desk)
        if placed and desk.surfaces:
            top, knee = len(desk.surfaces) - 1, desk.knee_x
            y0, y1 = desk.surfaces[top][2:4]
            monitor = (knee + paint.uniform(-0.1, 0.1), y1 - 0.13)
            room.put(placed, top, "monitor", monitor, paint.uniform(-0.15, 0.15))
            keyboard = (knee + paint.uniform(-0.08, 0.08), y0 + 0.12)
            room.put(placed, top, "keyboard", keyboard, paint.uniform(-0.1, 0.1))
            room.to_fill(placed, "desk")
            x = knee + paint.uniform(-0.04, 0.04)
            seat(room, chair, placed, x, -desk.depth / 2 - paint.uniform(0.08, 0.3), PI)


def dine(room, width, depth, count):
    """Places a table with up to `count` chairs."""
    paint = room.paint
    table = room.choose("table", lambda: furniture.table(paint, width, depth, paint.uniform(0.72, 0.76)))
    chair = room.choose("chair", lambda: furniture.chair(paint, paint.pick(["slat", "panel", "shell"])))
    placed = room.on_floor(table, 80, 0.55, paint.pick([0, PI / 2]), 0.3)
    placed = room.to_fill(placed or room.on_floor(table, 80, 0.3, paint.pick([0, PI / 2])), "table")
    if placed:
        places = SIDES if table.width > 1.1 else (0,)
        spots = [
            (x * table.width * 0.23, side * (table.depth / 2 + paint.uniform(0.04, 0.2)), PI if side < 0 else 0)
            for side in SIDES
            for x in places
        ]
        spots += [(side * (table.width / 2 + paint.uniform(0.04, 0.15)), 0, -PI / 2 * side) for side in SIDES]
        for x, y, yaw in spots[:count]:
            seat(room, chair, placed, x, y, yaw)


def lounge(room, seats, armchairs):
    """Places a sofa with a rug, a low table and a television, and armchairs."""
    paint = room.paint
    sofa = room.at_wall(room.choose("sofa", lambda: furniture.sofa(paint, seats)))
    if sofa:
        room.to_fill(sofa, "soft")  # twice, because a seat has room for two
        room.to_fill(sofa, "soft")
        size = ((0.8, 1.1), (0.5, 0.6), (0.36, 0.45))
        table = room.choose("low table", lambda: furniture.table(paint, *(paint.uniform(*bounds) for bounds in size)))
        off = paint.uniform(-0.1, 0.1)
        x, y = sofa.to_room(off, -sofa.thing.depth / 2 - paint.uniform(0.35, 0.5) - table.depth / 2)
        rug = room.choose("rug", lambda: furniture.rug(paint, paint.uniform(1.6, 2.2), paint.uniform(1.2, 1.6)))
        room.place(rug, x, y, 0.0006, sofa.yaw)
        if room.is_free((x, y, sofa.yaw, table.width / 2, table.depth / 2)):
            room.to_fill(room.place(table, x, y, 0, sofa.yaw, True), "table")
        chest = chests(room, low=True)[0]
        if chest and chest.thing.surfaces:
            room.put(chest, len(chest.thing.surfaces) - 1, "tv", (0, 0.06), 0)
    for _ in range(armchairs):
        armchair = room.choose("armchair", lambda: furniture.sofa(paint, 1))
        room.to_fill(room.on_floor(armchair, 40, 0.2), "soft")


def sleep(room, width):
    """Places a bed with pillows and nightstands."""
    paint = room.paint
    bed = room.choose("bed", lambda: furniture.bed(paint, width))
    placed = room.at_wall(bed, tries=150)
    if not placed:
        return
    sides = SIDES if bed.width > 1.3 else (0,)
    if bed.imported:
        room.to_fill(placed, "bed")
    else:
        for side in sides:
            middle = (side * bed.width / 4, sum(bed.surfaces[0][2:4]) / 2)
            room.put(placed, 0, "pillow", middle, paint.uniform(-0.15, 0.15))
        room.surfaces.append((placed, 1, "bed"))

    def make():
        return furniture.cabinet(paint, 0.42, 0.38, paint.uniform(0.42, 0.55), 2, 1, "nightstand")

    stand = room.choose("nightstand", make)
    beside = 0.05 + (stand.width / 2 if stand.imported else 0.21)
    for side in SIDES:
        x, y = placed.to_room(side * (bed.width / 2 + beside), bed.depth / 2 - stand.depth / 2)
        if room.is_free((x, y, placed.yaw, stand.width / 2, stand.depth / 2), 0.01):
            stood = room.place(stand, x, y, 0, placed.yaw, True)
            if stand.surfaces:
                room.put(stood, len(stand.surfaces) - 1, "tlamp", (0.05, 0.06))
            room.to_fill(stood, "cabinet")


def fixtures(room):
    """Places imported kitchen and bathroom pieces at the walls."""
    for _ in range(int(room.paint.uniform(0, 3))):
        thing = room.library.piece("fixture", room.paint)
        if thing is not None:
            room.to_fill(room.at_wall(thing), "cabinet")


def hang(room):
    """Hangs a radiator under the window, pictures, and perhaps a clock and wall shelves."""
    paint = room.paint
    room.at_wall(furniture.radiator(paint), walls=[room.window_wall])
    for _ in range(int(paint.uniform(3, 8))):
        room.at_wall(room.model("picture"), heights=(1.15, 1.6), gap=0.06)
    if paint.chance(0.6):
        room.at_wall(things.clock(paint), heights=(1.7, 1.9))
    for _ in range(int(paint.uniform(0, 3))):
        shelf = room.choose("wall shelf", lambda: furniture.wall_shelf(paint))
        room.to_fill(room.at_wall(shelf, heights=(1.2, 1.5)), "shelf")


def drop(room):
    """Puts something on the floor: shoes in pairs, boxes sometimes with another one on top."""
    paint = room.paint
    name = paint.pick(STANDS_ON["floor"])
    thing = room.model(name)
    placed = room.on_floor(thing, 25)
    if not placed:
        return
    if name == "shoe":
        x, y = placed.to_room(0.12, paint.uniform(-0.03, 0.03))
        if room.is_free((x, y, placed.yaw, thing.width / 2, thing.depth / 2), 0):
            room.place(thing, x, y, 0, placed.yaw + paint.uniform(-0.2, 0.2), True)
    if name == "bigbox" and not thing.imported and paint.chance(0.4):
        box = room.model("box")
        if box.width < thing.width and box.depth < thing.depth:
            room.place(box, placed.x, placed.y, thing.height + 0.0008, placed.yaw + paint.uniform(-0.4, 0.4))
