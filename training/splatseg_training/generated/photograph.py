"""What a camera and chance do to colours [B, 3, H, W] in 0..255; as `splatseg_training.colour.photograph`."""

import torch

from .fields import blurred, smooth_noise

PATCHES = 4  # of an image, at most
BLUR = 1.3  # pixels


def photographed(rgb, draws):
    """Patches that belong to no object, then white balance, tones, blur, a shift against depth, light and noise."""
    batch, _, height, width = rgb.shape
    rgb = _scribbled(rgb, draws)
    rgb = _toned(_saturated(rgb, draws), draws)
    rgb = _shifted(blurred(rgb, draws.uniform(0.4, BLUR, batch) * draws.chance(0.4, batch), BLUR), draws)
    strength = draws.uniform(0, 0.5, batch, 1, 1) * draws.chance(0.5, batch, 1, 1)
    light = smooth_noise(draws, (batch, height, width), draws.rng.uniform(30, 120, batch).tolist())
    rgb = rgb * torch.exp(light * strength)[:, None]
    noise = draws.normal(*rgb.shape) * draws.uniform(0, 12, batch, 1, 1, 1)
    return (rgb + noise).clamp(0, 255).round()


def _scribbled(rgb, draws):
    """Triangles and bands, like prints, stains and shadows, in 30 % of the images."""
    batch, _, height, width = rgb.shape
    rows = torch.arange(height, device=rgb.device).view(1, -1, 1)
    columns = torch.arange(width, device=rgb.device).view(1, 1, -1)
    chosen = draws.chance(0.3, batch)
    for _ in range(PATCHES):
        down = rows - draws.uniform(0, height, batch, 1, 1)
        across = columns - draws.uniform(0, width, batch, 1, 1)
        size = draws.log_uniform(2.7, 55, batch, 1, 1)
        inside = draws.chance(0.6, batch, 1, 1) & chosen[:, None, None]
        for _ in range(3):
            angle = draws.uniform(0, 2 * torch.pi, batch, 1, 1)
            inside = inside & (across * angle.cos() + down * angle.sin() < size)
        inside = inside & (across.square() + down.square() < 9 * size.square())
        opacity = draws.uniform(0.2, 1.0, batch, 1, 1, 1) * inside[:, None]
        rgb = torch.lerp(rgb, draws.uniform(0, 255, batch, 3, 1, 1).expand_as(rgb), opacity)
    return rgb


def _saturated(rgb, draws):
    """Changes saturation and white balance of most images."""
    batch = len(rgb)
    chosen = draws.chance(0.8, batch, 1, 1, 1)
    saturation, gains = draws.uniform(0, 1.8, batch, 1, 1, 1), draws.uniform(0.75, 1.25, batch, 3, 1, 1)
    changed = torch.lerp(rgb.mean(1, keepdim=True), rgb, saturation) * gains
    return torch.where(chosen, changed.clamp(0, 255), rgb)


def _toned(rgb, draws):
    """Changes gamma, contrast and brightness."""
    batch = len(rgb)
    gamma = torch.exp(draws.uniform(-0.6, 0.6, batch, 1, 1, 1))
    middle = (rgb.mean((1, 2, 3), keepdim=True) / 255).clamp(min=1e-3) ** gamma
    tones = (rgb / 255).clamp(1e-4, 1) ** gamma
    contrast, brighter = draws.uniform(0.5, 1.5, batch, 1, 1, 1), draws.uniform(-0.2, 0.2, batch, 1, 1, 1)
    tones = (tones - middle) * contrast + middle + brighter
    return tones.clamp(0, 1) * 255


def _shifted(rgb, draws):
    """Shifts 60 % of the images by up to 2 pixels relative to the depth, between pixels by linear interpolation."""
    batch, _, height, width = rgb.shape
    chosen = draws.chance(0.6, batch)
    across, down = draws.uniform(-2, 2, batch) * chosen, draws.uniform(-1.5, 1.5, batch) * chosen
    columns = torch.arange(width, device=rgb.device)[None] - across[:, None]
    rows = torch.arange(height, device=rgb.device)[None] - down[:, None]
    return _between(_between(rgb, columns[:, None, None, :], 3), rows[:, None, :, None], 2)


def _between(rgb, at, axis):
    """Colours at places between the pixels of an axis; beyond the border, those of the border."""
    size = rgb.shape[axis]
    at = at.clamp(0, size - 1)
    low = at.floor().clamp(max=size - 2)
    first = rgb.gather(axis, low.long().expand_as(rgb))
    return torch.lerp(first, rgb.gather(axis, (low.long() + 1).expand_as(rgb)), (at - low).expand_as(rgb))
