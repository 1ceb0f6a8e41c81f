"""Coarse depth maps that are enlarged; as `splatseg_training.sensors.lidar`, whose parameters they have.

The maps stay on the grid of the colours: depth is averaged over the area of a coarse pixel by the smearing, then sampled
at the coarse pixels and interpolated between them.
"""

import torch

from ..fields import correlated_noise
from . import losses
from .view import column, is_jump, nearest_and_farthest, smeared, some


def measure(views, models, draws):
    """Depth [B, H, W] metres, 0 = missing, for B of `Lidar`."""
    height, width = views.z.shape[1:]
    deviation = [model.smear for model in models]
    fine = smeared(views.z, draws.tensor(deviation), max(deviation))
    scale = column(draws, models, "scale")
    rows, columns = _grid(scale, height, 1), _grid(scale, width, 2)
    z = _sampled(_sampled(fine, rows, 1), columns, 2)
    # On the coarse map, noise has this length; on the grid of the colours it is as much larger as the map is smaller.
    lengths = [model.length / model.scale for model in models]
    z = z * (1 + column(draws, models, "noise") * correlated_noise(draws, z.shape, lengths))
    lost = losses.out_of_range(z, column(draws, models, "nearest"), column(draws, models, "farthest"))
    unsure = draws.chance(column(draws, models, "unsure"), *z.shape)
    lost |= is_jump(*nearest_and_farthest(z, 1)) & unsure
    if chosen := some(draws, [model.holes > 0 for model in models]):
        picked = [models[number] for number in chosen[0]]
        sizes = [model.hole_size / model.scale for model in picked]
        shape = (len(picked), height, width)
        lost[chosen[1]] |= losses.holes(shape, [model.holes for model in picked], sizes, draws)
    return z.masked_fill(lost, 0)


def _grid(scale, size, axis):
    """For each pixel along an axis: the two pixels at the nearest coarse pixels, and the share of the second."""
    at = (torch.arange(size, device=scale.device)[None] + 0.5) * scale[:, 0] - 0.5
    low = at.floor()
    ends = [(((point + 0.5) / scale[:, 0]) - 0.5).round().clamp(0, size - 1).long() for point in (low, low + 1)]
    view = (-1, size, 1) if axis == 1 else (-1, 1, size)
    return ends[0].view(view), ends[1].view(view), (at - low).view(view)


def _sampled(z, grid, axis):
    """Depth [B, H, W] interpolated along an axis between the coarse pixels."""
    first, second, share = grid
    return torch.lerp(z.gather(axis, first.expand(z.shape)), z.gather(axis, second.expand(z.shape)), share)
