"""Pieces: things built of a few parts, N at a time.

A piece stands on z = 0 with its back towards +y. All kinds are built for all N pieces and each piece takes one: on a GPU,
that is faster than sorting them.
"""

from typing import NamedTuple

import torch

from .parts import BOX, Parts, yawed

MEMBERS = 5  # objects of a piece, at most
SHELF = 8  # numbers of a shelf: x, y, z, yaw, half_x, half_y, clearance, exists


class Pieces(NamedTuple):
    """Pieces with any leading dimensions; metres."""

    parts: Parts  # [..., K]; ids are 1 to MEMBERS, 0 for missing parts
    shelves: torch.Tensor  # [..., K, SHELF], surfaces on which things can stand
    half: torch.Tensor  # [..., 2] half sizes of the footprint, whose centre is the origin
    low: torch.Tensor  # [...] height of the lowest point
    high: torch.Tensor  # [...] height of the highest point
    by_wall: torch.Tensor  # [...] whether it stands with its back to a wall

    def view(self, *shape):
        """The pieces [N, ...] with the dimension N split into this shape."""
        parts = Parts(*(tensor.unflatten(0, shape) for tensor in self.parts))
        return Pieces(parts, *(tensor.unflatten(0, shape) for tensor in self[1:]))


def random_pieces(kinds, draws, count):
    """`count` pieces of random kinds; `kinds` lists (function, share of the pieces, probability of `by_wall`)."""
    builders = [Builder(draws, count) for _ in kinds]
    for (kind, _, _), builder in zip(kinds, builders):
        kind(builder)
    slots = [max(len(getattr(builder, name)) for builder in builders) for name in ("parts", "shelves")]
    weights = draws.tensor([weight for _, weight, _ in kinds])
    chosen = torch.multinomial(weights, count, replacement=True, generator=draws.generator)
    index = torch.arange(count, device=draws.device)
    tables = zip(*(builder.tables(*slots) for builder in builders))
    parts, shelves = (torch.stack(table)[chosen, index] for table in tables)
    walled = draws.tensor([probability for _, _, probability in kinds])[chosen]
    return _centred(parts, shelves, draws.chance(walled, count))


def _centred(table, shelves, by_wall):
    """`Pieces` from a builder's tables, moved so that the centre of the footprint is the origin."""
    id = torch.where(table[..., 7] > 0, table[..., 9].long() + 1, 0)
    parts = Parts(table[..., 8].long(), table[..., :3], table[..., 4:7].clamp(min=5e-4), yawed(table[..., 3]), id)
    low, high = bounds(parts)
    middle = (low + high) / 2
    middle[:, 2] = 0
    parts = parts._replace(centre=parts.centre - middle[:, None])
    shelves = torch.cat((shelves[..., :3] - middle[:, None], shelves[..., 3:]), -1)
    return Pieces(parts, shelves, (high - low)[:, :2] / 2, low[:, 2], high[:, 2], by_wall)


def bounds(parts):
    """Least and greatest corner [..., 3] of the box around the existing parts [..., P]."""
    extent, missing = parts.extent(), (parts.id == 0)[..., None]
    low = (parts.centre - extent).masked_fill(missing, torch.inf).amin(-2)
    return low, (parts.centre + extent).masked_fill(missing, -torch.inf).amax(-2)


class Builder:
    """Collects the parts of N random pieces that are built alike.

    Sizes are numbers or tensors [N]. `place` moves the parts and shelves that are added after it. The sums are done for
    all parts together, in `tables`.
    """

    def __init__(self, draws, count):
        self.draws, self.count = draws, count
        self.parts, self.shelves = [], []
        self.place()

    def place(self, x=0.0, y=0.0, z=0.0, yaw=0.0, member=0):
        """Where the next parts stand. `member` numbers the objects of a piece, e.g. the chairs of a table."""
        self.origin, self.member = (x, y, z, yaw), member

    def uniform(self, low, high):
        return self.draws.uniform(low, high, self.count)

    def log_uniform(self, low, high):
        return self.draws.log_uniform(low, high, self.count)

    def chance(self, probability):
        return self.draws.chance(probability, self.count)

    def add(self, centre, half, exists=True, shape=BOX, yaw=0.0, member=None):
        """Adds a part. `yaw` turns it about its own centre."""
        member = self.member if member is None else member
        self.parts.append((*self.origin, *centre, yaw, *half, exists, shape, member))

    def shelf(self, z, half_x, half_y, clearance=3.0, exists=True, x=0.0, y=0.0):
        """Adds a horizontal surface on which things can stand, up to `clearance` high."""
        self.shelves.append((*self.origin, x, y, z, 0.0, half_x, half_y, clearance, exists))

    def tables(self, parts, shelves):
        """Tables of the parts [N, parts, 10] (place, yaw, half sizes, exists, shape, member) and of the shelves [N,
        shelves, SHELF], filled up with zeros."""
        return self._table(self.parts, parts, 14), self._table(self.shelves, shelves, 4 + SHELF)

    def _table(self, rows, slots, width):
        """Rows of numbers and tensors as one tensor, with each row's place applied to its next four numbers."""
        out = torch.zeros(self.count, slots, width, device=self.draws.device)
        if rows:
            values = [value for row in rows for value in row]
            numbers = [0.0 if isinstance(value, torch.Tensor) else float(value) for value in values]
            flat = out.view(self.count, -1)
            flat[:, : len(values)] = self.draws.tensor(numbers)
            where = [place for place, value in enumerate(values) if isinstance(value, torch.Tensor)]
            flat[:, self.draws.tensor(where, torch.int64)] = torch.stack([values[i].float() for i in where], 1)
        x, y, z, yaw = out[..., :4].unbind(-1)
        c, s = yaw.cos(), yaw.sin()
        own_x, own_y, own_z, own_yaw = out[..., 4:8].unbind(-1)
        moved = (x + c * own_x - s * own_y, y + s * own_x + c * own_y, z + own_z, yaw + own_yaw)
        return torch.cat((torch.stack(moved, -1), out[..., 8:]), -1)
