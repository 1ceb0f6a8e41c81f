"""Approximations of the textures of `shaders.py`, at points: for `quick.py`."""

import numpy as np

LATTICE = 32
_RANDOM = np.random.default_rng(1)
_LATTICE = _RANDOM.random((LATTICE, LATTICE, LATTICE)).astype(np.float32)


def noise(at):
    """Smooth noise [n] from 0 to 1 at points [n, 3], with a lattice of 1."""
    low = np.floor(at).astype(np.int64)
    part = at - low
    part = part * part * (3 - 2 * part)
    low %= LATTICE
    high = (low + 1) % LATTICE
    total = np.zeros(len(at))
    for x in (0, 1):
        for y in (0, 1):
            for z in (0, 1):
                corner = [high[:, axis] if side else low[:, axis] for axis, side in enumerate((x, y, z))]
                weight = [part[:, axis] if side else 1 - part[:, axis] for axis, side in enumerate((x, y, z))]
                total += weight[0] * weight[1] * weight[2] * _LATTICE[corner[0], corner[1], corner[2]]
    return total


def _cells(cells):
    """A random number [n] from 0 to 1 for each cell [n, 2 or 3]."""
    cells = np.column_stack([cells, np.zeros((len(cells), 3 - cells.shape[1]), np.int64)]) % LATTICE
    return _LATTICE[cells[:, 0], cells[:, 1], cells[:, 2]]


def _between(factor, low, high):
    return np.clip((factor - low) / (high - low), 0, 1)


def _bricks(at, recipe, width, gap):
    row = np.floor(at[:, 1]).astype(np.int64)
    x = at[:, 0] + (0.5 * width if recipe.texture != "tile" else 0) * (row % 2)
    column = np.floor(x / width).astype(np.int64)
    inside = np.minimum(
        np.minimum(x - column * width, (column + 1) * width - x), np.minimum(at[:, 1] - row, row + 1 - at[:, 1])
    )
    first, second = (np.array(colour) for colour in recipe.colours)
    mortar = {"brick": np.array((0.5, 0.48, 0.45)), "plank": 0.4 * first, "tile": second}[recipe.texture]
    other = first * 1.05 if recipe.texture == "tile" else second
    mix = _cells(np.stack([column, row], 1))[:, None]
    return np.where((inside < gap)[:, None], mortar, first + mix * (other - first))


def _factor(recipe, at):
    """Share [n] of the second colour, or None for bricks."""
    texture = recipe.texture
    if texture == "noise":
        return _between(0.65 * noise(at) + 0.35 * noise(2.1 * at), 0.3, 0.7)
    if texture == "wood":
        return 0.5 + 0.5 * np.sin(20 * at[:, 0] + 5 * (2 * noise(1.3 * at) - 1))
    if texture == "stripes":
        return (0.5 + 0.5 * np.sin(20 * at[:, 0]) > 0.5).astype(float)
    if texture == "plaid":
        return _between(0.5 + 0.25 * (np.sin(20 * at[:, 0]) + np.sin(20 * at[:, 1])), 0.25, 0.6)
    if texture == "checker":
        return 1 - np.floor(at + 1e-6).astype(np.int64).sum(1) % 2
    if texture == "dots":
        return (np.linalg.norm(at[:, :2] - np.floor(at[:, :2]) - 0.5, axis=1) >= 0.3).astype(float)
    if texture == "terrazzo":
        return _between(_cells(np.floor(at + noise(2 * at)[:, None]).astype(np.int64)), 0.3, 0.7)
    return np.zeros(len(at))


def albedo(recipe, local, normal, share):
    """Colours [n, 3] of a material at points [n, 3] in a thing's axes; `share` are places in its box, 0 to 1."""
    if recipe.pixels is not None and recipe.texture == "image":
        height, width = recipe.pixels.shape[:2]
        column = np.clip(share[:, 0] * width, 0, width - 1).astype(int)
        row = np.clip((1 - share[:, 2]) * height, 0, height - 1).astype(int)
        return np.asarray(recipe.pixels, float)[row, column] ** 2.2
    at = local
    if recipe.texture in ("checker", "brick", "tile", "plank", "dots", "plaid"):
        plane = np.array([[1, 2], [0, 2], [0, 1]])[np.abs(normal).argmax(1)]
        at = np.column_stack([np.take_along_axis(local, plane, 1), np.zeros(len(local))])
    at = at * np.array(recipe.scale)
    cosine, sine = np.cos(recipe.turn), np.sin(recipe.turn)
    at = np.stack([cosine * at[:, 0] - sine * at[:, 1], sine * at[:, 0] + cosine * at[:, 1], at[:, 2]], 1)
    at = at + np.array(recipe.location)
    if recipe.texture in ("brick", "tile", "plank"):
        width, gap = {"brick": (2.2, 0.03), "plank": (7, 0.01), "tile": (1, 0.03)}[recipe.texture]
        return _bricks(at, recipe, width, gap)
    first, second = (np.array(colour) for colour in recipe.colours)
    return first + _factor(recipe, at)[:, None] * (second - first)
