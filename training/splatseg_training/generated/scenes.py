"""Random rooms: size, furniture, fixtures, things and cameras, for a batch of scenes at once."""

from typing import NamedTuple

import torch

from . import fixtures, furniture
from .cast import FACES, Cameras
from .layout import Layout, arranged
from .parts import Parts, joined, yawed
from .pieces import MEMBERS, Pieces, random_pieces
from .piles import Surfaces, chosen_surfaces, placed, surfaces_of
from .things import random_things
from .views import Furnished, views

OPENINGS, FURNITURE, FIXTURES, THINGS = 2, 12, 10, 60  # of a room, at most
FLAT = 0.03  # metres, height of papers and rugs
IDS = 1 + FACES + (OPENINGS + FURNITURE + FIXTURES) * MEMBERS + THINGS


class Scenes(NamedTuple):
    """A batch of rooms with cameras. World: z up, floor at 0; metres."""

    parts: Parts  # [B, P], in the world; ids from FACES + 1 and below IDS
    room: tuple  # least and greatest corner, each [B, 3]
    cameras: Cameras

    def take(self, index):
        """The scenes with these numbers [N]."""
        parts, cameras = (type(values)(*(value[index] for value in values)) for values in (self.parts, self.cameras))
        return Scenes(parts, tuple(corner[index] for corner in self.room), cameras)


def random_scenes(draws, sizes):
    """A scene for each of the images of `sizes`, host numbers [B, 2]: height and width."""
    count = len(sizes)
    room, ceiling = _rooms(draws, count)
    groups = [_pieces(kinds, slots, draws, count) for kinds, slots in _GROUPS]
    pieces = _together(groups)
    layout = arranged(pieces, _wanted(draws, count), room, draws)
    parts = [_in_world(group, layout, slots) for group, slots in zip(groups, _slots())]
    surfaces = _surfaces(groups, layout, room)
    on = chosen_surfaces(surfaces, THINGS, draws)
    things = random_things(draws, count * THINGS).view(count, THINGS)
    things = _larger_on_the_floor(things, on, draws)
    many = draws.uniform(0, 1.3, count, 1)
    places = placed(things, on, surfaces, draws.uniform(0, 1, count, THINGS) < many, draws)
    places = places._replace(exists=places.exists & ~_in_furniture(things, places, on, layout, pieces))
    parts.append(_things(things, places))
    furnished = Furnished(room, ceiling, layout, surfaces, on, places)
    cameras = views(furnished, draws.tensor(sizes), draws)
    zero = torch.zeros(count, 1, device=room.device)
    corners = (torch.cat((-room, zero), 1), torch.cat((room, ceiling[:, None]), 1))
    return Scenes(joined(parts), corners, cameras)


_GROUPS = ((fixtures.OPENINGS, OPENINGS), (furniture.KINDS, FURNITURE), (fixtures.KINDS, FIXTURES))


def _slots():
    """The slices of the layout that belong to each group of pieces."""
    start = 0
    for _, count in _GROUPS:
        yield slice(start, start + count)
        start += count


def _rooms(draws, count):
    """Half sizes [B, 2] of the floors and heights [B]; an eighth are corridors."""
    room = draws.log_uniform(1.1, 3.8, count, 2)
    side = draws.integers(0, 2, count)[:, None] == torch.arange(2, device=room.device)
    narrow = draws.chance(0.12, count)[:, None] & side
    return torch.where(narrow, draws.uniform(0.55, 0.9, count, 2), room), draws.uniform(2.25, 3.2, count)


def _pieces(kinds, slots, draws, count):
    return random_pieces(kinds, draws, count * slots).view(count, slots)


def _together(groups):
    """The sizes of all pieces, for placing them; parts and shelves stay with the groups."""
    half, low, high, by_wall = (torch.cat(values, 1) for values in zip(*(group[2:] for group in groups)))
    return Pieces(None, None, half, low, high, by_wall)


def _wanted(draws, count):
    """Which of the pieces [B, S] a room has; some rooms are nearly empty."""
    shares = [draws.uniform(low, high, count, 1) for low, high in ((0.3, 1), (0.1, 1.8), (0, 1.3))]
    return torch.cat([draws.uniform(0, 1, count, slots) < share for share, (_, slots) in zip(shares, _GROUPS)], 1)


def _in_world(pieces, layout, slots):
    """The parts [B, S × K] of a group of pieces at their places, with ids of their own."""
    parts = pieces.parts.moved(yawed(layout.yaw[:, slots]), layout.offset[:, slots])
    number = torch.arange(slots.start, slots.stop, device=parts.id.device)[:, None]
    exists = (parts.id > 0) & layout.exists[:, slots, None]
    return _flat(parts._replace(id=torch.where(exists, FACES + number * MEMBERS + parts.id, 0)))


def _flat(parts):
    return Parts(*(tensor.flatten(1, 2) for tensor in parts))


def _surfaces(groups, layout, room):
    """All `Surfaces` of a room; the first one is the floor."""
    count, device = len(room), room.device
    size = room.clamp(max=2.0) - 0.1
    ones = torch.ones(count, 1, device=device)
    found = [Surfaces(torch.zeros(count, 1, 3, device=device), 0 * ones, size[:, None], 3 * ones, ones > 0)]
    for group, slots in zip(groups, _slots()):
        found.append(surfaces_of(group, Layout(*(values[:, slots] for values in layout))))
    return Surfaces(*(torch.cat(values, 1) for values in zip(*found)))


def _larger_on_the_floor(things, on, draws):
    """Things [B, T] on the floor, the surface 0, are larger: bags, boxes and, of the flat ones, rugs."""
    most = torch.where(things.high < FLAT, 7.0, 2.5)
    scale = torch.where(on == 0, 1 + (most - 1) * draws.uniform(0, 1, *on.shape), 1.0)
    upwards = torch.where(things.high < FLAT, 1.0, scale)
    parts = things.parts
    wide = torch.stack((scale, scale, upwards), -1)[:, :, None]
    # The axes of flat things are vertical or horizontal, so that their parts can be enlarged along their own axes.
    along = (parts.axes.abs() * wide[..., None]).sum(-2) / parts.axes.abs().sum(-2)
    parts = parts._replace(centre=parts.centre * wide, half=parts.half * along)
    return things._replace(parts=parts, half=things.half * scale[..., None], high=things.high * upwards)


def _in_furniture(things, places, on, layout, pieces):
    """Which things [B, T] on the floor would stick in furniture at a wall; there is room under other furniture."""
    half = things.half.amax(2, keepdim=True)
    at = places.offset[..., :2]
    apart = (at + half)[:, :, None] < layout.low[:, None, :, :2]
    apart = apart | ((at - half)[:, :, None] > layout.high[:, None, :, :2])
    solid = layout.exists & pieces.by_wall & (layout.low[..., 2] < 0.05)
    return (~apart.any(-1) & solid[:, None]).any(-1) & (on == 0) & (things.high > FLAT)


def _things(things, places):
    """The parts [B, T × K] of things at their places, with one id each."""
    parts = things.parts.moved(yawed(places.yaw), places.offset)
    number = IDS - THINGS + torch.arange(THINGS, device=places.yaw.device)[:, None]
    exists = (parts.id > 0) & places.exists[..., None]
    return _flat(parts._replace(id=torch.where(exists, number, 0)))
