"""Missing depth: masks [B, H, W] of the pixels that sensors do not measure; as `splatseg_training.sensors.losses`."""

import torch
import torch.nn.functional as F

from ..fields import below_share, blurred, correlated_noise, noise_of_objects, smooth_noise
from .view import cosine, is_jump, nearest_and_farthest, some


def shadow(z, fx, baseline):
    """Pixels in the shadow of the projector or second camera, `baseline` [B, 1, 1] metres beside the camera.

    `fx` [B, 1, 1] pixels. The shadow is to the left of near things, for a negative baseline to their right.
    """
    left = _shadow(z, fx, baseline.clamp(min=0))
    right = _shadow(z.flip(2), fx, (-baseline).clamp(min=0)).flip(2)
    return torch.where(baseline > 0, left, right) & (baseline != 0)


def _shadow(z, fx, baseline):
    near = torch.where(z > 0, fx * baseline / z.clamp(min=0.05), 0)
    seen = torch.arange(z.shape[2], device=z.device) - near
    return seen > torch.cummin(seen.flip(2), 2).values.flip(2) + 0.5


def edges(z, share, draws):
    """A share [B, 1, 1] of the pixels where the depth jumps."""
    return is_jump(*nearest_and_farthest(z, 1)) & draws.chance(share, *z.shape)


def grazing(views, limit, draws):
    """Surfaces nearly parallel to the ray: randomly below a cosine of `limit` [B, 1, 1], all at 0.1 less."""
    return draws.uniform(0, 0.1, *views.z.shape) < limit - cosine(views)


def dark(views, patchy, limit):
    """Surfaces darker than `limit` [B, 1, 1], 0..255, with patchy borders."""
    return (views.brightness + 15 * patchy < limit) & (limit > 0)


def difficult(views, patchy, share, cover, draws):
    """Patches on a share of the objects, like glass, screens and metal; `cover` is the patches' least noise."""
    chosen = draws.chance(share[:, 0], len(views.ids), views.count)
    return chosen.gather(1, views.ids.flatten(1)).view(views.ids.shape) & (patchy > cover)


def holes(shape, share, length, draws):
    """Holes in about a share of the pixels, in blobs of about `length` pixels; B numbers of the host each."""
    deviation = [value / 2.5 if value >= 1.5 else 0.0 for value in length]
    return below_share(correlated_noise(draws, shape, deviation), share)


def outside(shape, borders, draws):
    """The pixels in borders, B of `losses.Border` or None."""
    out = torch.zeros(shape, dtype=torch.bool, device=draws.device)
    if not (chosen := some(draws, borders)):
        return out
    present = [borders[number] for number in chosen[0]]
    shape = (len(present), *shape[1:])
    wave = smooth_noise(draws, shape, [16.0] * len(present)) * draws.tensor([b.wavy for b in present])[:, None, None]
    top, bottom, left, right = draws.tensor([b.widths for b in present])[:, :, None, None].unbind(1)
    tilt = draws.tensor([b.tilt for b in present])[:, None, None]
    rows = torch.arange(shape[1], device=wave.device).view(1, -1, 1)
    columns = torch.arange(shape[2], device=wave.device).view(1, 1, -1)
    down = rows + wave + tilt * (columns - shape[2] / 2)
    across = columns + wave - tilt * (rows - shape[1] / 2)
    missing = (down < top - 0.5) | (down > shape[1] - bottom - 0.5)
    out[chosen[1]] = missing | (across < left - 0.5) | (across > shape[2] - right - 0.5)
    return out


def out_of_range(z, nearest, farthest):
    """Depth outside `nearest`..`farthest`, [B, 1, 1] metres."""
    return (z > farthest) | (z < nearest)


def textureless(views, shares, windows, draws):
    """The shares of the pixels with the least texture, smoothed over `windows` pixels; B numbers of the host each.

    Without colour: smooth random areas, mostly on a few objects.
    """
    random = smooth_noise(draws, views.z.shape, draws.rng.uniform(6, 40, len(shares)).tolist())
    random += 1.5 * noise_of_objects(draws, views.ids, views.count)
    padded = F.pad(views.brightness[:, None], (1, 1, 1, 1), mode="reflect")[:, 0]
    around = padded[:, :-2, 1:-1] + padded[:, 2:, 1:-1] + padded[:, 1:-1, :-2] + padded[:, 1:-1, 2:]
    # Twice a box of w pixels has about the deviation of a Gaussian of w / sqrt(6).
    deviation = [window / 6**0.5 for window in windows]
    texture = blurred((around - 4 * views.brightness).abs(), draws.tensor(deviation), max(deviation))
    texture += 0.5 * smooth_noise(draws, views.z.shape, [8.0] * len(shares))
    return below_share(torch.where(views.coloured[:, None, None], texture, random), shares)
