"""Trains the affinity network: `python -m splatseg_training.train --data 'ROOMS/*' --out RUN --steps 10000`.

RUN gets `checkpoint.pt`, from which the same command goes on, `weights.pt` (the averaged weights, which `export` and
`evaluate` read), `losses.csv` and `losses.png`. With the same data, seed and steps, an interrupted run gives the same
losses as an unbroken one. Real labelled folders can be checked on the way: `--validate FOLDER...`.
"""

import argparse
import copy
import math
import os
import signal
import sys
import time

import torch

from . import affinities
from .augment import Settings
from .dataset import read_groups
from .loader import batches
from .network import WIDTHS, AffinityNet, load
from .optimiser import optimisers

DATA_HELP = "labelled folders, or patterns of such; each pattern gives the same share of the samples"
MEASURED_HELP = "labelled folders that a real camera took: half of the samples, without sensor model and recolouring"
AVERAGE_STEPS = 400  # time constant of the weights' moving average; shorter at the beginning


def main(arguments=None):
    options = parse(arguments)
    os.makedirs(options.out, exist_ok=True)
    torch.set_num_threads(options.threads)
    groups, measured = read_groups(options.data), read_groups(options.measured)
    run = Run(options)
    run.resume()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # saves, too
    try:
        run.train(groups, measured)
    finally:
        run.save()


def parse(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--data", nargs="+", required=True, metavar="PATTERN", help=DATA_HELP)
    add("--measured", nargs="+", default=[], metavar="PATTERN", help=MEASURED_HELP)
    add("--out", required=True, metavar="RUN", help="folder of the run; if it has a checkpoint, training goes on")
    add("--steps", type=int, help="end after this many steps")
    add("--minutes", type=float, help="end after this many minutes; results then depend on the machine's speed")
    add("--seed", type=int, default=0)
    add("--start", metavar="WEIGHTS", help="weights.pt or .safetensors to begin with, for fine-tuning")
    add("--freeze-norms", action="store_true", help="keep the statistics of batch norms; for fine-tuning")
    add("--validate", nargs="*", default=[], metavar="FOLDER", help="labelled folders to evaluate at the end")
    add("--batch", type=int, default=8)
    add("--rate", type=float, default=2e-3, help="highest learning rate; it falls along a cosine")
    add("--widths", type=int, nargs=5, default=WIDTHS, help="channels of the five resolutions")
    add("--area-power", type=float, default=0.5, help="an object weighs as its area to minus this power")
    add("--contact-weight", type=float, default=2.0, help="weight of borders between objects that touch")
    add("--workers", type=int, default=1, help="processes that prepare samples")
    add("--threads", type=int, default=2, help="threads of the network")
    for name, default in Settings._field_defaults.items():
        add("--" + name.replace("_", "-"), type=type(default), default=default, help="see augment.Settings")
    options = parser.parse_args(arguments)
    if (options.steps is None) == (options.minutes is None):
        parser.error("give --steps or --minutes")
    if options.start and options.start.endswith(".safetensors") and not options.freeze_norms:
        parser.error("the batch norms of a .safetensors are folded: add --freeze-norms")
    return options


class Run:
    """The state of a training run."""

    def __init__(self, options):
        self.options = options
        torch.manual_seed(options.seed)
        self.net = AffinityNet(tuple(options.widths)).to(memory_format=torch.channels_last)
        if options.start:
            self.net.load_state_dict(load(options.start).state_dict())
        self.average = copy.deepcopy(self.net).eval()
        self.optimisers = optimisers(self.net)
        self.step, self.seconds, self.losses = 0, 0.0, []

    def train(self, groups, measured=()):
        """Trains until the steps or minutes are over."""
        options = self.options
        settings = Settings(**{name: getattr(options, name) for name in Settings._fields})
        source = iter(batches(groups, settings, options.seed, self.step, options.batch, options.workers, measured))
        last = shown = time.monotonic()
        while (done := self.progress()) < 1:
            self.losses.append(self.update(*next(source), self.rate(done)))
            self.step += 1
            now = time.monotonic()
            self.seconds, last = self.seconds + now - last, now
            if self.step % 50 == 0:
                print(f"step {self.step}  {self.seconds:.0f} s  loss {self.recent():.4f}", flush=True)
            if now - shown > 120:
                self.save()
                shown = now
        self.save()
        if options.validate:
            from .evaluate import report

            report(self.average, options.validate)

    def progress(self):
        """The share of the training that is done."""
        options = self.options
        return self.step / options.steps if options.steps else self.seconds / (60 * options.minutes)

    def rate(self, done):
        """Learning rate: 100 steps of warm-up, then a cosine to 1 % of the highest."""
        return self.options.rate * min(1, (self.step + 1) / 100) * (0.505 + 0.495 * math.cos(math.pi * done))

    def recent(self):
        recent = self.losses[-100:]
        return sum(recent) / max(1, len(recent))

    def update(self, x, ids, rate):
        """One step of the optimiser; returns the loss."""
        for optimiser in self.optimisers:
            for group in optimiser.param_groups:
                group["lr"] = rate * group["scale"]
        self.net.train()
        if self.options.freeze_norms:
            for module in self.net.modules():
                if isinstance(module, torch.nn.BatchNorm2d):
                    module.eval()
        x = x.float().to(memory_format=torch.channels_last)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            logits = self.net(x)
        inverse_depth = x[:, 3, ::2, ::2] + 0.5
        options = self.options
        loss = affinities.loss(logits, ids.long(), inverse_depth, options.area_power, options.contact_weight)
        self.net.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 5.0)
        for optimiser in self.optimisers:
            optimiser.step()
        self.update_average()
        return loss.item()

    @torch.no_grad()
    def update_average(self):
        """Moves the averaged weights towards the current ones."""
        share = max(1 / AVERAGE_STEPS, 1 / (1 + self.step / 4))
        for mean, now in zip(self.average.state_dict().values(), self.net.state_dict().values()):
            if mean.is_floating_point():
                mean.lerp_(now, share)
            else:
                mean.copy_(now)

    def save(self):
        """Writes checkpoint, averaged weights and the losses' curve; each file is replaced at once."""
        state = {
            "widths": tuple(self.options.widths),
            "net": self.net.state_dict(),
            "average": self.average.state_dict(),
            "optimisers": [optimiser.state_dict() for optimiser in self.optimisers],
            "step": self.step,
            "seconds": self.seconds,
            "losses": self.losses,
        }
        self.write("checkpoint.pt", lambda path: torch.save(state, path))
        self.write("weights.pt", lambda path: torch.save(self.average.state_dict(), path))
        self.write("losses.csv", self.write_losses)
        self.write("losses.png", self.plot)

    def write(self, name, writer):
        path = os.path.join(self.options.out, name)
        staged = os.path.join(self.options.out, "new-" + name)
        writer(staged)
        os.replace(staged, path)

    def write_losses(self, path):
        with open(path, "w") as file:
            file.write("step,loss\n")
            file.writelines(f"{i + 1},{loss:.6f}\n" for i, loss in enumerate(self.losses))

    def plot(self, path):
        """The loss over the steps, as means of about 200 bins."""
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot

        size = max(1, len(self.losses) // 200)
        means = [sum(self.losses[i : i + size]) / size for i in range(0, len(self.losses) - size + 1, size)]
        figure, axes = pyplot.subplots(figsize=(7, 4))
        axes.plot([size * (i + 1) for i in range(len(means))], means)
        axes.set_xlabel("step")
        axes.set_ylabel("loss")
        axes.grid(True)
        figure.savefig(path, dpi=100, bbox_inches="tight")
        pyplot.close(figure)

    def resume(self):
        """Goes on from the run's checkpoint, if there is one."""
        path = os.path.join(self.options.out, "checkpoint.pt")
        if not os.path.exists(path):
            return
        state = torch.load(path, weights_only=True)
        if tuple(state["widths"]) != tuple(self.options.widths):
            raise ValueError(f"{path}: has widths {state['widths']}, not {self.options.widths}")
        self.net.load_state_dict(state["net"])
        self.average.load_state_dict(state["average"])
        for optimiser, saved in zip(self.optimisers, state["optimisers"]):
            optimiser.load_state_dict(saved)
        self.step, self.seconds, self.losses = state["step"], state["seconds"], state["losses"]
        print(f"going on from step {self.step}", flush=True)


if __name__ == "__main__":
    main()
