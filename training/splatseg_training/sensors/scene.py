"""The exact view that a sensor measures, and its geometry."""

from typing import NamedTuple

import cv2
import numpy as np

FAR = np.float32(100.0)  # metres, stands for missing depth where the nearest depth is searched


class Scene(NamedTuple):
    """An exact view. Pixel centres are at integer coordinates."""

    z: np.ndarray  # [H, W] float32 metres, 0 = missing
    colour: np.ndarray | None  # [H, W, 3] uint8
    ids: np.ndarray  # [H, W]
    camera: np.ndarray  # fx, fy, cx, cy in pixels


def rays(shape, camera):
    """Columns [1, W] and rows [H, 1] of the pixels relative to the principal point, in pixels, float32."""
    _, _, cx, cy = camera.astype(np.float32)
    u = (np.arange(shape[1], dtype=np.float32) - cx)[None]
    v = (np.arange(shape[0], dtype=np.float32) - cy)[:, None]
    return u, v


def cosine(z, camera):
    """Cosine [H, W] between surface and ray: z / (|normal| |ray|)."""
    fx, fy, _, _ = camera.astype(np.float32)
    u, v = rays(z.shape, camera)
    dx = cv2.Sobel(z, cv2.CV_32F, 1, 0, ksize=3, scale=1 / 8)
    dy = cv2.Sobel(z, cv2.CV_32F, 0, 1, ksize=3, scale=1 / 8)
    normal = np.sqrt((fx * dx) ** 2 + (fy * dy) ** 2 + (z + u * dx + v * dy) ** 2)
    return z / (normal * np.sqrt((u / fx) ** 2 + (v / fy) ** 2 + 1) + np.float32(1e-6))


def nearest_and_farthest(z, radius):
    """The least and the greatest depth [H, W] within a square of 2 `radius` + 1 pixels, without the missing ones.

    Where there is none, they are FAR and 0.
    """
    kernel = np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)
    return cv2.erode(np.where(z > 0, z, FAR), kernel), cv2.dilate(z, kernel)


def is_jump(near, far):
    """Whether the step between two depths is one between surfaces, not a slope."""
    return far - near > np.float32(0.03) + np.float32(0.04) * near


def smeared(z, deviation):
    """Depth blurred over `deviation` pixels; missing depth is filled from its neighbours where they are close."""
    valid = z > 0
    blurred = cv2.GaussianBlur(z, (0, 0), deviation)
    if valid.all():
        return blurred
    weight = cv2.GaussianBlur(valid.astype(np.float32), (0, 0), deviation)
    return np.where(weight > np.float32(0.1), blurred / np.maximum(weight, np.float32(0.1)), 0)
