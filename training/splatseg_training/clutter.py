"""Scenes of piled objects: `python -m splatseg_training.clutter --out DIR --count 500 --seed 1` writes a labelled
folder.

Tables, shelves and floors with boxes, cans, balls, bowls, papers and books that touch, lean on and lie on each other, in
ScanNet's exported layout without colours. Rendered rooms have few such piles; a scene here takes 40 ms.
"""

import argparse
import os

import cv2
import numpy as np

from .dataset import SIZE
from .solids import Solid, cast, turned

CELL = 0.01  # metres, cell size of the height map on which things are placed


class Scene:
    """Solids in a world with z pointing up; ids start at 1."""

    def __init__(self, rng):
        self.rng, self.solids, self.ids = rng, [], 0

    def new_id(self):
        self.ids += 1
        return self.ids

    def add(self, shape, centre, half, id, axes=None):
        half = np.maximum(np.array(half, float), 5e-4)
        self.solids.append(Solid(shape, np.array(centre, float), np.eye(3) if axes is None else axes, half, id))


class Surface:
    """A horizontal rectangle around (x, y) on which things are placed one after the other."""

    def __init__(self, scene, x, y, half_x, half_y, height):
        self.scene, self.x, self.y, self.half_x, self.half_y = scene, x, y, half_x, half_y
        self.heights = np.full((int(2 * half_x / CELL) + 1, int(2 * half_y / CELL) + 1), height)
        self.spots = []

    def put(self, thing):
        """Places a thing at random, often close to or on top of another one."""
        rng = self.scene.rng
        x, y = rng.uniform(-1, 1, 2) * (self.half_x * 0.9, self.half_y * 0.9)
        if self.spots and rng.random() < 0.6:
            x, y = self.spots[rng.integers(len(self.spots))] + rng.normal(0, 0.09, 2)
        x, y = np.clip(x, -self.half_x, self.half_x), np.clip(y, -self.half_y, self.half_y)
        self.spots.append(np.array([x, y]))
        first = len(self.scene.solids)
        thing(self.scene, self.x + x, self.y + y)
        self._settle(first)

    def _settle(self, first):
        """Lowers or lifts the solids from `first` on until they rest on the surface below."""
        solids = self.scene.solids
        corners = np.concatenate([solid.corners() for solid in solids[first:]])
        a = np.clip(((corners[:, :2].min(0) - (self.x - self.half_x, self.y - self.half_y)) / CELL), 0, None).astype(
            int
        )
        b = ((corners[:, :2].max(0) - (self.x - self.half_x, self.y - self.half_y)) / CELL).astype(int) + 1
        patch = self.heights[a[0] : max(b[0], 1), a[1] : max(b[1], 1)]
        if not patch.size:
            del solids[first:]
            return
        rise = patch.max() - corners[:, 2].min()
        for i in range(first, len(solids)):
            solids[i] = solids[i]._replace(centre=solids[i].centre + (0, 0, rise))
        patch[:] = corners[:, 2].max() + rise


def box(scene, x, y):
    """A package, lying or standing, sometimes tilted."""
    rng = scene.rng
    half = np.sort(np.exp(rng.uniform(np.log(0.015), np.log(0.13), 3)))
    half = half[rng.permutation(3)]
    tilt = rng.uniform(-0.7, 0.7) if rng.random() < 0.25 else 0
    scene.add("box", (x, y, 0), half, scene.new_id(), turned(rng.uniform(0, 7), tilt, rng.uniform(0, 7)))


def can(scene, x, y):
    """A can, bottle or cup; bottles have a neck, cups a handle."""
    rng, id = scene.rng, scene.new_id()
    radius, half = rng.uniform(0.02, 0.06), rng.uniform(0.03, 0.13)
    lying = rng.random() < 0.2
    axes = turned(rng.uniform(0, 7), np.pi / 2 if lying else 0, rng.uniform(0, 7))
    scene.add("cylinder", (x, y, 0), (radius, radius, half), id, axes)
    kind = rng.random()
    if kind < 0.25 and not lying:
        scene.add("cylinder", (x, y, half), (radius * 0.4, radius * 0.4, half * 0.5), id)
    elif kind < 0.5:
        handle = axes @ np.array([radius * 1.1, 0, 0])
        scene.add("box", np.array([x, y, 0]) + handle, (radius * 0.35, 0.006, half * 0.6), id, axes)


def ball(scene, x, y):
    rng = scene.rng
    radius = rng.uniform(0.02, 0.1)
    half = radius * (rng.uniform(0.5, 1, 3) if rng.random() < 0.5 else np.ones(3))
    scene.add("ball", (x, y, 0), half, scene.new_id(), turned(rng.uniform(0, 7)))


def sheet(scene, x, y):
    """A flat paper, magazine or book; the thinnest are visible only in colour."""
    rng = scene.rng
    half = (rng.uniform(0.05, 0.11), rng.uniform(0.07, 0.16), np.exp(rng.uniform(np.log(8e-4), np.log(0.02))))
    scene.add("box", (x, y, 0), half, scene.new_id(), turned(rng.uniform(0, 7)))


def tray(scene, x, y):
    """An open box or crate of four walls and a bottom."""
    rng, id = scene.rng, scene.new_id()
    a, b, h, thick = rng.uniform(0.06, 0.2), rng.uniform(0.06, 0.2), rng.uniform(0.02, 0.12), rng.uniform(0.003, 0.01)
    axes = turned(rng.uniform(0, 7))
    parts = [((0, 0, -h), (a, b, thick))]
    parts += [((side * a, 0, 0), (thick, b, h)) for side in (-1, 1)] + [
        ((0, side * b, 0), (a, thick, h)) for side in (-1, 1)
    ]
    for offset, half in parts:
        scene.add("box", np.array([x, y, 0]) + axes @ np.array(offset), half, id, axes)


def row(scene, x, y):
    """Books or packages side by side, as on a shelf."""
    rng = scene.rng
    axes, along = turned(rng.uniform(-0.4, 0.4) + rng.integers(4) * np.pi / 2), 0.0
    height, depth = rng.uniform(0.06, 0.16), rng.uniform(0.03, 0.12)
    for _ in range(rng.integers(2, 8)):
        half = np.array([rng.uniform(0.006, 0.05), depth * rng.uniform(0.8, 1), height * rng.uniform(0.7, 1)])
        along += half[0]
        scene.add("box", np.array([x, y, half[2]]) + axes @ np.array([along, 0, 0]), half, scene.new_id(), axes)
        along += half[0] + (0.002 if rng.random() < 0.5 else rng.uniform(0, 0.02))


def chair(scene, x, y):
    """A chair: legs, seat, and a back of bars through which the background shows."""
    rng, id = scene.rng, scene.new_id()
    axes, side, seat = turned(rng.uniform(0, 7)), rng.uniform(0.18, 0.24), rng.uniform(0.4, 0.48)
    top, bars, leg = rng.uniform(0.75, 1.0), rng.integers(1, 5), rng.uniform(0.012, 0.025)
    parts = [((0, 0, seat), (side, side, 0.02))]
    for i in (-1, 1):
        parts += [((i * side, side, top / 2), (leg, leg, top / 2)), ((i * side, -side, seat / 2), (leg, leg, seat / 2))]
    heights = np.linspace(seat + 0.12, top - 0.03, bars)
    parts += [((0, side, h), (side, leg, rng.uniform(0.02, 0.3 / (bars + 1)))) for h in heights]
    for offset, half in parts:
        scene.add("box", np.array([x, y, 0]) + axes @ np.array(offset), half, id, axes)


THINGS = (box, box, box, can, can, ball, sheet, sheet, tray, row)


def random_scene(rng):
    """A table or floor with things, in front of nothing, a floor or walls; returns the scene and the camera's
    target."""
    scene = Scene(rng)
    half_x, half_y = rng.uniform(0.35, 1.1), rng.uniform(0.3, 0.6)
    top = rng.uniform(0.4, 1.0)
    table = scene.new_id()
    scene.add("box", (0, 0, top - 0.02), (half_x, half_y, 0.02), table)
    if rng.random() < 0.6:
        _room(scene, half_x, half_y)
        for x, y in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
            scene.add("box", (x * half_x * 0.93, y * half_y * 0.9, top / 2 - 0.02), (0.03, 0.03, top / 2 - 0.02), table)
        for _ in range(rng.integers(0, 4)):
            chair(scene, rng.uniform(-1, 1) * half_x, rng.choice([-1, 1]) * (half_y + rng.uniform(0.1, 0.5)))
    surface = Surface(scene, 0, 0, half_x, half_y, top)
    for _ in range(int(rng.integers(2, 25))):
        surface.put(THINGS[rng.integers(len(THINGS))])
    x, y = surface.spots[rng.integers(len(surface.spots))] * rng.uniform(0.3, 1)
    return scene, np.array([x, y, top])


def _room(scene, half_x, half_y):
    """A floor, and often walls with boards, cupboards and pictures on them."""
    rng = scene.rng
    scene.add("box", (0, 0, -0.05), (6, 6, 0.05), scene.new_id())
    if rng.random() < 0.8:
        wall = half_y + rng.uniform(0.02, 1.5)
        scene.add("box", (0, wall + 0.1, 1.4), (6, 0.1, 1.6), scene.new_id())
        for _ in range(rng.integers(0, 9)):
            half = (rng.uniform(0.05, 0.4), np.exp(rng.uniform(np.log(0.003), np.log(0.3))), rng.uniform(0.05, 0.4))
            at = (rng.uniform(-1.5, 1.5), wall - half[1], rng.uniform(half[2], 1.9))
            scene.add("box", at, half, scene.new_id())
    if rng.random() < 0.5:
        wall = half_x + rng.uniform(0.02, 1.5)
        scene.add("box", (rng.choice([-1, 1]) * (wall + 0.1), 0, 1.4), (0.1, 6, 1.6), scene.new_id())


def look_at(target, rng, nearest, farthest):
    """Camera to world (x right, y down, z forward) from in front of and above a point; distances in metres."""
    yaw, pitch = rng.uniform(-2.2, -0.9), rng.uniform(0.15, 1.1)
    away = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    position = target + away * np.exp(rng.uniform(np.log(nearest), np.log(farthest)))
    right = np.cross(-away, (0, 0, 1))
    right /= np.linalg.norm(right)
    roll = rng.normal(0, 0.05)
    down = np.cross(-away, right)
    pose = np.eye(4)
    pose[:3, 0] = right * np.cos(roll) + down * np.sin(roll)
    pose[:3, 1] = down * np.cos(roll) - right * np.sin(roll)
    pose[:3, 2], pose[:3, 3] = -away, position
    return pose


def write(folder, count, seed, random_scene=random_scene, distances=(0.55, 2.2)):
    """Writes `count` scenes, one view each, from a distance in metres within `distances`."""
    for name in ("depth", "instance-filt", "pose", "intrinsic"):
        os.makedirs(os.path.join(folder, name), exist_ok=True)
    focal = 270.0
    width, height = SIZE
    camera = np.array([focal, focal, width / 2 - 0.5, height / 2 - 0.5])
    matrix = np.diag([focal, focal, 1.0, 1.0])
    matrix[:2, 2] = camera[2:]
    np.savetxt(os.path.join(folder, "intrinsic", "intrinsic_depth.txt"), matrix, "%.6f")
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        scene, target = random_scene(rng)
        pose = look_at(target, rng, *distances)
        z, ids = cast(scene.solids, pose, camera, height, width)
        z = np.where(z < 10, z, 0)
        cv2.imwrite(os.path.join(folder, "depth", f"{number}.png"), np.rint(z * 1000).astype(np.uint16))
        cv2.imwrite(os.path.join(folder, "instance-filt", f"{number}.png"), np.where(z > 0, ids, 0).astype(np.uint16))
        np.savetxt(os.path.join(folder, "pose", f"{number}.txt"), pose, "%.8f")


def main(description=__doc__, **scenes):
    """The command; `scenes` are passed to `write`."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True)
    parser.add_argument("--count", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    write(options.out, options.count, options.seed, **scenes)


if __name__ == "__main__":
    main()
