"""Trains the affinity network: `python -m splatseg_training.train --data 'ROOMS/*' --out RUN --steps 10000`.

RUN gets `checkpoint.pt`, from which the same command resumes, `weights.pt` (the averaged weights, which `export` and
`evaluate` read), `losses.csv` and `losses.png`. With the same data, seed and steps, an interrupted run gives the same
losses as an uninterrupted one. Real labelled folders can be evaluated at the end: `--validate FOLDER...`.
"""

import argparse

import torch

from . import affinities
from .augment import Settings, sample
from .dataset import read_groups
from .evaluate import report
from .loader import Samples, batches
from .network import WIDTHS, AffinityNet, load
from .optimiser import optimisers
from .run import TrainingRun, add_options

MEASURED_HELP = "labelled folders of a real camera: half of the samples, without sensor model and recolouring"


def main(arguments=None):
    options = parse(arguments)
    run = Run(options, read_groups(options.data), read_groups(options.measured))
    run.train()
    if options.validate:
        report(run.average.cpu(), options.validate)


def parse(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser, batch=8)
    add = parser.add_argument
    add("--measured", nargs="+", default=[], metavar="PATTERN", help=MEASURED_HELP)
    add("--freeze-norms", action="store_true", help="freeze the statistics of batch norms; for fine-tuning")
    add("--widths", type=int, nargs=5, default=WIDTHS, help="channels of the five resolutions")
    add("--area-power", type=float, default=0.5, help="an object's weight is its area to minus this power")
    add("--contact-weight", type=float, default=2.0, help="weight of borders between objects that touch")
    for name, default in Settings._field_defaults.items():
        add("--" + name.replace("_", "-"), type=type(default), default=default, help="see augment.Settings")
    options = parser.parse_args(arguments)
    if options.start and options.start.endswith(".safetensors") and not options.freeze_norms:
        parser.error("the batch norms of a .safetensors are folded: add --freeze-norms")
    return options


class Run(TrainingRun):
    """A run of the affinity network."""

    def __init__(self, options, groups, measured=()):
        self.groups, self.measured = groups, measured
        super().__init__(options, {"widths": tuple(options.widths)})

    def build(self):
        return AffinityNet(tuple(self.options.widths)), optimisers

    def start_from(self, path):
        self.net.load_state_dict(load(path).state_dict())

    def prepare(self):
        if self.options.freeze_norms:
            for module in self.net.modules():
                if isinstance(module, torch.nn.BatchNorm2d):
                    module.eval()

    def batches(self):
        options = self.options
        settings = Settings(**{name: getattr(options, name) for name in Settings._fields})
        samples = Samples(self.groups, sample, settings, options.seed, self.measured)
        return batches(samples, self.step, options.batch, options.workers)

    def loss(self, x, ids):
        """The loss of inputs [N, 8, h, w] float16 and ids [N, h/2, w/2] int32."""
        x = x.float().to(memory_format=torch.channels_last)
        with self.autocast():
            logits = self.net(x)
        inverse_depth = x[:, 3, ::2, ::2] + 0.5
        options = self.options
        return affinities.loss(logits, ids.long(), inverse_depth, options.area_power, options.contact_weight)


if __name__ == "__main__":
    main()
