"""Where things lie: on surfaces, beside each other in rows, and on each other in piles."""

from typing import NamedTuple

import torch

from .parts import yawed

HIGHEST = 0.5  # metres, of a pile
OWN, BESIDE, UPON = 0, 1, 2  # a place of its own, beside the last thing, on top of it


class Surfaces(NamedTuple):
    """Horizontal rectangles in a batch of rooms, with room for things above."""

    centre: torch.Tensor  # [B, F, 3] metres
    yaw: torch.Tensor  # [B, F] radians
    half: torch.Tensor  # [B, F, 2] metres
    clearance: torch.Tensor  # [B, F] metres
    exists: torch.Tensor  # [B, F] bool


class Places(NamedTuple):
    """Places of things [B, T]."""

    offset: torch.Tensor  # [B, T, 3] metres
    yaw: torch.Tensor  # [B, T] radians
    exists: torch.Tensor  # [B, T] bool


def surfaces_of(pieces, layout):
    """The `Surfaces` [B, S × K] of pieces [B, S] that were placed."""
    x, y, z, yaw, half_x, half_y, clearance, exists = pieces.shelves.unbind(-1)
    rotation = yawed(layout.yaw)
    centre = torch.stack((x, y, z), -1) @ rotation.mT + layout.offset[:, :, None]
    exists = (exists > 0) & layout.exists[..., None]
    half = torch.stack((half_x, half_y), -1).clamp(min=0.01)
    values = (centre, yaw + layout.yaw[..., None], half, clearance, exists)
    return Surfaces(*(value.flatten(1, 2) for value in values))


def chosen_surfaces(surfaces, count, draws):
    """Surfaces [B, count] for things: few surfaces are full, most have little on them."""
    area = (surfaces.half[..., 0] * surfaces.half[..., 1]).sqrt()
    weight = area * torch.exp(1.5 * draws.normal(*area.shape)) * surfaces.exists
    weight[:, 0] = 0.4 * weight[:, 0] + 1e-6  # the floor; all things, if there is nothing else
    return torch.multinomial(weight, count, replacement=True, generator=draws.generator)


def placed(things, on, surfaces, wanted, draws):
    """`Places` of things [B, T] on the surfaces numbered `on` [B, T], placed one after the other.

    Each thing is lowered onto the surface or onto the highest thing below it; boxes around things stand for them.
    """
    batch, count = on.shape
    mode = torch.where(draws.chance(0.65, batch, count), BESIDE, UPON)
    mode = torch.where(draws.chance(0.45, batch, count), OWN, mode)
    spot = draws.uniform(-1, 1, batch, count, 2)
    shift = draws.normal(batch, count, 2) * 0.03
    gap = torch.where(draws.chance(0.5, batch, count), 0.001, draws.uniform(0.0, 0.04, batch, count))
    number, rows = on[:, 0], torch.arange(batch, device=on.device)
    centre = torch.zeros(batch, count, 2, device=spot.device)
    surface = torch.full((batch, count), -1, device=on.device)
    base, top = (torch.zeros(batch, count, device=spot.device) for _ in range(2))
    exists = torch.zeros(batch, count, dtype=torch.bool, device=on.device)
    for i in range(count):
        last = max(i - 1, 0)
        number = torch.where((mode[:, i] == OWN) | (i == 0), on[:, i], number)
        size, half = surfaces.half[rows, number], things.half[:, i]
        next_to = centre[:, last] + shift[:, i] * (mode[:, i] == UPON)[:, None]
        step = things.half[:, last, 0] + half[:, 0] + gap[:, i]
        next_to = torch.stack((next_to[:, 0] + step * (mode[:, i] == BESIDE), next_to[:, 1]), 1)
        at = torch.where((mode[:, i] == OWN)[:, None] | (i == 0), spot[:, i] * (size - half).clamp(min=0), next_to)
        apart = ((at[:, None] - centre).abs() >= half[:, None] + things.half).any(2)
        below = ~apart & exists & (surface == number[:, None])
        floor = surfaces.centre[rows, number, 2]
        base[:, i] = torch.maximum(floor, top.masked_fill(~below, -torch.inf).amax(1))
        top[:, i] = base[:, i] + things.high[:, i]
        low_enough = top[:, i] < floor + surfaces.clearance[rows, number]
        on_it = (at.abs() <= size + 0.3 * half).all(1) & (base[:, i] - floor < HIGHEST)
        exists[:, i] = low_enough & on_it & surfaces.exists[rows, number] & wanted[:, i]
        centre[:, i], surface[:, i] = at, number
    yaw = surfaces.yaw.gather(1, surface)
    flat = torch.cat((centre, torch.zeros_like(centre[..., :1])), 2)
    offset = (yawed(yaw) @ flat[..., None])[..., 0] + surfaces.centre.gather(1, surface[..., None].expand(-1, -1, 3))
    return Places(torch.cat((offset[..., :2], base[..., None]), 2), yaw, exists)
