"""Colours of scenes: one per object, textures and prints that stick to it, light and shade; [B, 3, H, W] in 0..255.

Ranges are those of `splatseg_training.colour`, far beyond natural ones, because a network overfits to colours.
"""

import torch
import torch.nn.functional as F

from .fields import blurred

ROOM_PALETTE = 4  # colours that many objects share in some rooms


def painted(hits, local, normal, cameras, count, draws):
    """Colours of a view of `hits`, with ids below `count`; `local` and `normal` from `cast.surfaces`."""
    batch, height, width = hits.z.shape
    table = torch.cat((_albedo(batch, count, draws), _textures(batch, count, draws), _prints(batch, count, draws)), 2)
    scene = torch.arange(batch, device=table.device)[:, None]
    own = table[scene, hits.id.flatten(1)]
    rgb, local = own[..., :3], local.flatten(1, 2)
    rgb = rgb * torch.exp(_pattern(own[..., 3:14], local)[..., None] * own[..., 14:17])
    rgb = torch.where(_printed(own[..., 17:25], local)[..., None], own[..., 25:28], rgb)
    rgb = rgb.mT.reshape(batch, 3, height, width)
    return (rgb * _light(hits.z, normal, cameras, draws)).clamp(0, 255)


def albedo_of_objects(draws, ids, count):
    """One brightness per object at its pixels [B, H, W], 0..255, for sensors that see scenes without colours."""
    values = draws.uniform(12, 240, len(ids), count)
    return values.gather(1, ids.flatten(1)).view(ids.shape)


def _albedo(batch, count, draws):
    """Colours of the objects [B, count, 3]; in some rooms, many objects share a few of them."""
    tint = 1 + 0.9 * draws.uniform(0, 1, batch, 1, 1) ** 2 * draws.uniform(-1, 1, batch, count, 3)
    colours = (draws.uniform(12, 240, batch, count, 1) * tint).clamp(5, 255)
    shared = draws.chance(draws.uniform(-0.5, 0.6, batch, 1), batch, count)
    palette = draws.integers(0, ROOM_PALETTE, batch, count, 1).expand(-1, -1, 3)
    return torch.where(shared[..., None], colours.gather(1, palette), colours)


def _calm(batch, draws):
    """1, or less in half of the scenes, in which most things have one colour and colour is reliable; [B, 1]."""
    return torch.where(draws.chance(0.5, batch, 1), 1.0, 0.2)


def _textures(batch, count, draws):
    """Textures [B, count, 14]: two wave vectors (6) and phases (2), weights of smooth, edged and checked patterns (3),
    and the change of the logarithm of red, green and blue (3)."""
    direction = draws.normal(2, batch, count, 3)
    direction = direction / direction.norm(dim=-1, keepdim=True).clamp(min=1e-6)
    direction = direction * (2 * torch.pi / draws.log_uniform(0.012, 0.5, 2, batch, count, 1))
    kind = F.one_hot(draws.integers(0, 3, batch, count), 3)
    used = draws.chance(draws.uniform(0.0, 0.8, batch, 1) * _calm(batch, draws), batch, count)
    strength = (draws.uniform(-1, 1, batch, count) * used)[..., None] * draws.uniform(-0.4, 1.2, batch, count, 3)
    phase = draws.uniform(0, 2 * torch.pi, batch, count, 2)
    return torch.cat((direction[0], direction[1], phase, kind, strength), 2)


def _pattern(texture, local):
    """Patterns [B, N] in about -1..1 at points [B, N, 3], given `_textures` without the last three [B, N, 11]."""
    a = torch.sin((local * texture[..., :3]).sum(-1) + texture[..., 6])
    b = torch.sin((local * texture[..., 3:6]).sum(-1) + texture[..., 7] + 1.5 * a)
    smooth, edged, checked = 0.6 * (a + b), b.sign(), (a * b).sign()
    return (torch.stack((smooth, edged, checked), -1) * texture[..., 8:11]).sum(-1)


def _prints(batch, count, draws):
    """Rectangles of another colour on objects, like labels [B, count, 11]: two axes (6), half sizes in metres (2), 0
    where there is none, and the colour (3)."""
    axis = draws.integers(0, 3, batch, count)
    other = (axis + draws.integers(1, 3, batch, count)) % 3
    half = draws.log_uniform(0.01, 0.3, batch, count, 2)
    half = half * draws.chance(0.35 * _calm(batch, draws), batch, count)[..., None]
    return torch.cat((F.one_hot(axis, 3), F.one_hot(other, 3), half, draws.uniform(5, 250, batch, count, 3)), 2)


def _printed(prints, local):
    """The points [B, N] inside their objects' prints [B, N, 8]."""
    a, b = (local * prints[..., :3]).sum(-1).abs(), (local * prints[..., 3:6]).sum(-1).abs()
    return (a < prints[..., 6]) & (b < prints[..., 7])


def _light(z, normal, cameras, draws):
    """Brightness [B, 3 or 1, H, W]: ambient light, a far and a near lamp, dark corners, edges of cast shadows."""
    batch, height, width = z.shape
    x, y = cameras.rays(height, width)
    point = torch.stack((z * x, z * y, z), -1)
    ambient = draws.uniform(0.4, 1.0, batch, 1, 1)
    far = F.normalize(draws.normal(batch, 1, 1, 3), dim=3)
    light = 0.5 + 0.5 * (normal * far).sum(-1)
    near = draws.normal(batch, 1, 1, 3) * 1.5 - point
    distance = near.norm(dim=-1).clamp(min=0.1)
    lamp = ((normal * near).sum(-1) / distance).clamp(min=0) / (1 + (distance / 2).square())
    light = light * _shadows(point, draws) + draws.uniform(-1, 1.5, batch, 1, 1).clamp(min=0) * lamp
    light = (ambient + (1 - ambient) * light) * _corners(z, draws)
    tint = 1 + draws.uniform(-0.15, 0.15, batch, 3, 1, 1)
    return light[:, None] * tint


def _shadows(point, draws):
    """Stripes of shade [B, H, W] across all objects, as behind bars and frames of windows; in a third of the scenes."""
    batch = len(point)
    waves = draws.normal(batch, 1, 1, 3) * draws.uniform(0.5, 3, batch, 1, 1, 1)
    waves = torch.sin((point * waves).sum(-1) + draws.uniform(0, 7, batch, 1, 1))
    waves = waves + draws.uniform(-0.8, 0.8, batch, 1, 1)
    sharp = draws.log_uniform(1, 100, batch, 1, 1)
    strength = draws.uniform(0, 0.9, batch, 1, 1) * draws.chance(0.35, batch, 1, 1)
    return 1 - strength * torch.sigmoid(sharp * waves)


def _corners(z, draws):
    """Darkening [B, H, W] of what is behind its surroundings, like corners and gaps: less light gets there."""
    small = F.avg_pool2d(z[:, None], 4)[:, 0]
    deviation = draws.uniform(1, 5, len(z))
    behind = (small - blurred(small, deviation, 5.0)) / small.clamp(min=0.1)
    shade = draws.uniform(0, 6, len(z), 1, 1) * behind.clamp(0, 0.1)
    return 1 - F.interpolate(shade[:, None], z.shape[1:], mode="bilinear")[:, 0].clamp(0, 0.7)
