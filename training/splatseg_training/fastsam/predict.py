"""Predicts the objects of an image like `crates/models/src/fastsam`, but in a slow and simple way, for evaluation and
tests."""

import math
from typing import NamedTuple

import cv2
import numpy as np
import torch
import torch.nn.functional as F

from . import boxes
from .network import PROTOTYPE_STRIDE, STRIDES
from .samples import GREY


class Settings(NamedTuple):
    """Settings of the prediction, with the names and defaults of `splatseg`."""

    image_size: int = 320  # longer side of the input in pixels, a multiple of 32
    confidence: float = 0.4  # minimum score
    iou: float = 0.9  # non-maximum suppression drops the worse of two boxes that overlap by more
    max_det: int = 300


class Objects(NamedTuple):
    """Objects of an image, best first."""

    scores: np.ndarray  # [K] in [0, 1]
    masks: np.ndarray  # [K, height, width] bool, at the image's size


def letterboxed(rgb, image_size):
    """The image [h, w, 3] uint8 scaled to `image_size` and padded to multiples of 32, and its window (x, y, width,
    height)."""
    height, width = rgb.shape[:2]
    ratio = min(image_size / height, image_size / width)
    size = [min(image_size, max(1, round(side * ratio))) for side in (width, height)]
    if size != [width, height]:
        rgb = cv2.resize(rgb, size, interpolation=cv2.INTER_LINEAR)
    spare = [(image_size - side) % STRIDES[-1] for side in size]
    # If the padding is odd, the first side gets the smaller half.
    x, y = (side // 2 for side in spare)
    rgb = cv2.copyMakeBorder(rgb, y, spare[1] - y, x, spare[0] - x, cv2.BORDER_CONSTANT, value=(GREY,) * 3)
    return rgb, (x, y, *size)


@torch.no_grad()
def predict(net, rgb, settings):
    """The `Objects` of an image [h, w, 3] uint8 RGB."""
    padded, window = letterboxed(rgb, settings.image_size)
    device = next(net.parameters()).device
    x = torch.from_numpy(padded).to(device).permute(2, 0, 1)[None].float() / 255
    output = net(x)
    scores = output.scores[0].sigmoid()
    found = boxes.decoded(output.distances, *boxes.anchors(*x.shape[2:], device=device))[0]
    kept = suppressed(scores.cpu().numpy(), found.cpu().numpy(), settings)
    logits = output.coefficients[0, kept] @ output.prototypes[0].flatten(1)
    masks = masks_in_image(logits.view(len(kept), *output.prototypes.shape[2:]), found[kept], rgb.shape[:2], window)
    some = masks.any((1, 2))
    return Objects(scores[kept].cpu().numpy()[some], masks[some])


def suppressed(scores, found, settings):
    """Non-maximum suppression: indices of the kept boxes [A, 4], best first."""
    order = np.argsort(-scores, kind="stable")
    order = order[scores[order] > settings.confidence]
    kept = []
    found = torch.from_numpy(found)
    while len(order) and len(kept) < settings.max_det:
        kept.append(order[0])
        overlap = boxes.iou(found[order[0]], found[order[1:]]).numpy()
        order = order[1:][overlap <= settings.iou]
    return np.array(kept, dtype=int)


def masks_in_image(logits, found, shape, window):
    """Masks [K, *shape] bool from logits [K, h/4, w/4] and boxes [K, 4] of the input, of which the image is `window`.

    Logits are interpolated, thresholded at 0 and cut to their boxes.
    """
    if not len(logits):
        return np.zeros((0, *shape), bool)
    # If the window begins or ends inside a prototype's cell, the map is upscaled first, so that cells can be cut.
    cell = math.gcd(PROTOTYPE_STRIDE, *window)
    if cell < PROTOTYPE_STRIDE:
        scale = PROTOTYPE_STRIDE // cell
        logits = F.interpolate(logits[None], scale_factor=scale, mode="bilinear", align_corners=False)[0]
    x, y, width, height = (side // cell for side in window)
    cut = logits[:, y : y + height, x : x + width]
    large = F.interpolate(cut[None], size=shape, mode="bilinear", align_corners=False)[0]
    offset = torch.tensor(window[:2], device=found.device).repeat(2)
    gain = torch.tensor([shape[1] / window[2], shape[0] / window[3]], device=found.device).repeat(2)
    left, top, right, bottom = ((found - offset) * gain).T[:, :, None, None]
    rows = torch.arange(shape[0], device=found.device)[:, None]
    columns = torch.arange(shape[1], device=found.device)
    inside = (columns >= left) & (columns < right) & (rows >= top) & (rows < bottom)
    return ((large > 0) & inside).cpu().numpy()
