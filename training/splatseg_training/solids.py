"""Ray casting of boxes, cylinders and ellipsoids: depth and ids of a scene in milliseconds, without a renderer."""

from typing import NamedTuple

import numpy as np

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


class Solid(NamedTuple):
    """A box, cylinder (its axis is z) or ball of half sizes `half`, rotated and moved into the world."""

    shape: str
    centre: np.ndarray  # [3] metres
    axes: np.ndarray  # [3, 3], columns: the solid's axes in the world
    half: np.ndarray  # [3] metres
    id: int

    def corners(self):
        """The eight corners of its box in the world, [8, 3]."""
        return self.centre + (CORNERS * self.half) @ self.axes.T


def turned(yaw, tilt=0.0, towards=0.0):
    """Axes rotated about the vertical z, then tilted about the horizontal direction `towards`."""
    c, s = np.cos(yaw), np.sin(yaw)
    spin = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    axis = np.array([np.cos(towards), np.sin(towards), 0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return (np.eye(3) + np.sin(tilt) * cross + (1 - np.cos(tilt)) * cross @ cross) @ spin


def cast(solids, world_from_camera, camera, height, width):
    """Depth along z in metres (0 = nothing) and ids, both [height, width], seen by a camera (x right, y down)."""
    z = np.full((height, width), np.inf, np.float32)
    ids = np.zeros((height, width), np.uint16)
    fx, fy, cx, cy = camera
    rotation, position = world_from_camera[:3, :3], world_from_camera[:3, 3]
    for solid in solids:
        rows, columns = _window((solid.corners() - position) @ rotation, camera, height, width)
        if rows.stop <= rows.start or columns.stop <= columns.start:
            continue
        v, u = np.mgrid[rows, columns].astype(np.float32)
        rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones_like(u)], -1)
        into = (solid.axes / solid.half).T
        hit = _entry(solid.shape, into @ (position - solid.centre), rays @ (into @ rotation).T.astype(np.float32))
        nearer = hit < z[rows, columns]
        z[rows, columns][nearer] = hit[nearer]
        ids[rows, columns][nearer] = solid.id
    return np.where(np.isfinite(z), z, 0), ids


def _window(corners, camera, height, width):
    """Rows and columns of the image that a box with these corners, in camera axes, can cover."""
    if corners[:, 2].min() < 0.05:
        whole = corners[:, 2].max() >= 0.05
        return slice(0, height * whole), slice(0, width * whole)
    u = corners[:, 0] / corners[:, 2] * camera[0] + camera[2]
    v = corners[:, 1] / corners[:, 2] * camera[1] + camera[3]
    rows = slice(max(0, int(v.min())), min(height, int(v.max()) + 2))
    return rows, slice(max(0, int(u.min())), min(width, int(u.max()) + 2))


def _entry(shape, origin, rays):
    """Length along each ray [h, w, 3] at which it enters the unit solid; infinite if it misses."""
    origin = origin.astype(np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        if shape == "ball":
            near, far = _quadric(origin, rays)
        else:
            flat = 3 if shape == "box" else 1
            a, b = (-1 - origin[-flat:]) / rays[..., -flat:], (1 - origin[-flat:]) / rays[..., -flat:]
            near, far = np.minimum(a, b).max(-1), np.maximum(a, b).min(-1)
            if shape == "cylinder":
                round_near, round_far = _quadric(origin[:2], rays[..., :2])
                near, far = np.maximum(near, round_near), np.minimum(far, round_far)
    return np.where((near < far) & (near > 0.05), near, np.inf)


def _quadric(origin, rays):
    """Lengths at which rays enter and leave the unit circle's cylinder (two coordinates) or ball (three)."""
    a, b = (rays * rays).sum(-1), rays @ origin
    root = np.sqrt(b * b - a * (origin @ origin - 1))
    root = np.where(np.isnan(root), -np.inf, root)
    return (-b - root) / a, (-b + root) / a
