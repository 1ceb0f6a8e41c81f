"""Kinds of furniture: functions that add the parts of N random pieces to a `Builder`.

A piece has up to five objects: a cupboard and its worktop, a table and its chairs.
"""

import torch

from .parts import BALL, CYLINDER

TURN = torch.pi / 2


def table(b):
    """A table, round or not, on legs or on a foot, with up to four chairs pushed in more or less."""
    half_x, half_y = b.uniform(0.3, 1.0), b.uniform(0.28, 0.55)
    round, foot = b.chance(0.2), b.chance(0.25)
    half_y = half_x.clamp(max=0.6).where(round, half_y)
    half_x = half_y.where(round, half_x)
    top, thick, leg = b.uniform(0.4, 0.78), b.uniform(0.008, 0.025), b.uniform(0.012, 0.04)
    shape = round.float() * CYLINDER
    b.add((0, 0, top - thick), (half_x, half_y, thick), shape=shape)
    inset = b.uniform(0.75, 0.96) - 0.2 * round
    for x in (-1, 1):
        for y in (-1, 1):
            at = (x * (half_x * inset - leg), y * (half_y * inset - leg), top / 2 - thick)
            b.add(at, (leg, leg, top / 2 - thick), exists=~foot)
    b.add((0, 0, top / 2 - thick), (leg * 2, leg * 2, top / 2 - thick), exists=foot, shape=CYLINDER)
    b.add((0, 0, 0.015), (half_x * 0.5, half_y * 0.5, 0.015), exists=foot, shape=shape)
    b.shelf(top, half_x * 0.95 - 0.25 * half_x * round, half_y * 0.95 - 0.25 * half_y * round)
    chairs = b.chance(0.6) & (top > 0.6)
    for member, (x, y, yaw) in enumerate([(0, -1, 0), (1, 0, TURN), (-1, 0, -TURN), (0, 1, 2 * TURN)]):
        away, along = b.uniform(0.0, 0.35), b.uniform(-0.5, 0.5)
        at_x = x * (half_x + away) + along * half_x * (x == 0)
        at_y = y * (half_y + away) + along * half_y * (y == 0)
        b.place(at_x, at_y, yaw=yaw + 2 * TURN + b.uniform(-0.3, 0.3), member=member + 1)
        _chair(b, exists=chairs & b.chance(0.5), backs=2)
    b.place()


def _chair(b, exists=True, backs=3):
    """A chair with its back towards +y; `backs` is the greatest number of bars."""
    side, seat, top = b.uniform(0.18, 0.24), b.uniform(0.4, 0.48), b.uniform(0.72, 1.0)
    leg, thick = b.uniform(0.01, 0.022), b.uniform(0.012, 0.04)
    b.add((0, 0, seat - thick), (side, side, thick), exists=exists)
    for x in (-1, 1):
        b.add((x * (side - leg), side - leg, top / 2), (leg, leg, top / 2), exists=exists)
        b.add((x * (side - leg), leg - side, seat / 2 - thick), (leg, leg, seat / 2 - thick), exists=exists)
    for bar in range(backs):
        share = (top - seat) / backs
        half = share * b.uniform(0.15, 0.45)
        at = (0, side - leg, top - share * bar - half)
        b.add(at, (side, leg * 0.7, half), exists=b.chance(0.75 if bar else 1.0) & exists)


def chair(b):
    """A single chair, or an armchair."""
    _chair(b)
    side = b.uniform(0.18, 0.24)
    arms = b.chance(0.3)
    for x in (-1, 1):
        b.add((x * (side + 0.03), 0, 0.6), (0.025, side, 0.02), exists=arms)
        b.add((x * (side + 0.03), -side * 0.8, 0.5), (0.02, 0.02, 0.1), exists=arms)
    b.shelf(0.48, 0.14, 0.14, exists=b.chance(0.3))


def bookcase(b):
    """An open shelf of two sides, boards and often a back."""
    half_x, half_y, height = b.uniform(0.2, 0.8), b.uniform(0.11, 0.22), b.uniform(0.5, 2.1)
    thick = b.uniform(0.006, 0.016)
    for x in (-1, 1):
        b.add((x * (half_x - thick), 0, height / 2), (thick, half_y, height / 2))
    b.add((0, half_y - 0.005, height / 2), (half_x, 0.005, height / 2), exists=b.chance(0.6))
    count = (height / b.uniform(0.26, 0.42)).round().clamp(1, 5)
    for board in range(6):
        z = 0.06 + board / count * (height - 0.06 - thick)
        exists = count >= board
        b.add((0, 0, z), (half_x - 2 * thick, half_y, thick), exists=exists)
        clearance = torch.where(count == board, 3.0, (height - 0.06) / count - 2 * thick)
        b.shelf(z + thick, half_x - 2 * thick - 0.01, half_y * 0.9, clearance, exists)


def counter(b):
    """Up to four cupboards in a row with doors and handles, under a worktop that is another object or the same."""
    half_y, height, unit = b.uniform(0.2, 0.33), b.uniform(0.55, 0.92), b.uniform(0.2, 0.4)
    count, apart, plinth = b.uniform(1, 5).floor(), b.chance(0.3), b.uniform(0, 0.1)
    gap, doors, handles = b.uniform(0.0, 0.006), b.chance(0.6), b.chance(0.6)
    for i in range(4):
        x = (2 * i - count + 1) * unit
        exists, member = count > i, torch.where(apart, 1.0 + i, 1.0)
        body = (height - plinth) / 2
        b.add((x, 0, plinth + body), (unit - gap, half_y, body), exists, member=member)
        b.add((x, 0.02, plinth / 2), (unit - gap, half_y - 0.04, plinth / 2), exists, member=member)
        front = (x, -half_y - 0.008, plinth + body)
        b.add(front, (unit - gap - 0.008, 0.008, body - 0.01), exists & doors, member=member)
        drop = b.uniform(0.05, 0.15)
        at = (x, -half_y - 0.03, height - drop)
        b.add(at, (unit * 0.4, 0.008, 0.007), exists & handles, member=member)
    thick, over = b.uniform(0.01, 0.025), b.uniform(0, 0.03)
    top = (count * unit + over, half_y + over, thick)
    b.add((0, -over, height + thick), top, member=torch.where(b.chance(0.75), 0.0, 1.0))
    b.shelf(height + 2 * thick, count * unit, half_y)


def wardrobe(b):
    """A tall or low cupboard or a chest with doors or drawers, a fridge."""
    half_x, half_y, height = b.uniform(0.2, 0.8), b.uniform(0.17, 0.33), b.uniform(0.5, 2.1)
    b.add((0, 0, height / 2), (half_x, half_y, height / 2))
    count, drawers, flush = b.uniform(1, 5).floor(), b.chance(0.5), b.chance(0.25)
    for i in range(4):
        middle, half = (2 * i + 1) / count - 1, 1 / count
        x, wide = torch.where(drawers, 0.0, middle * half_x), half_x * half.where(~drawers, 1.0) - 0.006
        z = torch.where(drawers, height * (middle + 1) / 2, height / 2)
        tall = height / 2 * half.where(drawers, 1.0) - 0.006
        exists = (count > i) & ~flush
        b.add((x, -half_y - 0.008, z), (wide, 0.008, tall), exists)
        knob = torch.where(drawers, x, x + wide * 0.8)
        size = (0.012 + 0.05 * drawers, 0.012, 0.012 + 0.05 * ~drawers)
        b.add((knob, -half_y - 0.025, z), size, exists)
    b.shelf(height, half_x * 0.95, half_y * 0.9, torch.where(height > 1.5, 0.5, 3.0))


def bed(b):
    """A bed with its head towards +y: frame, mattress, blanket and pillows."""
    half_x, half_y, height = b.uniform(0.4, 0.95), b.uniform(0.9, 1.05), b.uniform(0.25, 0.4)
    b.add((0, 0, height / 2), (half_x, half_y, height / 2))
    head = b.uniform(0.5, 1.1)
    b.add((0, half_y + 0.03, head / 2), (half_x, 0.03, head / 2), exists=b.chance(0.7))
    soft = b.uniform(0.06, 0.12)
    mattress = torch.where(b.chance(0.5), 1.0, 0.0)
    b.add((0, 0, height + soft), (half_x - 0.02, half_y - 0.02, soft), member=mattress)
    cover, length = b.chance(0.7), b.uniform(0.4, 0.9)
    reach = b.uniform(-0.02, 0.05)
    top = height + 2 * soft
    b.add((0, -half_y * (1 - length), top), (half_x + reach, half_y * length, 0.025), exists=cover, member=2)
    for member, x in ((3, -1), (4, 1)):
        at = (x * half_x * 0.5, half_y * 0.75, top + 0.05)
        size = (half_x * b.uniform(0.3, 0.48), b.uniform(0.14, 0.22), 0.05)
        b.add(at, size, exists=b.chance(0.8), yaw=b.uniform(-0.2, 0.2), member=member)
    b.shelf(top + 0.025, half_x * 0.8, half_y * 0.6, y=-0.3)


def sofa(b):
    """A sofa or armchair: base, back, arms, cushions of their own or of the sofa."""
    half_x, half_y, seat = b.uniform(0.4, 1.1), b.uniform(0.35, 0.48), b.uniform(0.35, 0.46)
    back, arm, thick = b.uniform(0.7, 0.95), b.uniform(0.05, 0.13), b.uniform(0.07, 0.14)
    b.add((0, 0, seat / 2), (half_x, half_y, seat / 2))
    b.add((0, half_y - thick, back / 2), (half_x, thick, back / 2))
    rise = b.uniform(0.08, 0.25)
    for x in (-1, 1):
        b.add((x * (half_x - arm), 0, (seat + rise) / 2), (arm, half_y, (seat + rise) / 2))
    own, count, gap = b.chance(0.3), b.uniform(1, 4).floor(), b.uniform(0.0, 0.008)
    inner = half_x - 2 * arm
    for i in range(3):
        x, half = ((2 * i + 1) / count - 1) * inner, inner / count - gap
        member = torch.where(own, 1.0 + i, 0.0)
        b.add((x, -thick, seat + 0.06), (half, half_y - thick, 0.06), exists=count > i, member=member)
    b.place(b.uniform(-0.7, 0.7) * inner, half_y - 2 * thick - 0.12, seat + 0.3, b.uniform(-0.4, 0.4), member=4)
    b.add((0, 0, 0), (0.2, 0.08, 0.18), exists=b.chance(0.6))
    b.place()
    b.shelf(seat + 0.12, inner * 0.8, half_y * 0.4, y=-0.1)


def stand(b):
    """A floor lamp, plant or stool: a foot, a pole or pot, and a shade, ball or seat on top."""
    height, pole, radius = b.uniform(0.4, 1.8), b.uniform(0.01, 0.03), b.uniform(0.1, 0.28)
    pot = b.chance(0.4)
    b.add((0, 0, 0.012), (radius * 0.8, radius * 0.8, 0.012), exists=~pot, shape=CYLINDER)
    b.add((0, 0, 0.14), (radius * 0.7, radius * 0.7, 0.14), exists=pot, shape=CYLINDER)
    b.add((0, 0, height / 2), (pole, pole, height / 2), shape=CYLINDER)
    flat = b.uniform(0.03, 0.2)
    round = b.chance(0.4)
    b.add((0, 0, height), (radius, radius, flat), exists=~round, shape=CYLINDER)
    for _ in range(3):
        at = (b.uniform(-0.1, 0.1), b.uniform(-0.1, 0.1), height + b.uniform(-0.1, 0.1))
        b.add(at, (radius, radius * b.uniform(0.4, 1), radius * b.uniform(0.4, 1)), exists=round, shape=BALL)


def crate(b):
    """One to four boxes, bins or suitcases on each other and side by side."""
    z = 0.0
    wide, deep = b.uniform(0.12, 0.35), b.uniform(0.12, 0.3)
    for i in range(4):
        half = (wide * b.uniform(0.7, 1), deep * b.uniform(0.7, 1), b.uniform(0.06, 0.25))
        shape = torch.where(b.chance(0.15), float(CYLINDER), 0.0)
        exists = b.chance(0.55 if i else 1.0)
        b.add((b.uniform(-0.05, 0.05), b.uniform(-0.04, 0.04), z + half[2]), half, exists, shape, member=i)
        z = z + 2 * half[2] * exists
    b.shelf(z, wide * 0.6, deep * 0.6)


def pillar(b):
    """A projection of the wall, a partition or a column, from the floor to above every ceiling."""
    half = (b.uniform(0.06, 0.6), b.uniform(0.05, 0.3), 2.0)
    b.add((0, 0, 2.0), half, shape=torch.where(b.chance(0.15), float(CYLINDER), 0.0))


# Kind, share of the pieces, probability of standing with its back to a wall.
KINDS = (
    (table, 0.2, 0.4),
    (chair, 0.1, 0.2),
    (bookcase, 0.14, 0.95),
    (counter, 0.14, 0.95),
    (wardrobe, 0.13, 0.97),
    (bed, 0.05, 0.9),
    (sofa, 0.07, 0.75),
    (stand, 0.06, 0.6),
    (crate, 0.08, 0.6),
    (pillar, 0.03, 0.8),
)
