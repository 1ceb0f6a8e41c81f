"""Missing depth: masks [H, W] of the pixels that a sensor does not measure."""

from typing import NamedTuple

import cv2
import numpy as np

from .fields import correlated_noise, smooth_noise, white_noise
from .scene import cosine, is_jump, nearest_and_farthest


class Border(NamedTuple):
    """A border without depth, as after registration to a wider colour camera."""

    widths: tuple  # pixels at top, bottom, left, right
    wavy: bool
    tilt: float  # radians, of the depth camera


def draw_border(rng):
    """Up to 25 pixels at each side."""
    widths = tuple(int(width) for width in rng.integers(0, rng.integers(1, 26), 4))
    return Border(widths, rng.random() < 0.5, rng.uniform(-1, 1) ** 3 * 0.4 * (rng.random() < 0.3))


def shadow(z, camera, baseline):
    """Pixels in the shadow of the projector or second camera, `baseline` metres beside the camera.

    The shadow is to the left of near things, for a negative baseline to their right.
    """
    if baseline == 0:
        return np.zeros(z.shape, bool)
    if baseline < 0:
        return shadow(z[:, ::-1], camera, -baseline)[:, ::-1]
    near = np.where(z > 0, np.float32(camera[0] * baseline) / np.maximum(z, np.float32(0.05)), 0)
    seen = np.arange(z.shape[1], dtype=np.float32) - near
    nearest = np.minimum.accumulate(seen[:, ::-1], axis=1)[:, ::-1]
    return seen > nearest + np.float32(0.5)


def edges(z, share, rng):
    """A share of the pixels where the depth jumps."""
    near, far = nearest_and_farthest(z, 1)
    return is_jump(near, far) & (rng.random(z.shape, dtype=np.float32) < share)


def grazing(z, camera, limit, rng):
    """Surfaces nearly parallel to the ray: randomly below a cosine of `limit`, all at 0.1 less."""
    return rng.random(z.shape, dtype=np.float32) * np.float32(0.1) < np.float32(limit) - cosine(z, camera)


def dark(colour, patchy, limit):
    """Surfaces darker than `limit`, 0..255, with patchy borders; nothing if there is no colour."""
    if colour is None or limit <= 0:
        return np.zeros(patchy.shape, bool)
    return colour[..., 1] + 15 * patchy < limit


def difficult(ids, patchy, share, cover, rng):
    """Patches on a share of the objects, like glass, screens and metal; `cover` is the patches' least noise, -2..1."""
    chosen = rng.random(int(ids.max()) + 1) < share
    return chosen[ids] & (patchy > cover)


def holes(shape, share, length, rng):
    """Holes in about this share of the pixels, in blobs with a size of about `length` pixels."""
    if length < 1.5:
        return rng.random(shape, dtype=np.float32) < share
    field = correlated_noise(rng, shape, length / 2.5)
    return field < np.partition(field[::3, ::3], (k := int(share * field[::3, ::3].size)), axis=None)[k]


def outside(shape, border, rng):
    """The pixels in a border."""
    top, bottom, left, right = border.widths
    wave = smooth_noise(rng, shape, 16) if border.wavy else np.float32(0)
    rows, columns = np.arange(shape[0], dtype=np.float32)[:, None], np.arange(shape[1], dtype=np.float32)[None]
    tilt = np.float32(border.tilt)
    down, across = rows + wave + tilt * (columns - shape[1] / 2), columns + wave - tilt * (rows - shape[0] / 2)
    missing = (down < top - 0.5) | (down > shape[0] - bottom - 0.5)
    return missing | (across < left - 0.5) | (across > shape[1] - right - 0.5)


def out_of_range(z, nearest, farthest):
    """Depth outside `nearest`..`farthest`, metres."""
    return (z > farthest) | (z < nearest)


def textureless(scene, share, window, rng):
    """The share of the pixels with the least texture, smoothed over `window` pixels, where no block can be matched.

    Without colour: smooth random areas, mostly on a few objects, because the texture painted later is not known yet.
    """
    if scene.colour is None:
        calm = white_noise(rng, int(scene.ids.max()) + 1)
        texture = smooth_noise(rng, scene.ids.shape, int(rng.integers(6, 40))) + np.float32(1.5) * calm[scene.ids]
    else:
        grey = cv2.cvtColor(scene.colour, cv2.COLOR_RGB2GRAY)
        texture = np.abs(cv2.Laplacian(grey, cv2.CV_32F))
        texture = cv2.blur(cv2.blur(texture, (window, window)), (window, window))
        texture += np.float32(0.5) * smooth_noise(rng, texture.shape, 8)  # a choice among equally calm surfaces
    part = texture[::3, ::3]
    return texture < np.partition(part, (k := int(share * part.size)), axis=None)[k]
