"""Scenes of built-in furniture: `python -m splatseg_training.counters --out DIR --count 1200 --seed 11`.

Cupboards in a row or an L, with a worktop, and shelves and more cupboards on the wall. Rendered rooms only have
separate pieces of furniture. Here, large things touch along their whole length, as in kitchens and offices. The folder
has the same layout as those of `clutter`.
"""

import itertools

import numpy as np

from .clutter import THINGS, Scene, Surface, chair, main
from .solids import turned

DISTANCES = (1.0, 3.3)  # range of the camera's distance, metres


def counter_scene(rng):
    """Cupboards along one or two walls, with a worktop and things; returns the scene and the camera's target."""
    scene = Scene(rng)
    scene.add("box", (0, 0, -0.05), (6, 6, 0.05), scene.new_id())
    scene.add("box", (0, 0.1, 1.4), (6, 0.1, 1.6), scene.new_id())
    left, right = -rng.uniform(0.6, 2.0), rng.uniform(0.6, 2.0)
    height, depth = rng.uniform(0.6, 0.95), rng.uniform(0.35, 0.65)
    wing = rng.uniform(0.8, 2.2) if rng.random() < 0.5 else 0
    if wing:
        scene.add("box", (left - 0.1, 0, 1.4), (0.1, 6, 1.6), scene.new_id())
    runs = [(left, right, -depth, 0.0)] + ([(left, left + depth, -wing - depth, -depth)] if wing else [])
    worktop, thick, over = scene.new_id(), rng.uniform(0.01, 0.03), rng.uniform(0, 0.04)
    for x0, x1, y0, y1 in runs:
        _cupboards(scene, x0, x1, y0, y1, height)
        half = ((x1 - x0 + over) / 2, (y1 - y0 + over) / 2, thick)
        scene.add("box", ((x0 + x1 + over) / 2, (y0 + y1 - over) / 2, height + thick), half, worktop)
    top = height + 2 * thick
    surface = Surface(scene, (left + right) / 2, -depth / 2, (right - left) / 2, depth / 2, top)
    for _ in range(int(rng.integers(0, 14))):
        surface.put(THINGS[rng.integers(len(THINGS))])
    _on_the_wall(scene, left, right, top)
    for _ in range(rng.integers(0, 3)):
        chair(scene, rng.uniform(left, right), -depth - rng.uniform(0.3, 1.0))
    return scene, np.array([rng.uniform(left, right), -depth * rng.uniform(0.3, 1), height * rng.uniform(0.6, 1.4)])


def _cupboards(scene, x0, x1, y0, y1, height):
    """A row of cupboards, either as one thing with a plinth and gaps between its doors, or with each unit as its own
    thing."""
    rng, along_x = scene.rng, x1 - x0 > y1 - y0
    one = scene.new_id() if rng.random() < 0.7 else 0
    plinth, gap = rng.uniform(0, 0.12), rng.uniform(0.0, 0.006)
    first, last = (x0, x1) if along_x else (y0, y1)
    count = max(int((last - first) / rng.uniform(0.4, 0.8)), 1)
    edges = np.linspace(first, last, count + 1)
    for a, b in itertools.pairwise(edges):
        id = one or scene.new_id()
        lo, hi = (a + gap, b - gap) if count > 1 else (a, b)
        half = ((hi - lo) / 2, (y1 - y0) / 2) if along_x else ((x1 - x0) / 2, (hi - lo) / 2)
        centre = ((lo + hi) / 2, (y0 + y1) / 2) if along_x else ((x0 + x1) / 2, (lo + hi) / 2)
        scene.add("box", (*centre, (plinth + height) / 2), (*half, (height - plinth) / 2), id)
        if plinth:
            inner = (max(half[0] - 0.03, 0.01), max(half[1] - 0.03, 0.01))
            scene.add("box", (*centre, plinth / 2), (*inner, plinth / 2), id)
        if rng.random() < 0.6:
            _handle(scene, centre, half, along_x, height, id)


def _handle(scene, centre, half, along_x, height, id):
    width, z = min(half) * 0.5, height - scene.rng.uniform(0.04, 0.15)
    if along_x:
        scene.add("box", (centre[0], centre[1] - half[1] - 0.02, z), (width, 0.008, 0.006), id)
    else:
        scene.add("box", (centre[0] + half[0] + 0.02, centre[1], z), (0.008, width, 0.006), id)


def _on_the_wall(scene, left, right, top):
    """Cupboards, shelf boards with things on them, and pictures."""
    rng = scene.rng
    if rng.random() < 0.4:
        depth, bottom, half = rng.uniform(0.2, 0.4), top + rng.uniform(0.45, 0.7), rng.uniform(0.2, 0.4)
        x, one = left, scene.new_id() if rng.random() < 0.5 else 0
        while x < right - 0.3:
            width = rng.uniform(0.3, 0.8)
            at, size = (x + width / 2, -depth / 2, bottom + half), (width / 2 - 0.002, depth / 2, half)
            scene.add("box", at, size, one or scene.new_id())
            x += width
    if rng.random() < 0.6:
        depth, width = rng.uniform(0.12, 0.3), rng.uniform(0.3, (right - left) / 2)
        x, z = rng.uniform(left + width, right - width), top + rng.uniform(0.2, 0.6)
        scene.add("box", (x, -depth / 2, z), (width, depth / 2, rng.uniform(0.006, 0.03)), scene.new_id())
        shelf = Surface(scene, x, -depth / 2, width, depth / 2, z + 0.03)
        for _ in range(rng.integers(0, 6)):
            shelf.put(_standing if rng.random() < 0.5 else THINGS[rng.integers(len(THINGS))])
    for _ in range(rng.integers(0, 7)):
        half = (rng.uniform(0.05, 0.3), np.exp(rng.uniform(np.log(0.002), np.log(0.03))), rng.uniform(0.05, 0.3))
        at = (rng.uniform(left, right), -half[1], top + rng.uniform(half[2], 0.9))
        scene.add("box", at, half, scene.new_id())


def _standing(scene, x, y):
    """A card, book or picture that stands upright and leans a little."""
    rng = scene.rng
    half = (rng.uniform(0.04, 0.12), np.exp(rng.uniform(np.log(0.002), np.log(0.02))), rng.uniform(0.06, 0.16))
    scene.add("box", (x, y, 0), half, scene.new_id(), turned(rng.normal(0, 0.2), rng.uniform(-0.3, 0), 0))


if __name__ == "__main__":
    main(__doc__, random_scene=counter_scene, distances=DISTANCES)
