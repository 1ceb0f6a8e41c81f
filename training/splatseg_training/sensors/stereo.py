"""A stereo camera, active or passive, that matches blocks, like the RealSense D400 family.

- Fattened foreground: a matching window that contains an edge takes the foreground's disparity (Kanade & Okutomi 1994;
  "adhesion"). How far depends on the window, and on which side has more texture.
- Disparities come in steps of a part of a pixel, and interpolation draws them towards whole pixels ("pixel locking",
  Shimizu & Okutomi 2001).
- A band at one side is seen by one imager only, and so are stripes beside near things.
- No match on calm surfaces, wrong matches on shiny and repetitive ones (Keselman et al. 2017).
"""

from typing import NamedTuple

import cv2
import numpy as np

from . import losses, noise
from .fields import smooth_noise
from .scene import FAR, is_jump


class Stereo(NamedTuple):
    """Errors and losses of a stereo camera."""

    fatten: tuple  # pixels by which foreground grows to the left, right, top and bottom
    ragged: float  # share of the edges where it grows one pixel less
    focal_baseline: float  # pixels × metres
    step: float  # pixels of disparity
    locking: float  # pull towards whole pixels, 0 (none) to 1 (the disparity is constant near whole pixels)
    noise: noise.Noise
    shadow: float  # metres, distance of the second imager, to the right if negative; 0: filled in
    band: float  # share of the width without depth, to the right if negative
    textureless: float  # share of the pixels that are too calm
    window: int  # pixels, of the blocks
    dark: float  # brightness 0..255 below which depth is lost
    shiny: float  # share of the objects that lose depth in patches
    cover: float  # patches are where noise exceeds this, -2..1
    wrong: float  # share of the pixels with wrong matches
    wrong_size: float  # pixels, size of their patches
    grazing: float  # cosine below which depth is lost
    nearest: float  # metres
    farthest: float  # metres


def draw(rng, strength):
    """A camera for a strength of 0 to 1."""
    most = 1 + 3 * strength if rng.random() < 0.4 + 0.6 * strength else 0
    wide = rng.uniform(min(most, 1), most)
    sides = wide * np.array([1, rng.uniform(0.3, 1), rng.uniform(0.3, 1), rng.uniform(0.3, 1)])
    sides[:2] = sides[:2] if rng.random() < 0.5 else sides[1::-1]
    focal_baseline = np.exp(rng.uniform(np.log(8), np.log(40)))
    finest, coarsest = 0.002 * focal_baseline / 4, (0.005 + 0.045 * strength) * focal_baseline / 4  # of depth at 2 m
    side = 1 if rng.random() < 0.7 else -1
    return Stereo(
        fatten=tuple(round(size) for size in sides),
        ragged=rng.uniform(0, 0.8),
        focal_baseline=focal_baseline,
        step=np.exp(rng.uniform(np.log(finest), np.log(coarsest))),
        locking=rng.uniform(0, 0.9) * (rng.random() < 0.6),
        noise=noise.draw(rng, strength),
        shadow=side * rng.uniform(0.02, 0.1) * (rng.random() < 0.5),
        band=side * rng.uniform(0.02, 0.16) * (rng.random() < 0.6),
        textureless=rng.uniform(0, 0.3) * strength,
        window=int(rng.integers(5, 17)),
        dark=rng.uniform(0, 40) * (rng.random() < 0.4),
        shiny=rng.uniform(0.01, 0.15) * (rng.random() < 0.5),
        cover=rng.uniform(-1.0, 1.0),
        wrong=rng.uniform(0, 0.04) * strength * (rng.random() < 0.5),
        wrong_size=rng.uniform(2, 8),
        grazing=rng.uniform(0.0, 0.2),
        nearest=rng.uniform(0.15, 0.5),
        farthest=10.0 if rng.random() < 0.5 else rng.uniform(3.0, 8.0),
    )


def measure(scene, stereo, rng):
    """Depth [H, W] float32 metres, 0 = missing."""
    z = fattened(scene.z, stereo.fatten, stereo.ragged, rng)
    lost = _lost(scene, z, stereo, rng)
    z = mismatched(z, stereo.wrong, stereo.wrong_size, rng)
    z = noise.apply(z, stereo.noise, rng)
    return np.where(lost, 0, stepped(z, stereo))


def fattened(z, sides, ragged, rng):
    """Depth where the foreground has grown by `sides` (left, right, top, bottom) pixels, sometimes by one less."""
    if not any(sides):
        return z
    near = _grown(z, sides)
    if ragged > 0:
        less = _grown(z, tuple(max(0, side - 1) for side in sides))
        near = np.where(losses.holes(z.shape, ragged, 4, rng), less, near)
    return np.where(is_jump(near, np.where(z > 0, z, FAR)), near, z)


def _grown(z, sides):
    """The nearest depth among the pixels from which foreground grows to each pixel; FAR where there is none."""
    left, right, top, bottom = sides
    kernel = np.ones((top + bottom + 1, left + right + 1), np.uint8)
    # A pixel takes the depth of pixels to its right, up to `left` away, so that foreground grows to the left.
    return cv2.erode(np.where(z > 0, z, FAR), kernel, anchor=(right, bottom))


def stepped(z, stereo):
    """Depth [H, W] from disparities that are drawn to whole pixels and rounded to steps."""
    disparity = np.float32(stereo.focal_baseline) / np.maximum(z, np.float32(0.05))
    if stereo.locking > 0:
        turn = np.float32(2 * np.pi)
        disparity -= np.sin(turn * disparity) * np.float32(stereo.locking) / turn
    disparity = np.rint(disparity / np.float32(stereo.step)) * np.float32(stereo.step)
    return np.where((z > 0) & (disparity > 0), np.float32(stereo.focal_baseline) / np.maximum(disparity, 1e-3), 0)


def mismatched(z, share, size, rng):
    """Depth with wrong matches: patches that are up to a third too near or half too far."""
    if share <= 0:
        return z
    wrong = losses.holes(z.shape, share, size, rng)
    factor = np.exp(np.clip(smooth_noise(rng, z.shape, 5) * np.float32(0.3), -0.4, 0.4))
    return np.where(wrong, z * factor, z)


def _lost(scene, z, stereo, rng):
    """The pixels without depth [H, W]; `z` has the fattened foreground."""
    missing = losses.shadow(z, scene.camera, stereo.shadow) | losses.out_of_range(z, stereo.nearest, stereo.farthest)
    band = round(abs(stereo.band) * z.shape[1])
    if band:
        missing[:, slice(0, band) if stereo.band > 0 else slice(-band, None)] = True
    if stereo.textureless > 0:
        missing |= losses.textureless(scene, stereo.textureless, stereo.window, rng)
    patchy = smooth_noise(rng, z.shape, int(rng.integers(3, 14)))
    missing |= losses.dark(scene.colour, patchy, stereo.dark)
    missing |= losses.difficult(scene.ids, patchy, stereo.shiny, stereo.cover, rng)
    return missing | losses.grazing(z, scene.camera, stereo.grazing, rng)
