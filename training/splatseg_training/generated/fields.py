"""Random fields and filters with one size per sample, for batches [B, H, W]."""

import math

import numpy as np
import torch
import torch.nn.functional as F

_FINEST = 1.5  # cells, deviation of the smoothing on a coarse grid: the least that survives bilinear enlargement


def smooth_noise(draws, shape, cell):
    """Smooth Gaussian noise [B, H, W] with scales of about `cell` pixels, B numbers of the host."""
    batch, height, width = shape
    least = min(cell)
    coarse = draws.normal(batch, int(height / least) + 3, int(width / least) + 3)
    return enlarged(coarse, draws.tensor(cell), height, width)


def enlarged(coarse, cell, height, width):
    """Bilinear enlargement of grids [B, h, w], whose points are `cell` [B] pixels apart, to [B, height, width]."""
    across = _interpolated(coarse, cell, width, 2)
    return _interpolated(across, cell, height, 1)


def _interpolated(values, cell, size, axis):
    """Values [B, h, w] interpolated along an axis to `size` points."""
    at = torch.arange(size, device=values.device)[None] / cell[:, None]
    low = at.floor().clamp(max=values.shape[axis] - 2)
    share, low = at - low, low.long()
    view = (len(cell), 1, size) if axis == 2 else (len(cell), size, 1)
    shape = list(values.shape)
    shape[axis] = size
    first = values.gather(axis, low.view(view).expand(shape))
    second = values.gather(axis, (low + 1).view(view).expand(shape))
    return torch.lerp(first, second, share.view(view))


def correlated_noise(draws, shape, length):
    """Gaussian noise [B, H, W] of deviation 1, smoothed by Gaussians with deviations of `length` pixels, B
    numbers of the host; a length of 0 is white."""
    batch, height, width = shape
    cells = [max(1.0, value / _FINEST) for value in length]
    rows, columns = int(height / min(cells)) + 3, int(width / min(cells)) + 3
    deviation = draws.tensor([value / cell for value, cell in zip(length, cells)])
    radius = math.ceil(3 * _FINEST)
    noise = draws.normal(batch, rows + 2 * radius, columns + 2 * radius)
    kernel = gaussian(deviation, radius)
    smooth = _filtered(_filtered(noise, kernel, 2), kernel, 1) / kernel.square().sum(1)[:, None, None]
    if max(cells) == 1:
        return smooth[:, :height, :width]
    return enlarged(smooth, draws.tensor(cells), height, width)


def gaussian(deviation, radius):
    """Gaussian kernels [B, 2 radius + 1] for deviations [B] in pixels; 0 leaves the image as it is."""
    at = torch.arange(-radius, radius + 1, device=deviation.device)[None] / deviation.clamp(min=1e-3)[:, None]
    kernel = torch.exp(-0.5 * at.square())
    return kernel / kernel.sum(1, keepdim=True)


def _filtered(image, kernel, axis):
    """Images [B, ...] correlated along an axis with kernels [B, K]; only where the kernel fits."""
    taps = kernel.shape[1]
    size = image.shape[axis] - taps + 1
    weights = kernel.view(len(kernel), taps, *[1] * (image.dim() - 1))
    out = image.narrow(axis, 0, size) * weights[:, 0]
    for tap in range(1, taps):
        out.addcmul_(image.narrow(axis, tap, size), weights[:, tap])
    return out


def blurred(image, deviation, largest):
    """Images [B, H, W] or [B, C, H, W] blurred over `deviation` [B] pixels, none more than the number `largest`."""
    radius = max(1, math.ceil(3 * largest))
    kernel = gaussian(deviation, radius)
    padded = F.pad(image if image.dim() == 4 else image[:, None], [radius] * 4, mode="replicate")
    padded = padded if image.dim() == 4 else padded[:, 0]
    return _filtered(_filtered(padded, kernel, image.dim() - 1), kernel, image.dim() - 2)


def below_share(field, share):
    """The pixels with the least values of fields [B, H, W]; `share` of the pixels, B numbers of the host."""
    part = field[:, ::3, ::3].flatten(1)
    index = [min(part.shape[1] - 1, int(value * part.shape[1])) for value in share]
    limit = part.sort(1).values.gather(1, torch.from_numpy(np.array(index)).to(field.device)[:, None])
    return field < limit[:, :, None]


def noise_of_objects(draws, ids, count):
    """One Gaussian number per object, at its pixels [B, H, W]; ids are below `count`."""
    values = draws.normal(len(ids), count)
    return values.gather(1, ids.flatten(1)).view(ids.shape)
