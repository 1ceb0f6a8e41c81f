"""A time-of-flight camera, like the Kinect v2, Azure Kinect or HoloLens.

- Flying pixels: a pixel that sees two surfaces measures a depth between them (Sarbolandi et al. 2015).
- Multipath: light that bounced off another surface arrives later. Depth is too great, above all in concave corners, which
  look round (Freedman et al. 2014; Guo et al. 2018).
- Amplitude: noise grows and depth is lost where little light returns: far, dark and grazing surfaces (Lindner & Kolb
  2007; Tölgyessy et al. 2021).
"""

from typing import NamedTuple

import cv2
import numpy as np

from . import losses
from .fields import smooth_noise, white_noise
from .scene import cosine, is_jump, nearest_and_farthest, smeared


class TimeOfFlight(NamedTuple):
    """Errors and losses of a time-of-flight camera."""

    flying: float  # share of the pixels at depth jumps that mix two depths
    filtered: float  # share of the pixels at depth jumps that are left out
    reach: int  # pixels to both sides of a jump that can see both surfaces
    smear: float  # pixels, deviation of the camera's own spatial filter; 0: none
    rounding: float  # 0..1, how much of a concave corner is cut off
    multipath: float  # bias at corners, relative to their depth over their surroundings
    bias: float  # share of the depth, of a smooth bias away from the camera
    corner: float  # pixels, how far a corner reaches
    noise: float  # share of the depth, deviation where the amplitude is its median
    dropout: float  # share of the pixels with too little light
    albedo_spread: float  # of the logarithm of the objects' infrared reflectance
    nearest: float  # metres
    farthest: float  # metres


def draw(rng, strength):
    """A camera for a strength of 0 to 1."""
    return TimeOfFlight(
        flying=rng.uniform(0.2, 0.4 + 0.6 * strength),
        filtered=rng.uniform(0, 0.8),
        reach=1 + int(rng.random() < strength) + int(rng.random() < 0.5 * strength),
        smear=rng.uniform(0.5, 0.5 + strength) * (rng.random() < 0.5),
        rounding=rng.uniform(0, 1) * min(1, 2 * strength),
        multipath=rng.uniform(0, 2) * strength,
        bias=rng.uniform(0, 0.03) * strength,
        corner=rng.uniform(6, 20),
        noise=np.exp(rng.uniform(np.log(0.0005), np.log(0.001 + 0.006 * strength))),
        dropout=rng.uniform(0, 0.3) * strength,
        albedo_spread=rng.uniform(0.2, 0.8),
        nearest=rng.uniform(0.1, 0.5),
        farthest=rng.uniform(3.0, 5.0) if rng.random() < 0.5 else rng.uniform(5.0, 9.0),
    )


def measure(scene, tof, rng):
    """Depth [H, W] float32 metres, 0 = missing."""
    amplitude = _amplitude(scene, tof.albedo_spread, rng)
    known = amplitude[::3, ::3]
    dimmest = np.partition(known, (k := int(tof.dropout * known.size)), axis=None)[k]
    spread = np.clip(np.median(known) / np.maximum(amplitude, np.float32(1e-6)), np.float32(0.5), np.float32(6.0))
    lost = losses.out_of_range(scene.z, tof.nearest, tof.farthest) | (amplitude < dimmest)
    z = multipath(scene.z, tof, rng)
    z, mixed = flying_pixels(z, tof, rng)
    z = z * (1 + np.float32(tof.noise) * spread * white_noise(rng, z.shape))
    if tof.smear > 0:
        z = smeared(z, tof.smear)
    return np.where(lost | mixed | (scene.z <= 0), 0, np.maximum(z, np.float32(0.05)))


def _amplitude(scene, albedo_spread, rng):
    """Light that returns [H, W]: reflectance × cosine / z², with patchy noise; 0 where there is no surface."""
    albedo = np.exp(np.float32(albedo_spread) * white_noise(rng, int(scene.ids.max()) + 1))[scene.ids]
    if scene.colour is not None:
        albedo = albedo * (scene.colour[..., 0] * np.float32(1 / 128) + np.float32(0.15))
    patchy = 1 + np.float32(0.2) * smooth_noise(rng, scene.z.shape, 3)
    return albedo * patchy * cosine(scene.z, scene.camera) / np.maximum(scene.z, np.float32(0.1)) ** 2


def multipath(z, tof, rng):
    """Depth with concave corners cut off and everything near them moved away; small edges are not corners."""
    if tof.rounding <= 0 and tof.multipath <= 0 and tof.bias <= 0:
        return z
    height, width = z.shape
    small = cv2.resize(z, (width // 4, height // 4), interpolation=cv2.INTER_AREA)
    depth = small - cv2.GaussianBlur(small, (0, 0), tof.corner / 4)
    depth = np.clip(depth, 0, np.float32(0.02) * small)  # beside a jump, the far surface is not a corner
    around = cv2.GaussianBlur(depth, (0, 0), tof.corner / 2)
    change = np.float32(tof.multipath) * around - np.float32(tof.rounding) * depth
    change += np.float32(tof.bias) * small * np.clip(1 + smooth_noise(rng, small.shape, 12), 0, 2) / 2
    return z + cv2.resize(change, (width, height), interpolation=cv2.INTER_LINEAR)


def flying_pixels(z, tof, rng):
    """Depth with mixtures of foreground and background at jumps, and the mask of those that the camera left out."""
    near, far = nearest_and_farthest(z, tof.reach)
    jump = is_jump(near, far)
    chance = rng.random((2, *z.shape), dtype=np.float32)
    mixed = jump & (chance[0] < tof.flying)
    between = near + (far - near) * chance[1]
    return np.where(mixed, between, z), jump & ((chance[0] + chance[1]) % 1 < tof.filtered)
