"""Kinds of small things that stand and lie on surfaces and on each other; see `pieces`."""

import torch

from .parts import BALL, CYLINDER, tilted, yawed
from .pieces import bounds, random_pieces


def random_things(draws, count):
    """`count` things that are turned and sometimes tilted or lying, with their lowest point at z = 0."""
    pieces = random_pieces(KINDS, draws, count)
    lying = torch.where(draws.chance(0.1, count), torch.pi / 2, 0.0)
    lean = draws.uniform(-0.7, 0.7, count) * draws.chance(0.1, count)
    # Half of the things are aligned with what they stand on.
    yaw = torch.where(draws.chance(0.5, count), draws.normal(count) * 0.05, draws.uniform(0, 7, count))
    rotation = yawed(yaw) @ tilted(lying + lean) @ yawed(draws.uniform(0, 7, count) * (lean != 0))
    parts = pieces.parts.moved(rotation, torch.zeros(count, 3, device=yaw.device))
    low, high = bounds(parts)
    middle = torch.cat(((low + high)[:, :2] / 2, low[:, 2:]), 1)
    parts = parts._replace(centre=parts.centre - middle[:, None])
    return pieces._replace(parts=parts, half=(high - low)[:, :2] / 2, low=low[:, 2] * 0, high=(high - low)[:, 2])


def package(b):
    """A box of any proportions."""
    half = [b.log_uniform(0.015, 0.14) for _ in range(3)]
    b.add((0, 0, half[2]), half)


def book(b):
    """A standing book, file or card."""
    half = (b.log_uniform(0.004, 0.04), b.uniform(0.05, 0.13), b.uniform(0.07, 0.16))
    b.add((0, 0, half[2]), half)


def sheet(b):
    """A paper, magazine, book or pad that lies; the thinnest are visible only in colour."""
    half = (b.uniform(0.05, 0.12), b.uniform(0.07, 0.16), b.log_uniform(8e-4, 0.02))
    b.add((0, 0, half[2]), half)


def can(b):
    """A can, glass, cup or bottle, with a neck or a handle."""
    radius, half = b.uniform(0.02, 0.06), b.uniform(0.03, 0.13)
    b.add((0, 0, half), (radius, radius, half), shape=CYLINDER)
    neck, handle = b.chance(0.3), b.chance(0.3)
    b.add((0, 0, 2.4 * half), (radius * 0.4, radius * 0.4, half * 0.4), exists=neck, shape=CYLINDER)
    b.add((radius * 1.15, 0, half), (radius * 0.35, 0.006, half * 0.6), exists=handle & ~neck)


def bowl(b):
    """A plate, pan or bowl with a handle."""
    radius, half = b.uniform(0.05, 0.16), b.uniform(0.008, 0.06)
    b.add((0, 0, half), (radius, radius, half), shape=CYLINDER)
    b.add((radius + 0.07, 0, half * 1.5), (0.09, 0.012, 0.008), exists=b.chance(0.3))


def ball(b):
    """A ball, fruit or bag."""
    radius, flat = b.uniform(0.02, 0.11), b.chance(0.5)
    half = [radius * torch.where(flat, b.uniform(0.5, 1), 1.0) for _ in range(3)]
    b.add((0, 0, half[2]), half, shape=BALL)


def tray(b):
    """An open box of a bottom and four walls."""
    half_x, half_y = b.uniform(0.06, 0.22), b.uniform(0.06, 0.2)
    half_z, thick = b.uniform(0.02, 0.12), b.uniform(0.003, 0.01)
    b.add((0, 0, thick), (half_x, half_y, thick))
    for side in (-1, 1):
        b.add((side * half_x, 0, half_z), (thick, half_y, half_z))
        b.add((0, side * half_y, half_z), (half_x, thick, half_z))


def screen(b):
    """A screen on a foot, or a laptop."""
    half_x, half_z, laptop = b.uniform(0.15, 0.35), b.uniform(0.1, 0.2), b.chance(0.4)
    lift = torch.where(laptop, 0.012, b.uniform(0.05, 0.15))
    b.add((0, 0, lift + half_z), (half_x, 0.012, half_z))
    b.add((0, -0.12 * laptop, 0.009), (half_x * torch.where(laptop, 1.0, 0.45), torch.where(laptop, 0.12, 0.09), 0.009))
    b.add((0, 0.02, lift / 2 + 0.05), (0.025, 0.012, lift / 2 + 0.05), exists=~laptop)


def lamp(b):
    """A table lamp, plant or figure."""
    half, radius = b.uniform(0.08, 0.2), b.uniform(0.05, 0.13)
    round = b.chance(0.5)
    b.add((0, 0, half), (radius * 0.3, radius * 0.3, half), shape=CYLINDER)
    b.add((0, 0, 0.02), (radius * 0.7, radius * 0.7, 0.02), shape=CYLINDER)
    shape = torch.where(round, float(BALL), float(CYLINDER))
    b.add((0, 0, 2 * half), (radius, radius, radius * b.uniform(0.5, 1)), shape=shape)


# Kind, share of the things; the last number is not used.
KINDS = (
    (package, 0.25, 0.0),
    (book, 0.13, 0.0),
    (sheet, 0.16, 0.0),
    (can, 0.18, 0.0),
    (bowl, 0.07, 0.0),
    (ball, 0.07, 0.0),
    (tray, 0.06, 0.0),
    (screen, 0.05, 0.0),
    (lamp, 0.03, 0.0),
)
