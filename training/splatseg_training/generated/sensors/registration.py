"""Depth that does not lie on the colours; as `splatseg_training.sensors.registration`, whose parameters it has."""

import torch

from . import losses
from .view import FAR, is_jump, nearest_and_farthest, rays, some


def apply(z, views, errors, draws):
    """Measured depth [B, H, W] as registered to the colours, for B of `Registration`; 0 where nothing came."""
    if chosen := some(draws, [any(error.shift) or error.scale != 1 for error in errors]):
        z = z.clone()
        z[chosen[1]] = shifted(z[chosen[1]], [errors[number] for number in chosen[0]], draws)
    gaps = losses.outside(z.shape, [error.border for error in errors], draws)
    if chosen := some(draws, [error.baseline != 0 or max(error.pitch) > 1 or error.random > 0 for error in errors]):
        gaps[chosen[1]] |= _gaps(z[chosen[1]], views.take(chosen[1]), [errors[number] for number in chosen[0]], draws)
    return z.masked_fill(gaps, 0)


def _gaps(z, views, errors, draws):
    """Shadows, single pixels and rows that a warp leaves empty, [B, H, W]."""
    baseline = draws.tensor([error.baseline for error in errors])[:, None, None]
    gaps = losses.shadow(z, views.intrinsics[:, 0, None, None], baseline)
    gaps |= draws.chance(draws.tensor([error.random for error in errors])[:, None, None], *z.shape)
    return gaps | unfilled(z, views, errors, draws)


def shifted(z, errors, draws):
    """Depth moved to the right and down and scaled about the centre, by the nearest pixel."""
    height, width = z.shape[1:]
    shift = draws.tensor([error.shift for error in errors])[:, :, None, None]
    scale = draws.tensor([error.scale for error in errors])[:, None, None]
    columns = (torch.arange(width, device=z.device).view(1, 1, -1) - (width - 1) / 2 - shift[:, 0]) / scale
    rows = (torch.arange(height, device=z.device).view(1, -1, 1) - (height - 1) / 2 - shift[:, 1]) / scale
    return _picked(z, rows + (height - 1) / 2, columns + (width - 1) / 2)


def _picked(z, rows, columns):
    """Depth at the nearest pixels to rows and columns that broadcast to [B, H, W]; 0 outside."""
    height, width = z.shape[1:]
    rows, columns = torch.broadcast_tensors(rows.round().long(), columns.round().long())
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    index = rows.clamp(0, height - 1) * width + columns.clamp(0, width - 1)
    return z.flatten(1).gather(1, index.flatten(1)).view(z.shape).where(inside, 0)


def seen_late(views, errors, draws):
    """The views with the depth from where the depth camera was."""
    if not (chosen := some(draws, [any(error.rotation) or any(error.translation) for error in errors])):
        return views
    z = views.z.clone()
    z[chosen[1]] = late(views.take(chosen[1]), [errors[number] for number in chosen[0]], draws)
    return views._replace(z=z)


def late(views, errors, draws):
    """The depth [B, H, W] that earlier cameras see, found as in `splatseg_training.sensors.registration.late`."""
    z = views.z
    motion = _Motion(views, errors, draws)
    depth = z
    for _ in range(2):
        found = motion.source(z, depth)
        depth = torch.where(is_jump(found, depth), depth, found)
    near, _ = nearest_and_farthest(z, 9)
    found = motion.source(z, near)
    hiding = (found > 0) & ~is_jump(near, found) & is_jump(found, depth.where(depth > 0, FAR))
    depth = torch.where(hiding, found, depth)
    return torch.where(depth > 0, motion.moved(depth)[2].clamp(min=0.05), 0)


class _Motion:
    """The motions of cameras between two frames; they take points to the later coordinates."""

    def __init__(self, views, errors, draws):
        self.intrinsics = views.intrinsics[:, :, None, None].unbind(1)
        self.u, self.v = rays(views)
        fx, fy, _, _ = self.intrinsics
        rotation = _rotations(draws.tensor([error.rotation for error in errors]))[:, :, :, None, None]
        x, y = self.u / fx, self.v / fy
        self.directions = [rotation[:, i, 0] * x + rotation[:, i, 1] * y + rotation[:, i, 2] for i in range(3)]
        self.translation = draws.tensor([error.translation for error in errors])[:, :, None, None].unbind(1)

    def moved(self, depth):
        """The points' coordinates after the motion."""
        return [depth * direction + step for direction, step in zip(self.directions, self.translation)]

    def source(self, z, depth):
        """The depth in `z` from where a surface at `depth` moves to each pixel; 0 outside."""
        fx, fy, cx, cy = self.intrinsics
        x, y, forward = self.moved(depth)
        scale = 1 / forward.clamp(min=0.05)
        return _picked(z, 2 * self.v + cy - fy * y * scale, 2 * self.u + cx - fx * x * scale)


def _rotations(vectors):
    """Rotation matrices [B, 3, 3] for rotation vectors [B, 3] in radians."""
    x, y, z = vectors.unbind(1)
    zero = torch.zeros_like(x)
    return torch.matrix_exp(torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), 1).view(-1, 3, 3))


def unfilled(z, views, errors, draws):
    """The pixels [B, H, W] that no point hits, if a tilted and bent grid of points is warped."""
    u, v = rays(views)
    across, down = (1 / draws.tensor([error.pitch for error in errors])[:, :, None, None]).unbind(1)
    tilt, baseline = draws.tensor([(error.tilt, error.baseline) for error in errors])[:, :, None, None].unbind(1)
    columns = u + views.intrinsics[:, 0, None, None] * baseline / z.clamp(min=0.2) + tilt * v
    rows = v - tilt * u + tilt / 400 * u.square()
    return (columns * across % 1 >= across) | (rows * down % 1 >= down)
