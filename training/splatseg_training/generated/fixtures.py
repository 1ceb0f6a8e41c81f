"""Kinds of things on walls, at their height above the floor and with their back towards +y; see `pieces`."""

import torch


def door(b):
    """A door with a frame and a handle, closed."""
    half_x, height, thick = b.uniform(0.33, 0.5), b.uniform(1.9, 2.15), b.uniform(0.008, 0.03)
    b.add((0, -thick, height / 2), (half_x, thick, height / 2))
    frame, member = b.uniform(0.03, 0.06), torch.where(b.chance(0.5), 1.0, 0.0)
    deep = thick + b.uniform(-0.005, 0.03)
    for x in (-1, 1):
        b.add((x * (half_x + frame), -deep, height / 2), (frame, deep, height / 2), member=member)
    b.add((0, -deep, height + frame), (half_x + 2 * frame, deep, frame), member=member)
    b.add((half_x * 0.85, -2 * thick - 0.03, 1.0), (0.06, 0.012, 0.012))
    glass = b.chance(0.2)
    b.add((0, -2 * thick, height * 0.6), (half_x * 0.6, 0.003, height * 0.25), exists=glass, member=2)


def window(b):
    """A window: panes that stand back from a frame, and a sill."""
    half_x, half_z, middle = b.uniform(0.3, 0.9), b.uniform(0.35, 0.7), b.uniform(1.3, 1.6)
    frame, deep = b.uniform(0.02, 0.05), b.uniform(0.01, 0.05)
    b.add((0, -0.003, middle), (half_x, 0.003, half_z), member=torch.where(b.chance(0.3), 0.0, 1.0))
    for side in (-1, 1):
        b.add((side * half_x, -deep, middle), (frame, deep, half_z + frame))
        b.add((0, -deep, middle + side * half_z), (half_x, deep, frame))
    b.add((0, -deep, middle), (frame, deep, half_z), exists=b.chance(0.6))
    b.add((0, -0.08, middle - half_z - frame), (half_x + 0.05, 0.08, 0.012), exists=b.chance(0.5))


def picture(b):
    """A picture, poster, mirror, flat screen, board, paper or switch."""
    size = b.log_uniform(0.06, 0.55)
    half_x, half_z = size, size * b.log_uniform(0.45, 1.6)
    thick, middle = b.log_uniform(0.0008, 0.03), b.uniform(0.9, 1.8)
    b.add((0, -thick, middle), (half_x, thick, half_z))
    framed, frame = b.chance(0.4), b.uniform(0.008, 0.03)
    for side in (-1, 1):
        b.add((side * half_x, -thick - 0.006, middle), (frame, thick + 0.006, half_z + frame), exists=framed)
        b.add((0, -thick - 0.006, middle + side * half_z), (half_x, thick + 0.006, frame), exists=framed)


def notes(b):
    """Three to five papers or posters in a loose row."""
    step, middle = b.uniform(0.15, 0.4), b.uniform(1.0, 1.7)
    for i in range(5):
        half = (step * b.uniform(0.25, 0.49), b.log_uniform(0.0006, 0.006), b.uniform(0.08, 0.22))
        at = (i * step, -half[1], middle + b.uniform(-0.08, 0.08))
        b.add(at, half, exists=b.chance(1.0 if i < 3 else 0.5), member=i)


def cupboards(b):
    """One to three hanging cupboards, of one object or several."""
    half_x, half_y, half_z = b.uniform(0.18, 0.4), b.uniform(0.1, 0.2), b.uniform(0.18, 0.42)
    middle, count, apart = b.uniform(1.5, 1.9), b.uniform(1, 4).floor(), b.chance(0.4)
    doors = b.chance(0.6)
    for i in range(3):
        x, exists = (2 * i - count + 1) * half_x, count > i
        member = torch.where(apart, float(i), 0.0)
        b.add((x, -half_y, middle), (half_x - 0.001, half_y, half_z), exists, member=member)
        front = (x, -2 * half_y - 0.008, middle)
        b.add(front, (half_x - 0.006, 0.008, half_z - 0.004), exists & doors, member=member)
    b.shelf(middle + half_z, half_x * count, half_y * 0.8, 0.5, y=-half_y)


def board(b):
    """One or two boards with things, or a radiator."""
    half_x, half_y, z, thick = b.uniform(0.2, 0.8), b.uniform(0.06, 0.16), b.uniform(1.0, 1.7), b.uniform(0.006, 0.02)
    gap, second = b.uniform(0.28, 0.4), b.chance(0.4)
    for i, exists in enumerate((b.chance(1.0), second)):
        b.add((0, -half_y, z + i * gap), (half_x, half_y, thick), exists, member=i)
        clearance = torch.where(second, gap - 2 * thick, 0.6) if i == 0 else 0.4
        b.shelf(z + i * gap + thick, half_x, half_y * 0.9, clearance, exists, y=-half_y)


def radiator(b):
    """A radiator or a box low on the wall."""
    half_x, half_z, half_y = b.uniform(0.2, 0.7), b.uniform(0.15, 0.35), b.uniform(0.02, 0.07)
    b.add((0, -half_y, 0.12 + half_z), (half_x, half_y, half_z))
    for i in range(3):
        b.add(((i - 1) * half_x * 0.6, -2 * half_y - 0.006, 0.12 + half_z), (half_x * 0.2, 0.006, half_z * 0.95))


OPENINGS = ((door, 0.6, 1.0), (window, 0.4, 1.0))
KINDS = (
    (picture, 0.4, 1.0),
    (notes, 0.15, 1.0),
    (cupboards, 0.17, 1.0),
    (board, 0.18, 1.0),
    (radiator, 0.05, 1.0),
    (window, 0.05, 1.0),
)
