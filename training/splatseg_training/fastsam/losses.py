"""The loss of FastSAM's network."""

import torch
import torch.nn.functional as F

from .assignment import assign
from .boxes import anchors, complete_iou, decoded
from .network import BINS, PROTOTYPE_STRIDE

# Weights of the parts. The weights of score, box and distance are YOLOv8's documented defaults.
WEIGHTS = {"score": 0.5, "box": 7.5, "distance": 1.5, "mask": 5.0}


def losses(output, ids, truth):
    """The weighted parts of the loss of an `Output`, by name.

    `ids` [N, H, W] integers: 0 for background, k + 1 for object k; `truth` [N, M, 4]: boxes of the objects in pixels,
    rows of zeros beyond the last object.
    """
    points, strides = anchors(*ids.shape[1:], device=ids.device)
    truth = truth[:, : max(1, int((truth[..., 2] > 0).sum(1).max()))]
    scores = output.scores.float()
    boxes = decoded(output.distances, points, strides)
    owner, quality = assign(scores.detach().sigmoid(), boxes.detach(), points, truth)
    total = quality.sum().clamp(min=1)
    image, anchor = (owner >= 0).nonzero(as_tuple=True)
    objects, weight = owner[image, anchor], quality[image, anchor] / total
    targets = truth[image, objects]
    distances = output.distances[image, anchor].float()
    parts = {
        "score": F.binary_cross_entropy_with_logits(scores, quality, reduction="sum") / total,
        "box": (weight * (1 - complete_iou(boxes[image, anchor], targets))).sum(),
        "distance": (weight * distance_loss(distances, targets, points[anchor], strides[anchor])).sum(),
        "mask": (weight * mask_loss(output, ids, truth, owner)).sum(),
    }
    return {name: WEIGHTS[name] * part for name, part in parts.items()}


def distance_loss(distances, targets, points, strides):
    """Distribution focal loss (Li et al. 2020, equation 6) [K] of logits [K, 4, BINS]: the mean over the four sides.

    The cross-entropy of the two bins around the true distance, each weighted by its nearness.
    """
    sides = torch.cat([points - targets[:, :2], targets[:, 2:] - points], 1) / strides[:, None]
    sides = sides.clamp(0, BINS - 1.01)
    lower = sides.long()
    share = (sides - lower)[..., None]
    log = distances.log_softmax(-1)
    lower = lower[..., None]
    return -(log.gather(-1, lower) * (1 - share) + log.gather(-1, lower + 1) * share)[..., 0].mean(1)


def mask_loss(output, ids, truth, owner):
    """Binary cross-entropy of masks [K], for the K anchors with an owner in the order of `nonzero`.

    As in YOLACT (Bolya et al. 2019, section 3.1), a mask is the combination of the prototypes by its coefficients, and
    its loss is the mean over its object's box. The target is the share of a prototype cell's 4×4 pixels that the object
    covers.
    """
    covered = coverage(ids, truth.shape[1])
    inside = _cells(truth, covered.shape[2:])
    found = []
    for n in range(len(ids)):
        anchor = (owner[n] >= 0).nonzero()[:, 0]
        objects = owner[n, anchor]
        logits = output.coefficients[n, anchor].float() @ output.prototypes[n].flatten(1).float()
        error = F.binary_cross_entropy_with_logits(logits, covered[n].flatten(1)[objects], reduction="none")
        cells = inside[n].flatten(1)
        found.append((error * cells[objects]).sum(1) / cells.sum(1)[objects])
    return torch.cat(found)


def coverage(ids, count):
    """Shares [N, count, H / 4, W / 4] of the prototypes' cells covered by objects 0 to count - 1."""
    step = PROTOTYPE_STRIDE
    n, height, width = ids.shape[0], ids.shape[1] // step, ids.shape[2] // step
    cells = ids.long().view(n, height, step, width, step).permute(0, 2, 4, 1, 3).reshape(n, step * step, -1)
    shares = torch.zeros(n, count + 1, height * width, device=ids.device)
    shares.scatter_add_(1, cells, torch.full(cells.shape, 1 / step**2, device=ids.device))
    return shares[:, 1:].view(n, count, height, width)


def _cells(truth, size):
    """1 for the prototypes' cells touched by boxes [N, M, 4], else 0; float [N, M, *size]."""

    def along(first, last, count):
        cell = torch.arange(count, device=truth.device) * PROTOTYPE_STRIDE
        return (cell + PROTOTYPE_STRIDE > first[..., None]) & (cell < last[..., None])

    rows = along(truth[..., 1], truth[..., 3], size[0])
    columns = along(truth[..., 0], truth[..., 2], size[1])
    return (rows[..., :, None] & columns[..., None, :]).float()
