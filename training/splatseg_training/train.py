"""Trains the affinity network: `python -m splatseg_training.train --data 'ROOMS/*' --out RUN --steps 10000`.

RUN gets `checkpoint.pt`, from which the same command resumes, `weights.pt` (the averaged weights, which `export` and
`evaluate` read), `losses.csv` and `losses.png`. With the same data, seed and steps, an interrupted run gives the same
losses as an uninterrupted one. Real labelled folders can be evaluated at the end: `--validate FOLDER...`.
"""

import argparse

import torch

from . import affinities
from .augment import Settings, sample, sample_with_exact
from .dataset import read_groups
from .evaluate import report
from .loader import Samples, batches
from .network import WIDTHS, AffinityNet, load, restore_norms
from .optimiser import optimisers
from .run import TrainingRun, add_options

TEACHER_HELP = (
    "weights to agree with: what they say of a sample with exact depth, the network is to say with a sensor's"
)
NORM_BATCHES = 16  # from which the statistics of an exported file's batch norms are computed
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
    parser.add_argument("--measured", nargs="+", default=[], metavar="PATTERN", help=MEASURED_HELP)
    add_network_options(parser)
    add_settings(parser, Settings())
    return parser.parse_args(arguments)


def add_network_options(parser):
    """Adds the options of the network and its loss to an argument parser."""
    add = parser.add_argument
    add("--teacher", metavar="WEIGHTS", help=TEACHER_HELP)
    add("--teacher-weight", type=float, default=1.0, help="weight of agreeing with the teacher, against the labels' 1")
    add("--freeze-norms", action="store_true", help="freeze the statistics of batch norms; for fine-tuning")
    add("--widths", type=int, nargs=5, default=WIDTHS, help="channels of the five resolutions")
    add("--area-power", type=float, default=0.5, help="an object's weight is its area to minus this power")
    add("--contact-weight", type=float, default=2.0, help="weight of borders between objects that touch")


def add_settings(parser, defaults):
    """Adds the augmentation's settings, with these default values, to an argument parser."""
    for name, default in defaults._asdict().items():
        flag = "--" + name.replace("_", "-")
        parser.add_argument(flag, type=type(default), default=default, help="see augment.Settings")


def settings(options):
    """The augmentation's settings from parsed options."""
    return Settings(**{name: getattr(options, name) for name in Settings._fields})


class Run(TrainingRun):
    """A run of the affinity network."""

    def __init__(self, options, groups, measured=()):
        self.groups, self.measured = groups, measured
        self.teacher = load(options.teacher).to(memory_format=torch.channels_last) if options.teacher else None
        super().__init__(options, {"widths": tuple(options.widths)})

    def build(self):
        return AffinityNet(tuple(self.options.widths)), optimisers

    def start_from(self, path):
        self.net.load_state_dict(load(path).state_dict())
        if str(path).endswith(".safetensors") and not self.options.freeze_norms:
            batches = (x for (x, *_), _ in zip(self.batches(), range(NORM_BATCHES)))
            restore_norms(self.net, torch.cat([x.float() for x in batches]).to(self.device))

    def prepare(self):
        if self.options.freeze_norms:
            for module in self.net.modules():
                if isinstance(module, torch.nn.BatchNorm2d):
                    module.eval()

    def batches(self):
        options = self.options
        make = sample_with_exact if self.teacher else sample
        samples = Samples(self.groups, make, settings(options), options.seed, self.measured)
        return batches(samples, self.step, options.batch, options.workers)

    def loss(self, x, ids, exact=None):
        """The loss of inputs [N, 8, h, w] float16 and ids [N, h/2, w/2] int32; `exact` are inputs for the teacher."""
        x = x.float().to(memory_format=torch.channels_last)
        with self.autocast():
            logits = self.net(x)
        inverse_depth = x[:, 3, ::2, ::2] + 0.5
        options = self.options
        loss = affinities.loss(logits, ids.long(), inverse_depth, options.area_power, options.contact_weight)
        return loss if exact is None else loss + options.teacher_weight * self.disagreement(logits, exact)

    def disagreement(self, logits, exact):
        """How far log-odds are from the teacher's, of the samples that are not turned: mean divergence of an edge."""
        upright = exact.flatten(1).any(1)
        if not upright.any():
            return logits.sum() * 0
        with torch.no_grad(), self.autocast():
            told = self.teacher.to(self.device)(exact[upright].float().to(memory_format=torch.channels_last))
        return affinities.divergence(logits[upright], told)


if __name__ == "__main__":
    main()
