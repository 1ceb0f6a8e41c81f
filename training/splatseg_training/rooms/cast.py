"""Exact depth and ids by casting rays through pixel centres, and sensor noise for the depth.

Poses are camera to world [4, 4]: x right, y down, z forward in the camera, metres. Pixel centres are at integers.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from mathutils.bvhtree import BVHTree


class Camera(NamedTuple):
    """A pinhole camera without distortion; the principal point is the image centre."""

    width: int
    height: int

    @property
    def focal(self):
        return 577.87 / 640 * self.width  # ScanNet's field of view

    @property
    def matrix(self):
        """Intrinsics [4, 4]."""
        matrix = np.diag([self.focal, self.focal, 1.0, 1.0])
        matrix[:2, 2] = self.width / 2 - 0.5, self.height / 2 - 0.5
        return matrix

    def directions(self, step=1):
        """Rays [H, W, 3] through the centre of every `step`th pixel, in camera axes, with z = 1."""
        v, u = np.mgrid[0 : self.height : step, 0 : self.width : step]
        matrix = self.matrix
        x, y = (u - matrix[0, 2]) / matrix[0, 0], (v - matrix[1, 2]) / matrix[1, 1]
        return np.stack([x, y, np.ones(u.shape)], -1)


class View(NamedTuple):
    """A camera's view: z-depth in metres (0 = nothing), ids (0 = nothing) and triangle numbers (-1 = nothing)."""

    depth: np.ndarray
    ids: np.ndarray
    triangles: np.ndarray


class Caster:
    """Casts rays against triangles [F, 3, 3] with one id each."""

    def __init__(self, triangles, ids):
        corners = np.arange(len(triangles) * 3).reshape(-1, 3).tolist()
        self.tree = BVHTree.FromPolygons(triangles.reshape(-1, 3).tolist(), corners, all_triangles=True)
        self.ids = ids
        normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        self.normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)

    def cast(self, pose, camera, step=1):
        """The View of every `step`th pixel from a pose."""
        directions = camera.directions(step)
        rays = (directions @ pose[:3, :3].T).reshape(-1, 3).tolist()
        origin, ray_cast = pose[:3, 3].tolist(), self.tree.ray_cast
        hits = [ray_cast(origin, ray)[2:] for ray in rays]
        shape = directions.shape[:2]
        index = np.array([-1 if triangle is None else triangle for triangle, _ in hits]).reshape(shape)
        distance = np.array([0.0 if length is None else length for _, length in hits]).reshape(shape)
        depth = distance / np.linalg.norm(directions, axis=-1)
        return View(depth, np.where(index < 0, 0, self.ids[index]), index)

    def near(self, point):
        """Distance from a point to the nearest triangle."""
        return self.tree.find_nearest(point)[3]


def sensor_noise(view, caster, pose, camera, rng):
    """Kinect-like depth: axial noise, disparity steps, holes at depth edges and at grazing angles."""
    z = view.depth
    height, width = z.shape
    ray = camera.directions() @ pose[:3, :3].T
    cosine = np.abs((ray * caster.normals[view.triangles]).sum(-1)) / np.linalg.norm(ray, axis=-1)
    padded = np.pad(z, 1, "edge")
    around = [padded[y : y + height, x : x + width] for y, x in product(range(3), repeat=2)]
    edge = np.ptp(around, axis=0) > 0.03 + 0.04 * z
    noisy = z + rng.normal(size=z.shape) * (0.0012 + 0.0019 * (z - 0.4) ** 2)
    scale = 43.5 * 8  # 75 mm baseline, 580 px, steps of 1/8 px
    disparity = np.round(np.where(noisy > 0.1, scale / np.maximum(noisy, 0.1), 0))
    noisy = np.where(disparity > 0, scale / np.maximum(disparity, 1), 0)
    lost = (edge & (rng.random(z.shape) < 0.6)) | (rng.random(z.shape) < np.clip((0.2 - cosine) / 0.15, 0, 1))
    return np.where(lost | (z < 0.35) | (view.triangles < 0), 0, noisy)
