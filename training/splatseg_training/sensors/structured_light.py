"""A structured-light camera like the first Kinect.

It compares a projected pattern with a stored one and reports disparities in 1/8 pixel (Khoshelham & Elberink 2012;
Andersen et al. 2012). The disparity jitters at edges, has white and smooth errors and is rounded. There is no depth in
the shadow of the projector, at edges, on dark and shiny things, at grazing angles, and in the border outside the view of
the infrared camera.
"""

from typing import NamedTuple

import numpy as np

from . import losses
from .fields import smooth_noise, white_noise

FOCAL_BASELINE = 43.5  # pixels × metres: a Kinect's 580 px at 640 × 480 and 75 mm
STEPS_PER_PIXEL = 8  # of its disparity
SCALES = (3, 12, 50)  # pixels, of the smooth errors


class StructuredLight(NamedTuple):
    """Errors and losses of a structured-light camera. A step of the disparity is 1.1 cm at 2 m."""

    steps: float  # of the disparity at 1 m
    jitter: float  # pixels, deviation of the point that is measured
    white: float  # steps
    smooth: tuple  # steps, at the three `SCALES`
    rounded: bool  # to whole steps
    shadow: float  # metres, distance of the projector, to the right if negative; 0: no shadow
    edges: float  # share of the pixels at depth jumps that are lost
    grazing: float  # cosine below which depth is lost
    dark: float  # brightness 0..255 below which depth is lost
    difficult: float  # share of the objects that lose depth in patches
    cover: float  # patches are where noise exceeds this, -2..1
    blobs: float  # share of random holes
    blob_size: float  # pixels
    border: losses.Border | None
    nearest: float  # metres
    farthest: float  # metres


def draw(rng, strength):
    """A camera; a strength of 1 is beyond a Kinect's noise."""
    strength *= 1.2
    return StructuredLight(
        steps=FOCAL_BASELINE * STEPS_PER_PIXEL * rng.uniform(0.7, 1.3),
        jitter=0.55 * strength,
        white=rng.uniform(0.1, 0.7) * strength,
        smooth=tuple(rng.uniform(0, size) * strength for size in (0.6, 0.6, 1.0)),
        rounded=rng.random() < 0.8,
        shadow=rng.uniform(0.03, 0.09) * rng.choice([1, -1, 0], p=[0.6, 0.2, 0.2]),
        edges=rng.uniform(0, 0.7),
        grazing=rng.uniform(0.02, 0.25),
        dark=rng.uniform(0, 50) * (rng.random() < 0.5),
        difficult=rng.uniform(0.01, 0.12) * (rng.random() < 0.5),
        cover=rng.uniform(-2.0, 1.0),
        blobs=0.12 * rng.random() ** 2 * (rng.random() < 0.4),
        blob_size=rng.uniform(3, 24),
        border=losses.draw_border(rng) if rng.random() < 0.5 else None,
        nearest=rng.uniform(0.2, 0.5),
        farthest=rng.uniform(2.0, 6.0) if rng.random() < 0.3 else 9.0,
    )


def measure(scene, light, rng):
    """Depth [H, W] float32 metres, 0 = missing."""
    z = scene.z
    out = _measured_disparity(_jittered(z, light.jitter, rng), light, rng)
    out[_lost(scene, light, rng) | (z <= 0)] = 0
    return out


def _jittered(z, deviation, rng):
    """Samples depth at points about half a pixel from each pixel's centre."""
    height, width = z.shape
    shift = np.rint(white_noise(rng, (2, height, width)) * np.float32(deviation)).astype(np.int32)
    rows = np.clip(np.arange(height, dtype=np.int32)[:, None] + shift[0], 0, height - 1)
    columns = np.clip(np.arange(width, dtype=np.int32)[None] + shift[1], 0, width - 1)
    return z[rows, columns]


def _measured_disparity(z, light, rng):
    """Adds white and smooth errors to the disparity, then rounds it to steps."""
    disparity = np.float32(light.steps) / np.maximum(z, np.float32(0.05))
    exact = disparity * z
    disparity += white_noise(rng, z.shape) * np.float32(light.white)
    for cell, size in zip(SCALES, light.smooth):
        disparity += smooth_noise(rng, z.shape, cell) * np.float32(size)
    if light.rounded:
        disparity = np.rint(disparity)
    return np.where((z > 0) & (disparity >= 1), exact / np.maximum(disparity, 1), 0).astype(np.float32)


def _lost(scene, light, rng):
    """The pixels without depth [H, W]."""
    z, shape = scene.z, scene.z.shape
    missing = losses.shadow(z, scene.camera, light.shadow) | losses.edges(z, light.edges, rng)
    missing |= losses.grazing(z, scene.camera, light.grazing, rng)
    patchy = smooth_noise(rng, shape, int(rng.integers(3, 14)))
    missing |= losses.dark(scene.colour, patchy, light.dark)
    missing |= losses.difficult(scene.ids, patchy, light.difficult, light.cover, rng)
    if light.blobs > 0:
        missing |= losses.holes(shape, light.blobs, light.blob_size, rng)
    if light.border:
        missing |= losses.outside(shape, light.border, rng)
    return missing | losses.out_of_range(z, light.nearest, light.farthest)
