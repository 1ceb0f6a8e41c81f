"""Noise of the measured depth that grows with the square of the distance.

Triangulation measures disparities; an error of the disparity is an error of the depth times z² / (focal length ·
baseline) (Gallup et al. 2008; Nguyen et al. 2012 for the Kinect; Ahn et al. 2019 for the RealSense D435). Matching
windows, spatial filters and resizing correlate the errors of neighbours. Correlated noise is the worst for normals,
because smoothing over a few pixels does not remove it.
"""

from typing import NamedTuple

import numpy as np

from .fields import correlated_noise, white_noise

LEAST, MOST = 0.001, 0.05  # metres at 2 m, at strengths of 0 and 1; 0.5 cm from about 0.4


class Noise(NamedTuple):
    """Noise of the depth."""

    deviation: float  # metres at 2 m
    length: float  # pixels, deviation of the smoothing Gaussian; the correlation falls to 1/e at twice this distance
    white: float  # share of the variance without correlation, 0..1


def draw(rng, strength, factor=1.0):
    """Noise for a strength of 0 to 1: 0.1 to 5 cm times `factor` at 2 m, over 1.5 to 10 pixels or white."""
    deviation = LEAST * (MOST / LEAST) ** strength * factor
    length = np.exp(rng.uniform(np.log(1.5), np.log(10.0)))
    white = 1.0 if rng.random() < 0.2 else rng.uniform(0, 0.5) * (rng.random() < 0.5)
    return Noise(deviation, length, white)


def field(shape, noise, rng):
    """Noise [H, W] of deviation 1 with these correlations."""
    if noise.white >= 1:
        return white_noise(rng, shape)
    out = correlated_noise(rng, shape, noise.length)
    if noise.white > 0:
        out = out * np.float32(np.sqrt(1 - noise.white)) + white_noise(rng, shape) * np.float32(np.sqrt(noise.white))
    return out


def apply(z, noise, rng):
    """Noisy depth [H, W]; missing depth stays missing."""
    scale = np.float32(noise.deviation / 4)
    return np.where(z > 0, np.maximum(z + scale * z * z * field(z.shape, noise, rng), np.float32(0.05)), 0)


def measure(scene, noise, rng):
    """Depth [H, W] of a camera with nothing but noise."""
    return apply(scene.z, noise, rng)
