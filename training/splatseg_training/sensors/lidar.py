"""A coarse depth map that is enlarged to the size of the colours, like that of a phone's LiDAR.

The sensor measures few points; the phone's software interpolates them, guided by colour, to 256 × 192 pixels (Apple's
ARKit documentation; Luetzenburg et al. 2021 for accuracy and range). So surfaces are smooth, edges are smeared, small
things melt into what is behind them, and there is no depth beyond about 5 m.
"""

from typing import NamedTuple

import cv2
import numpy as np

from . import losses
from .fields import correlated_noise
from .scene import is_jump, nearest_and_farthest, smeared


class Lidar(NamedTuple):
    """Errors and losses of an enlarged depth map."""

    scale: float  # size of the depth map, relative to the colours
    smear: float  # pixels of the colours, deviation of the Gaussian
    noise: float  # share of the depth
    length: float  # pixels of the depth map, correlation of the noise
    unsure: float  # share of the jumps whose depth is left out for its low confidence
    holes: float  # share of other pixels with low confidence
    hole_size: float  # pixels of the depth map
    nearest: float  # metres
    farthest: float  # metres


def draw(rng, strength):
    """A depth map for a strength of 0 to 1."""
    return Lidar(
        scale=rng.uniform(0.8 - 0.4 * strength, 0.8),
        smear=1 + 2 * strength * rng.random(),
        noise=np.exp(rng.uniform(np.log(0.0005), np.log(0.001 + 0.014 * strength))),
        length=rng.uniform(2.0, 8.0),
        unsure=rng.uniform(0, 0.9) * (rng.random() < 0.3),
        holes=rng.uniform(0, 0.25) * strength * (rng.random() < 0.4),
        hole_size=rng.uniform(2, 12),
        nearest=rng.uniform(0.1, 0.3),
        farthest=rng.uniform(4.0, 6.0),
    )


def measure(scene, lidar, rng):
    """Depth [H, W] float32 metres, 0 = missing."""
    height, width = scene.z.shape
    size = (max(8, round(width * lidar.scale)), max(8, round(height * lidar.scale)))
    z = cv2.resize(smeared(scene.z, lidar.smear), size, interpolation=cv2.INTER_AREA)
    z *= 1 + np.float32(lidar.noise) * correlated_noise(rng, z.shape, lidar.length)
    lost = losses.out_of_range(z, lidar.nearest, lidar.farthest)
    if lidar.unsure > 0:
        near, far = nearest_and_farthest(z, 1)
        lost |= is_jump(near, far) & (rng.random(z.shape, dtype=np.float32) < lidar.unsure)
    if lidar.holes > 0:
        lost |= losses.holes(z.shape, lidar.holes, lidar.hole_size, rng)
    lost = cv2.resize(lost.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
    return np.where(lost, 0, cv2.resize(z, (width, height), interpolation=cv2.INTER_LINEAR))
