"""Noise that grows with the square of the distance; as `splatseg_training.sensors.noise`."""

import torch

from ..fields import correlated_noise
from .view import column


def apply(z, models, draws):
    """Noisy depth [B, H, W] for B of `noise.Noise`; missing depth stays missing."""
    white = [1.0 if model.white >= 1 else model.white for model in models]
    smooth = correlated_noise(draws, z.shape, [0.0 if share == 1 else m.length for m, share in zip(models, white)])
    share = draws.tensor(white)[:, None, None]
    field = smooth * (1 - share).sqrt() + draws.normal(*z.shape) * share.sqrt()
    scale = column(draws, models, "deviation") / 4
    return torch.where(z > 0, (z + scale * z.square() * field).clamp(min=0.05), 0)


def measure(views, models, draws):
    """Depth [B, H, W] of cameras with nothing but noise."""
    return apply(views.z, models, draws)
