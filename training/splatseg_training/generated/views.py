"""Cameras in rooms: from standing, sitting and robots' heights, towards furniture, piled things or just anywhere."""

from typing import NamedTuple

import torch

from .cast import Cameras
from .layout import Layout
from .piles import Places, Surfaces

CANDIDATES = 24  # positions tried
CLEARANCE = 0.3  # metres between camera and furniture


class Furnished(NamedTuple):
    """Furnished rooms in which cameras are placed."""

    room: torch.Tensor  # [B, 2] half sizes of the floor, metres
    ceiling: torch.Tensor  # [B] metres
    layout: Layout
    surfaces: Surfaces
    on: torch.Tensor  # [B, T] int64, the surfaces of the things
    places: Places  # of the things


def views(rooms, sizes, draws):
    """`Cameras` of images of `sizes` [B, 2], height and width, in `Furnished` rooms."""
    room, number = rooms.room, torch.arange(len(rooms.room), device=rooms.room.device)
    target, close = _targets(rooms, draws)
    tried = _tried(target, close, rooms.ceiling, draws)
    worth = _seen(tried, target, rooms.layout, rooms.places) * draws.uniform(0.1, 1, len(room), 1)
    worth = worth + draws.uniform(0, 2, *tried.shape[:2])
    best = (worth - _obstructed(tried, room, rooms.layout)).argmax(1)
    position = tried[number, best]
    # Where all candidates are outside of a small room, the nearest point inside has to do.
    flat = torch.maximum(torch.minimum(position[:, :2], room - 0.1), 0.1 - room)
    position = torch.cat((flat, position[:, 2:]), 1)
    return Cameras(_looking(target - position, draws), position, _intrinsics(sizes, draws))


def _targets(rooms, draws):
    """Points [B, 3] to look at, and which of them are on full surfaces that are looked at from close."""
    room, layout, surfaces = rooms.room, rooms.layout, rooms.surfaces
    batch, device = len(room), room.device
    number = torch.arange(batch, device=device)
    busy = rooms.on[:, 0]  # the surface of a random thing is most likely a full one
    spread = draws.uniform(-0.7, 0.7, batch, 2) * surfaces.half[number, busy]
    surface = surfaces.centre[number, busy] + torch.cat((spread, draws.uniform(-0.05, 0.25, batch, 1)), 1)
    piece = torch.multinomial(layout.exists.float() + 1e-6, 1, generator=draws.generator)[:, 0]
    share = draws.uniform(0, 1, batch, 3)
    furniture = torch.lerp(layout.low[number, piece], layout.high[number, piece], share)
    low = torch.cat((-room, torch.zeros(batch, 1, device=device)), 1)
    anywhere = torch.lerp(low, torch.cat((room, rooms.ceiling[:, None]), 1), share)
    choice = draws.uniform(0, 1, batch)
    close = (choice < 0.55) & surfaces.exists[number, busy]
    other = torch.where(((choice < 0.88) & layout.exists.any(1))[:, None], furniture, anywhere)
    return torch.where(close[:, None], surface, other), close


def _tried(target, close, ceiling, draws):
    """Positions [B, CANDIDATES, 3], 0.45 to 5 m from the target."""
    shape, close = (len(target), CANDIDATES), close[:, None]
    away = torch.where(close, draws.log_uniform(0.45, 2.5, *shape), draws.log_uniform(1.0, 5.0, *shape))
    angle, rise = draws.uniform(0, 2 * torch.pi, *shape), draws.uniform(0.1, 1.0, *shape)
    above = (target[:, None, 2] + away * rise.sin()).clamp(max=2.0)
    z = torch.where(close, above, draws.uniform(0.3, 2.0, *shape))
    z = torch.minimum(z.clamp(min=0.3), ceiling[:, None] - 0.1)
    flat = torch.stack((angle.cos(), angle.sin()), -1) * (away * torch.where(close, rise.cos(), 1.0))[..., None]
    return torch.cat((target[:, None, :2] + flat, z[..., None]), -1)


def _seen(position, target, layout, places):
    """How many pieces and things [B, C] are roughly in view and 0.4 to 5 m away; things hide nothing here."""
    centres = torch.cat(((layout.low + layout.high) / 2, places.offset), 1)
    exists = torch.cat((layout.exists, places.exists), 1)
    towards = centres[:, None] - position[:, :, None]
    distance = towards.norm(dim=-1)
    forward = target[:, None] - position
    forward = forward / forward.norm(dim=-1, keepdim=True).clamp(min=1e-6)
    ahead = (towards * forward[:, :, None]).sum(-1) > 0.87 * distance
    return (ahead & exists[:, None] & (distance > 0.4) & (distance < 5)).sum(-1)


def _obstructed(position, room, layout):
    """A penalty [B, C] for positions outside of the room and close to or inside furniture."""
    inside = (position[..., :2].abs() < room[:, None] - 0.1).all(-1)
    outside = torch.maximum(layout.low[:, None] - position[:, :, None], position[:, :, None] - layout.high[:, None])
    distance = outside.amax(-1).masked_fill(~layout.exists[:, None], torch.inf).amin(2)
    return 1000.0 * ~inside + 1000.0 * (CLEARANCE - distance).clamp(0, 1)


def _looking(towards, draws):
    """Rotations [B, 3, 3] from camera to world that look in these directions [B, 3], with a little roll."""
    batch = len(towards)
    towards = towards + 0.02 * draws.normal(batch, 3)
    forward = towards / towards.norm(dim=1, keepdim=True).clamp(min=1e-6)
    right = torch.stack((forward[:, 1], -forward[:, 0], torch.zeros_like(forward[:, 0])), 1)
    right = right / right.norm(dim=1, keepdim=True).clamp(min=1e-6)
    down = torch.linalg.cross(forward, right)
    roll = (0.06 * draws.normal(batch))[:, None]
    axes = (right * roll.cos() + down * roll.sin(), down * roll.cos() - right * roll.sin(), forward)
    return torch.stack(axes, 2)


def _intrinsics(sizes, draws):
    """fx, fy, cx, cy [B, 4]: fields of view of 50 to 120° along the longer side, mostly up to 80°, and crops beside the
    centre."""
    batch, (height, width) = len(sizes), sizes.unbind(1)
    view = torch.deg2rad(50 + 70 * draws.uniform(0, 1, batch) ** 3)
    fx = sizes.amax(1) / 2 / torch.tan(view / 2)
    fy = fx * draws.uniform(0.97, 1.03, batch)
    centre = 0.5 + 0.12 * draws.normal(2, batch).clamp(-2, 2) * draws.chance(0.5, batch)
    return torch.stack((fx, fy, centre[0] * width - 0.5, centre[1] * height - 0.5), 1)
