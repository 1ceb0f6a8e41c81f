"""Boxes: left, top, right and bottom in pixels of the network's input, float32 [..., 4]."""

import math

import torch

from .network import BINS, STRIDES


def anchors(height, width, device=None):
    """Centres (x, y) [A, 2] and strides [A] of the anchors of an input of `height` × `width` pixels."""
    points, strides = [], []
    for stride in STRIDES:
        y = (torch.arange(height // stride, device=device) + 0.5) * stride
        x = (torch.arange(width // stride, device=device) + 0.5) * stride
        grid = torch.stack(torch.meshgrid(y, x, indexing="ij"), -1).reshape(-1, 2)
        points.append(grid.flip(1))
        strides.append(torch.full((len(grid),), float(stride), device=device))
    return torch.cat(points), torch.cat(strides)


def decoded(distances, points, strides):
    """Boxes [N, A, 4] from logits of distances [N, A, 4, BINS]: each distance is its distribution's mean."""
    bins = torch.arange(BINS, dtype=torch.float32, device=distances.device)
    sides = distances.float().softmax(-1) @ bins * strides[:, None]
    return torch.cat([points - sides[..., :2], points + sides[..., 2:]], -1)


def area(boxes):
    return (boxes[..., 2] - boxes[..., 0]) * (boxes[..., 3] - boxes[..., 1])


def iou(a, b):
    """Intersection over union; shapes are broadcast."""
    low, high = torch.maximum(a[..., :2], b[..., :2]), torch.minimum(a[..., 2:], b[..., 2:])
    shared = (high - low).clamp(min=0).prod(-1)
    return shared / (area(a) + area(b) - shared).clamp(min=1e-6)


def complete_iou(predicted, truth):
    """CIoU (Zheng et al. 2020, equations 8 to 11): IoU minus penalties for the centre distance and the difference of
    aspect ratios."""
    overlap = iou(predicted, truth)
    low = torch.minimum(predicted[..., :2], truth[..., :2])
    high = torch.maximum(predicted[..., 2:], truth[..., 2:])
    diagonal = (high - low).square().sum(-1).clamp(min=1e-6)
    centres = (predicted[..., :2] + predicted[..., 2:] - truth[..., :2] - truth[..., 2:]) / 2
    aspect = 4 / math.pi**2 * (_aspect(truth) - _aspect(predicted)).square()
    with torch.no_grad():
        weight = aspect / (1 - overlap + aspect).clamp(min=1e-6)
    return overlap - centres.square().sum(-1) / diagonal - weight * aspect


def _aspect(boxes):
    width, height = boxes[..., 2] - boxes[..., 0], boxes[..., 3] - boxes[..., 1]
    return torch.atan(width / height.clamp(min=1e-3))
