"""Batches of training samples, generated on the device. The batch of a step depends only on seed, step and settings."""

from typing import NamedTuple

import numpy as np
import torch

from . import sensors
from .cast import Hits, cast, surfaces
from .colours import albedo_of_objects, painted
from .draws import Draws
from .inputs import inputs
from .photograph import photographed
from .scenes import IDS, random_scenes

CHUNK = 256  # scenes rendered at a time, which bounds the memory


class Samples(NamedTuple):
    """Samples before they become the network's input."""

    rgb: torch.Tensor  # [B, 3, H, W] in 0..255; 0 where colour is left out
    exact: torch.Tensor  # [B, H, W] metres
    z: torch.Tensor  # [B, H, W] metres as measured, 0 = missing
    ids: torch.Tensor  # [B, H, W] int64
    intrinsics: torch.Tensor  # [B, 4]: fx, fy, cx, cy in pixels
    has_colour: list  # B booleans
    has_depth: list  # B booleans


def batch(seed, step, count, settings, device="cpu"):
    """Network input [count, 8, h, w] float16 and the ids of every second pixel [count, h/2, w/2] int32.

    `settings` is an `augment.Settings`.
    """
    x, ids = zip(*(_finished(group, turns) for group, turns in groups(seed, step, count, settings, device)))
    return torch.cat(x), torch.cat(ids)


def groups(seed, step, count, settings, device="cpu"):
    """The batch's `Samples` before quarter turns, and the turns of each, in groups of images of one shape."""
    draws = Draws(seed, step, 0, device)
    share = settings.turn * np.array([-1, 0.45, 0.1, 0.45]) + (1, 0, 0, 0)
    turns = draws.rng.choice(4, count, p=share)
    upright = turns % 2 == 1
    shapes = np.array([(settings.height, settings.width), (settings.width, settings.height)])[upright.astype(int)]
    # The rooms are built together, because that takes thousands of small steps.
    scenes = random_scenes(draws, shapes)
    chosen = [np.flatnonzero(side) for side in (~upright, upright)]
    chunks = [part[i : i + CHUNK] for part in chosen for i in range(0, len(part), CHUNK)]
    for number, chunk in enumerate(chunks, 1):
        height, width = shapes[chunk[0]]
        part = scenes.take(draws.tensor(chunk, torch.int64))
        yield samples(part, Draws(seed, step, number, device), int(height), int(width), settings), turns[chunk]


@torch.no_grad()
def samples(scenes, draws, height, width, settings):
    """`Samples` of random scenes whose cameras have images of this size."""
    count = len(scenes.parts.id)
    hits = cast(scenes.parts, scenes.cameras, height, width, scenes.room)
    choice = draws.rng.random(count)
    coloured = choice >= settings.no_colour
    rgb, brightness = _colours(scenes, hits, coloured, draws)
    # The same room at another scale; it does not change the normals.
    exact = hits.z * torch.exp(draws.uniform(-0.3, 0.2, count))[:, None, None]
    mirrored = draws.chance(0.5, count)
    rgb, exact, ids, brightness = (_mirrored(image, mirrored) for image in (rgb, exact, hits.id, brightness))
    fx, fy, cx, cy = scenes.cameras.intrinsics.unbind(1)
    intrinsics = torch.stack((fx, fy, torch.where(mirrored, width - 1 - cx, cx), cy), 1)
    views = sensors.Views(exact, brightness, draws.tensor(coloured, torch.bool), ids, intrinsics, IDS)
    z = sensors.measure(views, draws, settings.sensor)
    has_depth = ~coloured | (choice >= settings.no_colour + settings.no_depth)
    return Samples(rgb, exact, z, ids, intrinsics, coloured.tolist(), has_depth.tolist())


def _colours(scenes, hits, coloured, draws):
    """Photographs [B, 3, H, W] of the coloured scenes, 0 for the others, and the brightness [B, H, W] that depth
    sensors see."""
    brightness = albedo_of_objects(draws, hits.id, IDS)
    rgb = torch.zeros(len(coloured), 3, *hits.z.shape[1:], device=draws.device)
    if coloured.any():
        index = draws.tensor(np.flatnonzero(coloured), torch.int64)
        scenes, hits = scenes.take(index), Hits(*(values[index] for values in hits))
        local, normal = surfaces(hits, scenes.parts, scenes.cameras)
        colours = painted(hits, local, normal, scenes.cameras, IDS, draws)
        brightness[index] = colours.mean(1)
        rgb[index] = photographed(colours, draws)
    return rgb, brightness


def _mirrored(images, chosen):
    """Images [B, ..., W] with the chosen ones mirrored."""
    return torch.where(chosen.view(-1, *[1] * (images.dim() - 1)), images.flip(-1), images)


def _finished(group, turns):
    """Inputs and ids of a group of samples after their quarter turns."""
    rgb, z, ids, intrinsics = turned(group, turns)
    x = inputs(rgb, z, intrinsics)
    x[:, :3] *= _flags(group.has_colour, x)
    x[:, 3:] *= _flags(group.has_depth, x)
    return x.half(), ids[:, ::2, ::2].int()


def _flags(values, like):
    return like.new_tensor(values)[:, None, None, None]


def turned(group, turns):
    """Colours, depth, ids and intrinsics of `Samples` after counterclockwise quarter turns, B numbers of the host.

    The turns of a group are all even or all odd, so that the images keep one shape.
    """
    first = int(turns[0]) % 2
    again = torch.from_numpy(turns >= 2).to(group.z.device)
    images = [torch.rot90(image, first, (-2, -1)) for image in (group.rgb, group.z, group.ids)]
    images = [torch.where(again.view(-1, *[1] * (image.dim() - 1)), image.flip(-2, -1), image) for image in images]
    fx, fy, cx, cy = group.intrinsics.unbind(1)
    if first:
        fx, fy, cx, cy = fy, fx, cy, group.z.shape[2] - 1 - cx
    height, width = images[1].shape[1:]
    cx, cy = torch.where(again, width - 1 - cx, cx), torch.where(again, height - 1 - cy, cy)
    return *images, torch.stack((fx, fy, cx, cy), 1)
