"""Affinities: for each pixel and offset, 1 if both ends of the edge belong to the same object."""

import torch
import torch.nn.functional as F

# (rows, columns), in pixels of the half-size image.
OFFSETS = (
    (0, 1), (1, 0), (0, 3), (3, 0), (0, 9), (9, 0), (9, 9), (9, -9), (0, 27), (27, 0), (18, 18), (18, -18),
)  # fmt: skip
DIFFERENT_WEIGHT = 2.0
MEDIAN_AREA = 400.0  # pixels of the half-size image; larger objects weigh less, smaller ones more


def ends(height, width, offset):
    """Slices of the pixels whose neighbour at the offset is inside the image, and slices of these neighbours."""
    dy, dx = offset
    start = (slice(max(0, -dy), min(height, height - dy)), slice(max(0, -dx), min(width, width - dx)))
    end = (slice(max(0, dy), min(height, height + dy)), slice(max(0, dx), min(width, width + dx)))
    return start, end


def targets(ids):
    """For ids [N, H, W] (0 = unlabelled): targets [N, 12, H, W], 1 for the same object, 0 for another, and a mask of
    the known ones."""
    count, height, width = ids.shape
    same = torch.zeros(count, len(OFFSETS), height, width, device=ids.device)
    known = torch.zeros(count, len(OFFSETS), height, width, dtype=torch.bool, device=ids.device)
    for i, offset in enumerate(OFFSETS):
        start, end = ends(height, width, offset)
        a, b = ids[:, start[0], start[1]], ids[:, end[0], end[1]]
        same[:, i, start[0], start[1]] = (a == b).float()
        known[:, i, start[0], start[1]] = (a > 0) & (b > 0)
    return same, known


def importance(ids, area_power):
    """Weight of each pixel [N, H, W]: (its object's area / MEDIAN_AREA) ** -area_power, within 1/4 and 4."""
    if not area_power:
        return torch.ones(ids.shape, device=ids.device)
    flat = ids.flatten(1)
    areas = torch.zeros(len(ids), int(ids.max()) + 1, device=ids.device)
    areas.scatter_add_(1, flat, torch.ones(flat.shape, device=ids.device))
    weights = (areas.gather(1, flat) / MEDIAN_AREA).pow(-area_power).clamp(0.25, 4)
    return weights.view(ids.shape)


def edge_weights(ids, inverse_depth, area_power, contact_weight):
    """Weights of the edges, [N, 12, H, W]: their objects' importance, times a factor for "different" edges.

    The importance of an edge is that of the smaller of its two objects. `contact_weight` multiplies edges between
    objects at nearly the same depth: touching objects are hard to separate, and their edges are rare.
    """
    pixel = importance(ids, area_power)
    count, height, width = ids.shape
    weights = torch.ones(count, len(OFFSETS), height, width, device=ids.device)
    for i, offset in enumerate(OFFSETS):
        start, end = ends(height, width, offset)
        edge = torch.maximum(pixel[:, start[0], start[1]], pixel[:, end[0], end[1]])
        apart = ids[:, start[0], start[1]] != ids[:, end[0], end[1]]
        step = (inverse_depth[:, start[0], start[1]] - inverse_depth[:, end[0], end[1]]).abs()
        near = step < 0.02 * inverse_depth[:, start[0], start[1]] * (1 + max(map(abs, offset)) / 3)
        different = torch.where(near, DIFFERENT_WEIGHT * contact_weight, DIFFERENT_WEIGHT)
        weights[:, i, start[0], start[1]] = edge * torch.where(apart, different, 1.0)
    return weights


def loss(logits, ids, inverse_depth, area_power=0.5, contact_weight=2.0):
    """Mean weighted cross-entropy of log-odds [N, 12, H, W] over the edges with two labelled ends.

    `ids` [N, H, W] int64; `inverse_depth` [N, H, W] in 1/m, as in the network's input.
    """
    same, known = targets(ids)
    weights = edge_weights(ids, inverse_depth, area_power, contact_weight) * known
    terms = F.binary_cross_entropy_with_logits(logits.float(), same, reduction="none")
    return (terms * weights).sum() / weights.sum().clamp(min=1)


def divergence(logits, told):
    """Mean Kullback-Leibler divergence of log-odds from those of a teacher, both [N, 12, H, W], over edges inside."""
    inside = torch.zeros_like(told, dtype=torch.float32)
    for i, offset in enumerate(OFFSETS):
        start, _ = ends(*told.shape[2:], offset)
        inside[:, i, start[0], start[1]] = 1
    probability = torch.sigmoid(told.float())
    terms = F.binary_cross_entropy_with_logits(logits.float(), probability, reduction="none")
    entropy = F.binary_cross_entropy_with_logits(told.float(), probability, reduction="none")
    return ((terms - entropy) * inside).sum() / inside.sum()
