"""The exact views that sensors measure, and their geometry; as `splatseg_training.sensors.scene`."""

from typing import NamedTuple

import torch
import torch.nn.functional as F

from ..fields import blurred

FAR = 100.0  # metres, stands for missing depth where the nearest depth is searched


class Views(NamedTuple):
    """Exact views. Pixel centres are at integer coordinates."""

    z: torch.Tensor  # [B, H, W] metres, 0 = missing
    brightness: torch.Tensor  # [B, H, W] 0..255, of the colours
    coloured: torch.Tensor  # [B] bool; False where the brightness is only one number per object
    ids: torch.Tensor  # [B, H, W] int64, below `count`
    intrinsics: torch.Tensor  # [B, 4]: fx, fy, cx, cy in pixels
    count: int  # of ids

    def take(self, index):
        """The views with these numbers [N]."""
        return Views(*(tensor[index] for tensor in self[:-1]), self.count)


def column(draws, models, name):
    """A parameter of each model, as a tensor [B, 1, 1]."""
    return draws.tensor([float(getattr(model, name)) for model in models])[:, None, None]


def some(draws, flags):
    """The numbers of the samples that have a host's flag, as a list and as a tensor, or None if there are none."""
    numbers = [number for number, flag in enumerate(flags) if flag]
    return (numbers, draws.tensor(numbers, torch.int64)) if numbers else None


def rays(views):
    """Columns [B, 1, W] and rows [B, H, 1] of the pixels relative to the principal point, in pixels."""
    height, width = views.z.shape[1:]
    cx, cy = views.intrinsics[:, 2, None, None], views.intrinsics[:, 3, None, None]
    u = torch.arange(width, device=cx.device).view(1, 1, -1) - cx
    return u, torch.arange(height, device=cx.device).view(1, -1, 1) - cy


def cosine(views):
    """Cosine [B, H, W] between surface and ray."""
    z, (u, v) = views.z, rays(views)
    fx, fy = views.intrinsics[:, 0, None, None], views.intrinsics[:, 1, None, None]
    padded = F.pad(z[:, None], (1, 1, 1, 1), mode="reflect")[:, 0]
    down = padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]
    across = padded[..., :-2] + 2 * padded[..., 1:-1] + padded[..., 2:]
    dx, dy = (down[..., 2:] - down[..., :-2]) / 8, (across[:, 2:] - across[:, :-2]) / 8
    normal = ((fx * dx).square() + (fy * dy).square() + (z + u * dx + v * dy).square()).sqrt()
    return z / (normal * ((u / fx).square() + (v / fy).square() + 1).sqrt() + 1e-6)


def nearest_and_farthest(z, radius):
    """The least and the greatest depth [B, H, W] within squares of 2 `radius` + 1 pixels, without the missing ones.

    Where there is none, they are FAR and 0.
    """
    near = -F.max_pool2d(-z.where(z > 0, FAR)[:, None], 2 * radius + 1, 1, radius)[:, 0]
    return near, F.max_pool2d(z[:, None], 2 * radius + 1, 1, radius)[:, 0]


def is_jump(near, far):
    """Whether the step between two depths is one between surfaces, not a slope."""
    return far - near > 0.03 + 0.04 * near


def smeared(z, deviation, largest):
    """Depth blurred over `deviation` [B] pixels; missing depth is filled from its neighbours where they are close."""
    weight = blurred((z > 0).float(), deviation, largest)
    return torch.where(weight > 0.1, blurred(z, deviation, largest) / weight.clamp(min=0.1), 0)
