"""Where the pieces of a room stand: against walls, side by side or free, without overlaps."""

from typing import NamedTuple

import torch

CANDIDATES = 16  # places tried for a piece
TURN = torch.pi / 2
TOUCH = 5e-4  # metres by which boxes that touch may overlap


class Layout(NamedTuple):
    """Places of the pieces of a batch of rooms."""

    offset: torch.Tensor  # [B, S, 3] metres
    yaw: torch.Tensor  # [B, S] radians
    exists: torch.Tensor  # [B, S] bool; False where no candidate was free
    low: torch.Tensor  # [B, S, 3] boxes around the pieces, metres
    high: torch.Tensor  # [B, S, 3]


class _Candidates(NamedTuple):
    """Random places for the pieces, [B, S, CANDIDATES]."""

    wall: torch.Tensor  # 0 to 3: +y, -x, -y, +x
    along: torch.Tensor  # -1..1, place along the wall or across the room
    across: torch.Tensor  # -1..1, place in the other direction, for free pieces
    gap: torch.Tensor  # metres to the wall or the neighbour
    yaw: torch.Tensor  # radians, for free pieces


def arranged(pieces, wanted, room, draws):
    """`Layout` of pieces [B, S], placed one after the other; those not `wanted` [B, S] are left out.

    `room` [B, 2] are the half sizes of the floor.
    """
    shape = wanted.shape
    tried = _candidates(draws, (*shape, CANDIDATES))
    beside = draws.chance(0.5, *shape)
    layout = Layout(*(torch.zeros(*shape, *size, device=room.device) for size in ((3,), (), (), (3,), (3,))))
    layout = layout._replace(exists=layout.exists.bool())
    end = torch.zeros(shape[0], 2, device=room.device)  # wall, and how far along it the last piece reaches
    row = torch.arange(shape[0], device=room.device)
    for slot in range(shape[1]):
        half, by_wall = pieces.half[:, slot], pieces.by_wall[:, slot, None]
        here = _Candidates(*(values[:, slot] for values in tried))
        offset, yaw, wall, along = _places(here, half, by_wall, room, end, beside[:, slot])
        low, high = _boxes(offset, yaw, half, pieces.low[:, slot], pieces.high[:, slot])
        free = _inside(low, high, room) & ~_overlaps(low, high, layout)
        best = free.int().argmax(1)
        exists = free[row, best] & wanted[:, slot]
        layout.offset[:, slot, :2] = offset[row, best]
        layout.yaw[:, slot] = yaw[row, best]
        layout.exists[:, slot] = exists
        layout.low[:, slot] = low[row, best]
        layout.high[:, slot] = high[row, best]
        reached = torch.stack((wall[row, best].float(), along[row, best] + half[:, 0]), 1)
        end = torch.where((exists & by_wall[:, 0])[:, None], reached, end)
    return layout


def _candidates(draws, shape):
    touching = draws.chance(0.6, *shape)
    right = draws.integers(0, 4, *shape) * TURN
    return _Candidates(
        wall=draws.integers(0, 4, *shape),
        along=draws.uniform(-1, 1, *shape),
        across=draws.uniform(-1, 1, *shape),
        gap=torch.where(touching, 0.0, draws.uniform(0, 0.08, *shape)),
        yaw=torch.where(draws.chance(0.5, *shape), right, draws.uniform(0, 4 * TURN, *shape)),
    )


def _places(tried, half, by_wall, room, end, beside):
    """Offsets [B, C, 2] and yaws [B, C] of the candidates, and their wall and place along it.

    The first candidate of a piece at a wall is beside the last one, if `beside` [B].
    """
    first = torch.arange(CANDIDATES, device=room.device) == 0
    next_to = first & beside[:, None]
    wall = torch.where(next_to, end[:, :1].long(), tried.wall)
    sideways = wall % 2 == 1
    length = torch.where(sideways, room[:, 1:], room[:, :1])
    distance = torch.where(sideways, room[:, :1], room[:, 1:]) - half[:, 1:] - tried.gap
    along = torch.where(next_to, end[:, 1:] + half[:, :1] + 0.1 * tried.gap, tried.along * (length - half[:, :1]))
    yaw = torch.where(by_wall, wall * TURN, tried.yaw)
    c, s = yaw.cos(), yaw.sin()
    at_wall = torch.stack((c * along - s * distance, s * along + c * distance), -1)
    free = torch.stack((tried.along * room[:, :1], tried.across * room[:, 1:]), -1)
    return torch.where(by_wall[..., None], at_wall, free), yaw, wall, along


def _boxes(offset, yaw, half, low, high):
    """Least and greatest corners [B, C, 3] of the boxes around the candidates."""
    c, s = yaw.cos().abs(), yaw.sin().abs()
    extent = torch.stack((c * half[:, :1] + s * half[:, 1:], s * half[:, :1] + c * half[:, 1:]), -1)
    low, high = (height[:, None, None].expand(*yaw.shape, 1) for height in (low, high))
    return torch.cat((offset - extent, low), -1), torch.cat((offset + extent, high), -1)


def _inside(low, high, room):
    """Whether boxes are inside the room, [B, C]."""
    return ((low[..., :2] > -room[:, None] - TOUCH) & (high[..., :2] < room[:, None] + TOUCH)).all(-1)


def _overlaps(low, high, layout):
    """Whether boxes overlap pieces that were placed, [B, C]."""
    apart = (low[:, :, None] > layout.high[:, None] - TOUCH) | (high[:, :, None] < layout.low[:, None] + TOUCH)
    return (~apart.any(-1) & layout.exists[:, None]).any(-1)
