"""The eight input channels of `splatseg_training.inputs`, for batches of tensors on any device."""

import torch
import torch.nn.functional as F

from ..inputs import _NEIGHBOURS

_FAR = 1 << 20  # pixels, further than any pixel of an image


def inputs(rgb, z, intrinsics):
    """The network's input, float32 [B, 8, H, W].

    `rgb` [B, 3, H, W] in 0..255, `z` [B, H, W] metres (0 = missing), rounded here to millimetres like a depth image,
    `intrinsics` [B, 4]: fx, fy, cx, cy. Without any depth, all depth channels are 0.
    """
    z = (torch.round(z * 1000).clamp(0, 65535) / 1000).clamp(max=100)
    full = filled(z)
    inverse = 1 / full.clamp(min=0.3) - 0.5
    depth = torch.cat((inverse[:, None], (z > 0)[:, None], normals(smoothed(full), intrinsics)), 1)
    some = (z > 0).any(2).any(1)[:, None, None, None]
    return torch.cat((rgb / 127.5 - 1, depth * some), 1)


def filled(z):
    """Depth [B, H, W] with every hole (0) filled from the nearest pixel in city-block distance.

    First within the rows, where left wins ties; then from above and from below, as `splatseg_training.inputs`.
    """
    columns = torch.arange(z.shape[2], device=z.device, dtype=torch.int32).expand(z.shape)
    left = torch.cummax(columns.where(z > 0, -_FAR), 2).values
    right = torch.cummin(columns.where(z > 0, _FAR).flip(2), 2).values.flip(2)
    to_left, to_right = columns - left, right - columns
    nearest = left.where(to_left <= to_right, right).clamp(0, z.shape[2] - 1)
    z, distance = z.gather(2, nearest.long()).mT, torch.minimum(to_left, to_right).mT
    z, distance = _from_the_left(z.contiguous(), distance.contiguous())  # transposed: from above
    z, _ = _from_the_left(z.flip(2), distance.flip(2))
    return z.flip(2).mT.contiguous()


def _from_the_left(z, distance):
    """Depth and distance [B, H, W], each from the pixel of the row, up to the own one, that is nearest.

    A depth that is carried over n pixels is `distance` + n away. So the nearest one at each pixel has the least distance
    - column of those so far; of equal ones, the last counts.
    """
    size = z.shape[2]
    columns = torch.arange(size, device=z.device, dtype=torch.int32)
    least = torch.cummin((distance - columns) * size + (size - 1 - columns), 2).values
    source = size - 1 - least % size
    return z.gather(2, source.long()), distance.gather(2, source.long()) + columns - source


def smoothed(z):
    """Bilaterally smoothed depth [B, H, W]; metres."""
    height, width = z.shape[1:]
    padded = F.pad(z[:, None], (2, 2, 2, 2), mode="replicate")[:, 0]
    total, weights = torch.zeros_like(z), torch.zeros_like(z)
    for dy, dx in _NEIGHBOURS:
        near = padded[:, 2 + dy : 2 + dy + height, 2 + dx : 2 + dx + width]
        weight = ((near - z).square_().mul_(-200.0) - (dy * dy + dx * dx) / 8).exp_()
        total.addcmul_(weight, near)
        weights += weight
    return total / weights


def normals(z, intrinsics):
    """Unit normals [B, 3, H, W] from depth [B, H, W] in metres; images have at least 5 rows and columns."""
    fx, fy, cx, cy = intrinsics[:, :, None, None].unbind(1)
    x = (torch.arange(z.shape[2], device=z.device).view(1, 1, -1) - cx) / fx
    y = (torch.arange(z.shape[1], device=z.device).view(1, -1, 1) - cy) / fy
    points = torch.stack((z * x, z * y, z), 1)
    dx = F.pad(points[..., 4:] - points[..., :-4], (2, 2, 0, 0), mode="replicate")
    dy = F.pad(points[..., 4:, :] - points[..., :-4, :], (0, 0, 2, 2), mode="replicate")
    product = torch.linalg.cross(dx, dy, dim=1)
    normal = product / (product.square().sum(1, keepdim=True).sqrt() + 1e-9)
    return normal.where(normal.isfinite().all(1, keepdim=True), 0)
