"""Training samples: colours, scaled crop, objects' boxes."""

from typing import NamedTuple

import cv2
import numpy as np
from scipy import ndimage

from .. import colour

MAX_OBJECTS = 128  # per sample; the largest are kept
GREY = 114  # padding of images that do not fill the input, as in `crates/models/src/fastsam/letterbox.rs`


class Settings(NamedTuple):
    """Probabilities and sizes of the augmentation."""

    height: int = 256  # of a sample
    width: int = 320
    recolour: float = 0.3  # probability that objects get new colours and textures
    photograph: float = 0.7  # probability of changed light, camera and noise
    smallest: float = 0.6  # minimum scale of an image, relative to the scale that fills the sample's width
    largest: float = 1.6
    min_pixels: int = 20  # objects with fewer are omitted


def sample(view, settings, rng):
    """Image [3, height, width] uint8 RGB, ids [height, width] uint8 and boxes [MAX_OBJECTS, 4] float32 of a view.

    Object k has id k + 1 and row k of the boxes: left, top, right, bottom in pixels; 0 is background.
    """
    rgb = _coloured(view, settings, rng)
    move = _placement(view.ids.shape, settings, rng)
    size = (settings.width, settings.height)
    image = cv2.warpAffine(rgb, move, size, flags=cv2.INTER_LINEAR, borderValue=(GREY,) * 3)
    ids = cv2.warpAffine(view.ids, move, size, flags=cv2.INTER_NEAREST)
    ids, boxes = objects(ids, settings.min_pixels)
    return np.ascontiguousarray(image.transpose(2, 0, 1)), ids, boxes


def _coloured(view, settings, rng):
    rgb = view.colour
    if rgb is None:
        depth = view.depth.astype(np.float32) / 1000
        rgb = colour.paint(depth, view.ids, view.camera, rng)
    elif rng.random() < settings.recolour:
        rgb = colour.recolour(rgb, view.ids, rng)
    if rng.random() < settings.photograph:
        # Depth is not an input here, so shifting an image relative to its ids would only blur the masks.
        rgb = colour.photograph(rgb, rng, shift=0)
    return rgb


def _placement(shape, settings, rng):
    """A 2×3 affine map from an image to the sample: scaled, at a random position, mirrored half of the time."""
    scale = settings.width / shape[1] * np.exp(rng.uniform(np.log(settings.smallest), np.log(settings.largest)))
    x, y = (
        rng.uniform(0, 1) * (to - scale * side)
        for to, side in ((settings.width, shape[1]), (settings.height, shape[0]))
    )
    # Pixel centres are at integer coordinates, so the corner of the image is at -1/2.
    move = np.array([[scale, 0, x + scale / 2 - 0.5], [0, scale, y + scale / 2 - 0.5]])
    if rng.random() < 0.5:
        move[0] = -move[0]
        move[0, 2] += settings.width - 1
    return move


def objects(ids, min_pixels):
    """Ids from 1 and boxes of the objects with enough pixels, largest first; see `sample`."""
    areas = np.bincount(ids.ravel())
    areas[0] = 0
    kept = np.argsort(-areas, kind="stable")[:MAX_OBJECTS]
    kept = kept[areas[kept] >= max(1, min_pixels)]
    number = np.zeros(len(areas), np.uint8)
    number[kept] = np.arange(1, len(kept) + 1)
    ids = number[ids]
    boxes = np.zeros((MAX_OBJECTS, 4), np.float32)
    for k, (rows, columns) in enumerate(ndimage.find_objects(ids)):
        boxes[k] = columns.start, rows.start, columns.stop, rows.stop
    return ids, boxes
