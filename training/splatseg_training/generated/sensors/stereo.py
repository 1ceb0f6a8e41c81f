"""Stereo cameras; as `splatseg_training.sensors.stereo`, whose parameters they have."""

import torch

from ..fields import below_share, correlated_noise, smooth_noise
from . import losses, noise
from .view import FAR, column, is_jump, some

TURN = 2 * torch.pi


def measure(views, models, draws):
    """Depth [B, H, W] metres, 0 = missing, for B of `Stereo`."""
    z = fattened(views.z, models, draws)
    lost = _lost(views, z, models, draws)
    z = _mismatched(z, models, draws)
    z = noise.apply(z, [model.noise for model in models], draws)
    return stepped(z, models, draws).masked_fill(lost, 0)


def fattened(z, models, draws):
    """Depth where the foreground has grown by up to 4 pixels, sometimes by one less."""
    sides = draws.tensor([model.fatten for model in models], torch.int64)[:, :, None, None]
    near, less = _grown(z, sides), _grown(z, (sides - 1).clamp(min=0))
    ragged = below_share(correlated_noise(draws, z.shape, [1.6] * len(models)), [model.ragged for model in models])
    near = torch.where(ragged, less, near)
    jump = is_jump(near, z.where(z > 0, FAR)) & (sides.amax(1) > 0)
    return near.where(jump, z)


def _grown(z, sides):
    """The nearest depth among the pixels from which foreground grows to each pixel; FAR where there is none.

    `sides` [B, 4, 1, 1]: left, right, top, bottom, up to 4 pixels. To grow to the left, a pixel takes the depth of its
    right neighbours.
    """
    z = z.where(z > 0, FAR)
    for first, axis in ((0, 2), (2, 1)):
        out = z
        for step in range(1, 5):
            size = z.shape[axis] - step
            for side, sign in ((first, 1), (first + 1, -1)):
                from_start = sign > 0
                source = z.narrow(axis, step if from_start else 0, size)
                target = out.narrow(axis, 0 if from_start else step, size)
                grown = torch.where(sides[:, side] >= step, torch.minimum(target, source), target)
                rest = out.narrow(axis, size if from_start else 0, step)
                out = torch.cat((grown, rest) if from_start else (rest, grown), axis)
        z = out
    return z


def stepped(z, models, draws):
    """Depth [B, H, W] from disparities that are drawn to whole pixels and rounded to steps."""
    focal_baseline, step = column(draws, models, "focal_baseline"), column(draws, models, "step")
    disparity = focal_baseline / z.clamp(min=0.05)
    disparity = disparity - torch.sin(TURN * disparity) * column(draws, models, "locking") / TURN
    disparity = (disparity / step).round() * step
    return torch.where((z > 0) & (disparity > 0), focal_baseline / disparity.clamp(min=1e-3), 0)


def _mismatched(z, models, draws):
    """Depth with wrong matches: patches that are up to a third too near or half too far."""
    if not (chosen := some(draws, [model.wrong > 0 for model in models])):
        return z
    picked = [models[number] for number in chosen[0]]
    part = z[chosen[1]]
    wrong = losses.holes(part.shape, [m.wrong for m in picked], [m.wrong_size for m in picked], draws)
    factor = torch.exp((smooth_noise(draws, part.shape, [5.0] * len(picked)) * 0.3).clamp(-0.4, 0.4))
    z = z.clone()
    z[chosen[1]] = torch.where(wrong, part * factor, part)
    return z


def _lost(views, z, models, draws):
    """The pixels without depth [B, H, W]; `z` has the fattened foreground."""
    names = ("shadow", "band", "dark", "shiny", "cover", "grazing", "nearest", "farthest")
    value = {name: column(draws, models, name) for name in names}
    missing = losses.shadow(z, views.intrinsics[:, 0, None, None], value["shadow"])
    missing |= losses.out_of_range(z, value["nearest"], value["farthest"])
    columns = torch.arange(z.shape[2], device=z.device).view(1, 1, -1)
    band = (value["band"].abs() * z.shape[2]).round()
    missing |= torch.where(value["band"] > 0, columns, z.shape[2] - 1 - columns) < band
    if chosen := some(draws, [model.textureless > 0 for model in models]):
        picked = [models[number] for number in chosen[0]]
        shares, windows = [m.textureless for m in picked], [m.window for m in picked]
        missing[chosen[1]] |= losses.textureless(views.take(chosen[1]), shares, windows, draws)
    patchy = smooth_noise(draws, z.shape, draws.rng.uniform(3, 14, len(models)).tolist())
    missing |= losses.dark(views, patchy, value["dark"])
    missing |= losses.difficult(views, patchy, value["shiny"], value["cover"], draws)
    return missing | losses.grazing(views._replace(z=z), value["grazing"], draws)
