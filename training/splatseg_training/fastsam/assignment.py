"""Task-aligned assignment of anchors to objects (TOOD, Feng et al. 2021, section 3.2)."""

from typing import NamedTuple

import torch

from .boxes import area, iou
from .network import STRIDES

SCORE_POWER = 0.5  # alpha of the paper's equation 1
IOU_POWER = 6.0  # beta
TOP = 10  # anchors per object


class Assignment(NamedTuple):
    """The objects assigned to anchors."""

    owner: torch.Tensor  # [N, A] index of the object, -1 for background
    quality: torch.Tensor  # [N, A] target score of the anchor; 0 for background


@torch.no_grad()
def assign(scores, boxes, points, truth):
    """The `Assignment` for scores [N, A] in [0, 1], boxes [N, A, 4], anchors' centres [A, 2] and truth [N, M, 4].

    Rows of `truth` without an area are padding. An object's candidates are the anchors inside its box; the `TOP` best
    by score^alpha · IoU^beta are taken. An anchor selected by several objects is assigned to the one with the largest
    IoU.
    """
    overlap = iou(truth[:, :, None], boxes[:, None])
    inside = _contains(truth, points)
    alignment = scores[:, None] ** SCORE_POWER * overlap**IOU_POWER * inside
    best = alignment.topk(min(TOP, alignment.shape[2]), dim=2).indices
    taken = torch.zeros_like(inside).scatter_(2, best, True) & inside
    owner = torch.where(taken, overlap, -1.0).argmax(1)
    taken &= owner[:, None] == torch.arange(truth.shape[1], device=owner.device)[:, None]
    # Scaled so that an object's best aligned anchor has the object's largest IoU (the paper's t-hat).
    alignment = alignment * taken
    largest = (overlap * taken).amax(2, keepdim=True)
    quality = alignment / alignment.amax(2, keepdim=True).clamp(min=1e-30) * largest
    return Assignment(torch.where(taken.any(1), owner, -1), quality.amax(1))


def _contains(truth, points):
    """True where an anchor's centre is inside an object's box, [N, M, A].

    A box is treated as at least one fine stride wide and high; otherwise a small object could have no anchor.
    """
    centre = (truth[..., :2] + truth[..., 2:]) / 2
    half = ((truth[..., 2:] - truth[..., :2]) / 2).clamp(min=STRIDES[0] / 2)
    near = ((points - centre[:, :, None]).abs() <= half[:, :, None]).all(-1)
    return near & (area(truth) > 0)[..., None]
