"""Structured-light cameras; as `splatseg_training.sensors.structured_light`, whose parameters they have."""

import torch

from ...sensors.structured_light import SCALES
from ..fields import smooth_noise
from . import losses
from .view import column, some


def measure(views, models, draws):
    """Depth [B, H, W] metres, 0 = missing, for B of `StructuredLight`."""
    out = _measured_disparity(_jittered(views.z, column(draws, models, "jitter"), draws), models, draws)
    return out.masked_fill(_lost(views, models, draws) | (views.z <= 0), 0)


def _jittered(z, deviation, draws):
    """Samples depth at points about half a pixel from each pixel's centre."""
    height, width = z.shape[1:]
    shift = torch.round(draws.normal(2, *z.shape) * deviation).long()
    rows = torch.arange(height, device=z.device).view(1, -1, 1) + shift[0]
    columns = torch.arange(width, device=z.device).view(1, 1, -1) + shift[1]
    index = rows.clamp(0, height - 1) * width + columns.clamp(0, width - 1)
    return z.flatten(1).gather(1, index.flatten(1)).view(z.shape)


def _measured_disparity(z, models, draws):
    """Adds white and smooth errors to the disparity, then rounds it to steps."""
    steps = column(draws, models, "steps")
    disparity = steps / z.clamp(min=0.05) + draws.normal(*z.shape) * column(draws, models, "white")
    sizes = draws.tensor([model.smooth for model in models])
    for number, cell in enumerate(SCALES):
        disparity += smooth_noise(draws, z.shape, [float(cell)] * len(z)) * sizes[:, number, None, None]
    disparity = torch.where(column(draws, models, "rounded") > 0, disparity.round(), disparity)
    return torch.where((z > 0) & (disparity >= 1), steps / disparity.clamp(min=1), 0)


def _lost(views, models, draws):
    """The pixels without depth [B, H, W]."""
    value = {name: column(draws, models, name) for name in models[0]._fields if name not in ("smooth", "border")}
    missing = losses.shadow(views.z, views.intrinsics[:, 0, None, None], value["shadow"])
    missing |= losses.edges(views.z, value["edges"], draws)
    missing |= losses.grazing(views, value["grazing"], draws)
    patchy = smooth_noise(draws, views.z.shape, draws.rng.uniform(3, 14, len(models)).tolist())
    missing |= losses.dark(views, patchy, value["dark"])
    missing |= losses.difficult(views, patchy, value["difficult"], value["cover"], draws)
    if chosen := some(draws, [model.blobs > 0 for model in models]):
        picked = [models[number] for number in chosen[0]]
        shape = (len(picked), *views.z.shape[1:])
        sizes = [model.blob_size for model in picked]
        missing[chosen[1]] |= losses.holes(shape, [model.blobs for model in picked], sizes, draws)
    missing |= losses.outside(views.z.shape, [model.border for model in models], draws)
    return missing | losses.out_of_range(views.z, value["nearest"], value["farthest"])
