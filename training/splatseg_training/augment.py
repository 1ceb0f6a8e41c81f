"""Training samples from labelled views: crop, sensor, colours, quarter turns, input channels."""

from typing import NamedTuple

import cv2
import numpy as np

from . import colour, sensors, sheets
from .inputs import inputs


class Settings(NamedTuple):
    """Probabilities and sizes of the augmentation."""

    height: int = 192  # of a sample
    width: int = 256
    sensor: float = 1.0  # probability of the sensor model
    noisy: float = 0.0  # share of the sensor's samples with much noise; 1 for weights that are for noisy depth only
    recolour: float = 0.5  # probability that objects get new colours and textures
    no_colour: float = 0.35  # probability that colour is left out
    no_depth: float = 0.05  # probability that depth is left out
    turn: float = 0.25  # share of samples turned by 90° or 270°, and a few by 180°, like those of a phone held upright
    sheets: float = 0.5  # probability of papers and posters on surfaces, if there is colour


def sample(view, settings, rng):
    """Network input [8, h, w] float16 and the ids of every second pixel [h/2, w/2] int32."""
    seen, noisy, _, ids, _ = _view_of_camera(view, settings, rng)
    return _inputs(noisy, *seen), ids


def sample_with_exact(view, settings, rng):
    """A `sample`, and its input with exact depth [8, h, w] float16; all 0 if the sample is turned."""
    seen, noisy, exact, ids, is_turned = _view_of_camera(view, settings, rng)
    x = _inputs(noisy, *seen)
    return x, ids, np.zeros_like(x) if is_turned else _inputs(exact, *seen)


def _view_of_camera(view, settings, rng):
    """What a random camera sees of a crop: colour, camera and the input's channels that are left out; its depth; the
    exact depth; the ids of every second pixel; whether it is turned."""
    turns = _turns(settings.turn, rng)
    size = (settings.height, settings.width) if turns % 2 else (settings.width, settings.height)
    rgb, z, ids, camera = _crop(view, size, rng)
    z *= np.float32(np.exp(rng.uniform(-0.4, 0.3)))
    choice, laid, ground, bare = rng.random(), [], ids, z
    if choice >= settings.no_colour and rng.random() < settings.sheets:
        z, ids, laid = sheets.lay(z, ids, camera, rng)
    is_measured = rng.random() < settings.sensor
    noisy = sensors.measure(z, rgb, ids, camera, rng, settings.noisy) if is_measured else z
    if choice < settings.no_colour:
        rgb = np.zeros((*ids.shape, 3), np.uint8)
    else:
        rgb = _coloured(rgb, bare, ground, camera, laid, settings, rng)
    # Turned only now: the sensor's errors have sides of their own, as its second imager is to the left or right.
    rgb, noisy, exact, ids, camera = turned((rgb, noisy, z, ids), camera, turns)
    without = slice(0)
    if choice < settings.no_colour:
        without = slice(0, 3)
    elif choice < settings.no_colour + settings.no_depth:
        without = slice(3, 8)
    return (rgb, camera, without), noisy, exact, ids[::2, ::2].astype(np.int32), turns != 0


def _inputs(z, rgb, camera, without):
    """The network's input, with 0 in some of its channels."""
    x = inputs(rgb, np.rint(z * 1000).clip(0, 65535).astype(np.uint16), matrix(camera))
    x[without] = 0
    return x.astype(np.float16)


def _coloured(rgb, z, ids, camera, laid, settings, rng):
    """The crop's final colours; `z` and `ids` are without the sheets."""
    if rgb is None:
        rgb = colour.paint(z, ids, camera, rng)
    elif rng.random() < settings.recolour:
        rgb = colour.recolour(rgb, ids, rng)
    return colour.photograph(sheets.printed(rgb, laid, rng), rng)


def matrix(camera):
    """3×3 camera matrix from fx, fy, cx, cy."""
    fx, fy, cx, cy = camera
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def _turns(share, rng):
    """A number of quarter turns: 0, except for a share of the samples; rarely 2."""
    if share <= 0 or rng.random() >= share:
        return 0
    return int(rng.choice([1, 2, 3], p=[0.45, 0.1, 0.45]))


def turned(images, camera, turns):
    """Images [H, W] or [H, W, C] after counterclockwise quarter turns, and the camera fx, fy, cx, cy after them."""
    height, width = images[0].shape[:2]
    for _ in range(turns % 4):
        fx, fy, cx, cy = camera
        camera = np.array([fy, fx, cy, width - 1 - cx])
        height, width = width, height
    return *(np.ascontiguousarray(np.rot90(image, turns)) for image in images), camera


def _crop(view, size, rng):
    """A crop scaled to `size` (width, height), mirrored half of the time: colour or None, depth in metres, ids,
    camera."""
    full_height, full_width = view.depth.shape
    least = max(size[1] / full_height, size[0] / full_width)
    scale = max(least, np.exp(rng.uniform(np.log(0.8), np.log(1.7))))
    height, width = int(size[1] / scale), int(size[0] / scale)
    y, x = rng.integers(full_height - height + 1), rng.integers(full_width - width + 1)
    window = (slice(y, y + height), slice(x, x + width))
    rows, columns = _nearest(height, size[1]), _nearest(width, size[0])
    ids = view.ids[window][rows[:, None], columns[None]]
    z = _depth(view.depth[window].astype(np.float32) / 1000, rows, columns, size)
    rgb = None
    if view.colour is not None:
        rgb = cv2.resize(view.colour[window], size, interpolation=cv2.INTER_LINEAR)
    sx, sy = size[0] / width, size[1] / height
    fx, fy, cx, cy = view.camera
    camera = np.array([fx * sx, fy * sy, (cx - x + 0.5) * sx - 0.5, (cy - y + 0.5) * sy - 0.5])
    if rng.random() < 0.5:
        rgb, z, ids = (image if image is None else np.ascontiguousarray(image[:, ::-1]) for image in (rgb, z, ids))
        camera[2] = size[0] - 1 - camera[2]
    return rgb, z, ids, camera


def _nearest(source, target):
    """For each target pixel the nearest source pixel."""
    return np.clip(np.rint((np.arange(target) + 0.5) * source / target - 0.5).astype(int), 0, source - 1)


def _depth(z, rows, columns, size):
    """Resizes depth: interpolated on surfaces, so that they stay smooth, nearest pixel at edges."""
    nearest = z[rows[:, None], columns[None]]
    linear = cv2.resize(z, size, interpolation=cv2.INTER_LINEAR)
    return np.where(np.abs(linear - nearest) < 0.015 * nearest, linear, nearest)
