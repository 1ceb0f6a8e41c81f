"""Camera poses in a room: scattered views, and a walk for video.

Poses are camera to world [4, 4]: x right, y down, z forward in the camera, metres.
"""

import heapq
import math
from itertools import product
from typing import NamedTuple

import numpy as np

from .geometry import TAU, rotation

SHELL_IDS = 6  # ids up to this one are walls, floor and ceiling
KEY_STEP = 0.125  # metres between the keys of a walk, on average
KEY_RATE = 1.5  # keys per second, for a walking speed of about 0.2 m/s
CELL = 0.08  # metres, cell size of the grid for planning a walk


def look(x, y, z, yaw, pitch, roll):
    """A pose; yaw 0 looks along +x, pitch up is positive. Radians."""
    forward = np.array([math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)])
    right = np.array([math.sin(yaw), -math.cos(yaw), 0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], 1) @ rotation("Z", roll)
    pose[:3, 3] = x, y, z
    return pose


def scattered(room, count, camera):
    """Up to `count` independent poses from free places, each with many things in sight."""
    uniform, poses = room.paint.uniform, []
    for attempt in range(count * 400):
        if len(poses) == count:
            break
        x, y, z = uniform(0.3, room.width - 0.3), uniform(0.3, room.depth - 0.3), uniform(0.8, 1.75)
        if room.clearance(x, y) < 0.12 or room.caster.near((x, y, z)) < 0.22:
            continue
        pose = look(x, y, z, uniform(0, TAU), uniform(-0.65, 0.08), uniform(-0.08, 0.08))
        view = room.caster.cast(pose, camera, 16)
        # A crowded room has few good views, so later attempts are judged less strictly.
        far, stuff, kinds = (0.8, 0.15, 6) if attempt > count * 100 else (1.1, 0.3, 9)
        if (
            np.median(view.depth) > far
            and view.depth.min() > 0.3
            and (view.ids > SHELL_IDS).mean() > stuff
            and len(np.unique(view.ids)) >= kinds
        ):
            poses.append(pose)
    return poses


def walk(room, count, camera, rate=None):
    """`count` poses of a closed walk, walked about twice, while the view swings round in both directions.

    Without a rate, the poses are the walk's keys, 12 cm and 7 degrees apart. With a rate in Hz, they are interpolated
    between fewer keys: the walk of `count * KEY_RATE / rate` poses, sampled more densely.
    """
    keys = count if rate is None else max(2, round(count * KEY_RATE / rate))
    path = _plan(room, keys)
    rng = room.rng

    def noise(sigma):
        values = smooth(rng.normal(size=keys), sigma, False)
        return values / max(np.abs(values).max(), 1e-6)

    pace = np.clip(KEY_STEP * (1 + 0.5 * noise(4)), 0.06, 0.19)
    along = room.paint.uniform(0, path.length) + np.cumsum(pace)
    z = 1.2 + 0.25 * noise(8) + 0.02 * noise(1)
    times = np.arange(keys) if rate is None else np.linspace(0, keys - 1, count)
    best, best_score = None, -np.inf
    for _ in range(40):  # of many ways to look round, the one with the most in sight
        turns = np.radians(smooth(_swings(room.paint, keys), 1, False) * (8.0 + 2.6 * noise(4)))
        yaw = room.paint.uniform(0, TAU) + np.cumsum(turns)
        pitch, roll = np.radians(-16 + 13 * noise(5)), np.radians(3 * noise(3))
        columns = [path.at(along), z[:, None], yaw[:, None], pitch[:, None], roll[:, None]]
        poses = [look(*values) for values in np.concatenate(columns, 1)]
        score = np.mean([_interest(room.caster.cast(pose, camera, 20)) for pose in poses[::3]])
        if score > best_score:
            between = [interpolate(values, times) for values in (along, z, yaw, pitch, roll)]
            best, best_score = between, score
    along, z, yaw, pitch, roll = best
    places = path.at(along)
    return [look(*values) for values in zip(places[:, 0], places[:, 1], z, yaw, pitch, roll)]


def _interest(view):
    """Quality of a view of a walk: many things in sight, and not too near."""
    stuff = min((view.ids > SHELL_IDS).mean(), 0.5)
    return len(np.unique(view.ids)) + 12 * stuff - (8 if np.median(view.depth) < 0.9 else 0)


def _swings(paint, count):
    """The direction of turning at each key: runs of 1 or -1."""
    sense, start = np.ones(count), 0
    direction = paint.pick([-1, 1])
    while start < count:
        run = int(paint.uniform(14, 34)) if direction > 0 else int(paint.uniform(8, 22))
        sense[start : start + run] = direction
        start, direction = start + run, -direction
    return sense


class Loop(NamedTuple):
    """A closed polyline: points [N, 2], the last equal to the first, and the arc length at each, metres."""

    points: np.ndarray
    ways: np.ndarray
    length: float

    def at(self, way):
        """Points [M, 2] at arc lengths along the loop, which may go round several times."""
        way = np.asarray(way) % self.length
        return np.stack([np.interp(way, self.ways, self.points[:, axis]) for axis in (0, 1)], 1)


def _plan(room, count):
    """A wide, clear Loop about half as long as the walk."""
    best, best_score = None, -np.inf
    x, y = np.meshgrid(np.arange(0.1, room.width, CELL), np.arange(0.1, room.depth, CELL), indexing="ij")
    clear = room.clearance(x, y)
    for need in (0.26, 0.2, 0.15):
        free = clear > need
        cells = np.array(largest_piece(free))
        if len(cells) * CELL**2 < 1.0:
            continue
        for _ in range(25):
            points = _random_loop(room.rng, free, clear, cells)
            if len(points) < 24:
                continue
            points = smooth(points, 4, True)
            closed = np.concatenate([points, points[:1]])
            length = np.linalg.norm(np.diff(closed, axis=0), axis=1).sum()
            narrowest = room.clearance(points[:, 0], points[:, 1]).min()
            score = np.ptp(points, axis=0).prod() - 2 * abs(count * KEY_STEP / length - 2) + 20 * need
            score -= 5 if narrowest < need * 0.7 else 0
            if narrowest > 0.08 and score > best_score:
                best, best_score = (closed, length), score
    if best is None:
        raise RuntimeError("no floor to walk on")
    closed, length = best
    ways = np.r_[0, np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))]
    return Loop(closed, ways, length)


def _random_loop(rng, free, clear, cells):
    """Points [N, 2] in metres of a loop through a few corners far from each other."""
    count = int(rng.integers(3, 7))
    corners = [cells[rng.integers(len(cells))]]
    while len(corners) < count:
        some = cells[rng.integers(len(cells), size=12)]
        corners.append(some[np.argmax(np.min([np.linalg.norm(some - corner, axis=1) for corner in corners], 0))])
    middle = np.mean(corners, 0)
    corners.sort(key=lambda corner: math.atan2(corner[1] - middle[1], corner[0] - middle[0]))
    legs = [route(free, clear, tuple(a), tuple(b)) for a, b in zip(corners, corners[1:] + corners[:1])]
    return np.concatenate([np.array(leg[:-1]).reshape(-1, 2) for leg in legs]) * CELL + 0.1


def route(free, clear, start, end):
    """The cheapest path over the free cells of a grid, keeping away from obstacles, as a list of cells."""
    cost, previous, heap = {start: 0.0}, {}, [(0.0, start)]
    while heap:
        so_far, cell = heapq.heappop(heap)
        if cell == end:
            path = [cell]
            while cell != start:
                cell = previous[cell]
                path.append(cell)
            return path[::-1]
        if so_far > cost[cell]:
            continue
        for dx, dy in product((-1, 0, 1), repeat=2):
            other = (cell[0] + dx, cell[1] + dy)
            if (dx or dy) and _is_set(free, other):
                total = so_far + math.hypot(dx, dy) * (1 + (0.25 / clear[other]) ** 2)
                if total < cost.get(other, 1e9):
                    cost[other], previous[other] = total, cell
                    heapq.heappush(heap, (total, other))
    raise ValueError("the cells are not connected")


def largest_piece(mask):
    """Cells of the largest 4-connected component of a mask."""
    seen, largest = np.zeros(mask.shape, bool), []
    for first in zip(*np.nonzero(mask)):
        if seen[first]:
            continue
        seen[first], todo, cells = True, [first], [first]
        while todo:
            x, y = todo.pop()
            for cell in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
                if _is_set(mask, cell) and not seen[cell]:
                    seen[cell] = True
                    todo.append(cell)
                    cells.append(cell)
        largest = cells if len(cells) > len(largest) else largest
    return largest


def _is_set(mask, cell):
    return 0 <= cell[0] < mask.shape[0] and 0 <= cell[1] < mask.shape[1] and mask[cell]


def smooth(values, sigma, closed):
    """Blurs values [N] or [N, C] along the first axis; the ends are repeated, or wrap around if `closed`."""
    kernel = np.exp(-0.5 * (np.arange(-4 * sigma, 4 * sigma + 1) / sigma) ** 2)
    widths = [(len(kernel) // 2,) * 2] + [(0, 0)] * (values.ndim - 1)
    padded = np.pad(values, widths, "wrap" if closed else "edge")
    kernel = kernel / kernel.sum()
    if values.ndim == 1:
        return np.convolve(padded, kernel, "valid")
    return np.stack([np.convolve(column, kernel, "valid") for column in padded.T], 1)


def interpolate(values, times):
    """Interpolates values [N] at fractional indices with cubics (Catmull-Rom), so that speeds do not jump."""
    times = np.asarray(times, float)
    start = np.floor(times).astype(int)
    t = times - start
    padded = np.concatenate([2 * values[:1] - values[1:2], values, 2 * values[-1:] - values[-2:-1], values[-1:]])
    a, b, c, d = (padded[start + k] for k in range(4))
    slope_b, slope_c = (c - a) / 2, (d - b) / 2
    return b + t * (slope_b + t * (3 * (c - b) - 2 * slope_b - slope_c + t * (2 * (b - c) + slope_b + slope_c)))
