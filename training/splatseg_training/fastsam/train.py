"""Trains FastSAM's network: `python -m splatseg_training.fastsam.train --data 'ROOMS/*' --out RUN --steps 5000`.

RUN gets `checkpoint.pt`, from which the same command resumes, `weights.pt` (the averaged weights, which `export` and
`evaluate` read), `losses.csv` and `losses.png`. With the same data, seed and steps, an interrupted run gives the same
losses as an uninterrupted one. Colours are synthesised for folders without them.
"""

import argparse
import math
from functools import partial

import torch

from ..dataset import read_groups
from ..loader import Samples, batches
from ..optimiser import optimisers
from ..run import TrainingRun, add_options
from .evaluate import report, view_size
from .losses import WEIGHTS, losses
from .network import OUTER, SIZES, STRIDES, FastSam, scaled
from .samples import Settings, sample


def main():
    options = parse()
    run = Run(options, groups(options))
    run.train()
    if options.validate:
        report(run.average, options.validate, options.image_size, options.min_pixels)


def parse(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, batch=16)
    add = parser.add_argument
    add("--size", choices=SIZES, default="n", help="size of the network")
    add("--image-size", type=int, default=320, help="longer side of the input in pixels, a multiple of 32")
    add("--only-coloured", action="store_true", help="skip views without colours instead of painting them")
    for name in ("recolour", "photograph", "smallest", "largest", "min_pixels"):
        default = Settings._field_defaults[name]
        add("--" + name.replace("_", "-"), type=type(default), default=default, help="see samples.Settings")
    options = parser.parse_args(arguments)
    if options.image_size % STRIDES[-1]:
        parser.error(f"--image-size must be a multiple of {STRIDES[-1]}")
    return options


def groups(options):
    """The views of each pattern of the data."""
    found = read_groups(options.data, view_size(options.image_size))
    if options.only_coloured:
        found = [[view for view in views if view.colour is not None] for views in found]
    for pattern, views in zip(options.data, found):
        if not views:
            raise ValueError(f"{pattern}: has no views with colours")
    return found


class Run(TrainingRun):
    """A run of FastSAM's network."""

    def __init__(self, options, groups):
        self.groups = groups
        self.recent_parts = torch.zeros(len(WEIGHTS))  # moving averages
        super().__init__(options, {"size": options.size})

    def build(self):
        return FastSam(scaled(*SIZES[self.options.size])), partial(optimisers, outer=OUTER)

    def batches(self):
        options = self.options
        # The input of a 4:3 image, with sides padded to multiples of the largest stride.
        width, height = view_size(options.image_size)
        values = {name: getattr(options, name) for name in Settings._fields if hasattr(options, name)}
        settings = Settings(height=math.ceil(height / STRIDES[-1]) * STRIDES[-1], width=width, **values)
        samples = Samples(self.groups, sample, settings, options.seed)
        return batches(samples, self.step, options.batch, options.workers)

    def loss(self, image, ids, truth):
        """The loss of images [N, 3, H, W] uint8, ids [N, H, W] uint8 and boxes [N, MAX_OBJECTS, 4]."""
        x = (image.float() / 255).to(memory_format=torch.channels_last)
        with self.autocast():
            output = self.net(x)
        parts = torch.stack(list(losses(output, ids, truth).values()))
        share = max(0.02, 1 / (1 + self.step))
        self.recent_parts.lerp_(parts.detach().cpu(), share)
        return parts.sum()

    def status(self):
        return "  ".join(f"{name} {part:.3f}" for name, part in zip(WEIGHTS, self.recent_parts))


if __name__ == "__main__":
    main()
