"""Trains the affinity network on generated scenes: `python -m splatseg_training.generated.train --out RUN`.

It ends after 8.5 minutes, or `--steps` or `--minutes`. No files are needed: rooms are built, rendered and degraded on the device. RUN gets the files of `splatseg_training.train`,
and the same command resumes. The samples of a step depend on seed, step, batch size and kind of device only. With
`--data`, a share of each batch comes from labelled folders, e.g. rendered rooms.
"""

import argparse
import time

import torch

from .. import train
from ..augment import Settings, sample
from ..dataset import read_groups
from ..evaluate import report
from ..loader import Samples, batches
from ..run import DATA_HELP, add_run_options
from .batches import batch

BATCH = {"cpu": 8, "cuda": 256}
MINUTES = 8.5  # leaves half a minute of nine for starting and saving
SHOWN = 50  # steps, over which speed is measured


def main(arguments=None):
    options = parse(arguments)
    run = Run(options, read_groups(options.data))
    run.train()
    if options.validate:
        report(run.average.cpu(), options.validate)


def parse(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_run_options(parser, batch=None, must_end=False)
    add = parser.add_argument
    add("--data", nargs="+", default=[], metavar="PATTERN", help=DATA_HELP)
    add("--data-share", type=float, default=0.25, help="share of the samples from --data, if it is given")
    train.add_network_options(parser)
    train.add_settings(parser, Settings(no_colour=0.5))
    parser.set_defaults(device="auto", contact_weight=1.0)
    options = parser.parse_args(arguments)
    if options.teacher:
        parser.error("--teacher is only for samples from files")
    if options.steps is None and options.minutes is None:
        options.minutes = MINUTES
    if options.device == "auto":
        options.device = "cuda" if torch.cuda.is_available() else "cpu"
    options.batch = options.batch or BATCH.get(torch.device(options.device).type, BATCH["cuda"])
    return options


class Run(train.Run):
    """A run on generated scenes, mixed with views of `groups` if there are any."""

    def __init__(self, options, groups=()):
        self.watch = Stopwatch(options.device)
        self.from_files = round(options.batch * options.data_share) if groups else 0
        super().__init__(options, groups)

    def batches(self):
        """Inputs [batch, 8, h, w] float16 and ids [batch, h/2, w/2] int32, from step `self.step` on."""
        options = self.options
        settings, files = train.settings(options), self._files()
        step, generated = self.step, options.batch - self.from_files
        while True:
            self.watch.start()
            parts = [batch(options.seed, step, generated, settings, self.device)] if generated else []
            self.watch.stop()
            if files is not None:
                parts.append([tensor.to(self.device, non_blocking=True) for tensor in next(files)])
            yield tuple(torch.cat(tensors) for tensors in zip(*parts))
            step += 1

    def _files(self):
        """The batches of the samples from files, or None."""
        if not self.from_files:
            return None
        options = self.options
        samples = Samples(self.groups, sample, train.settings(options), options.seed)
        return iter(batches(samples, self.step, self.from_files, options.workers))

    def status(self):
        return self.watch.report(SHOWN)


class Stopwatch:
    """Measures the speed of training and the share of the time that generating takes.

    On a GPU, where generating is only queued, events measure it.
    """

    def __init__(self, device):
        self.cuda = torch.device(device).type == "cuda"
        self.spans, self.begun, self.last = [], None, time.monotonic()

    def _now(self):
        if not self.cuda:
            return time.monotonic()
        event = torch.cuda.Event(enable_timing=True)
        event.record()
        return event

    def start(self):
        self.begun = self._now()

    def stop(self):
        self.spans.append((self.begun, self._now()))

    def report(self, steps):
        """Steps per second over the last `steps`, and the share of generating."""
        seconds, self.last = time.monotonic() - self.last, time.monotonic()
        if self.cuda:
            torch.cuda.synchronize()
        generating = sum(a.elapsed_time(b) / 1000 if self.cuda else b - a for a, b in self.spans)
        self.spans = []
        return f"{steps / seconds:.2f} steps/s, {100 * generating / seconds:.0f} % generating"


if __name__ == "__main__":
    main()
