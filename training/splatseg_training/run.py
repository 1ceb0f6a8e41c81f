"""A training run: steps, averaged weights, files. Subclasses define the network, data and loss."""

import copy
import math
import os
import signal
import sys
import time

import torch

AVERAGE_STEPS = 400  # time constant of the weights' moving average; shorter at the beginning
DATA_HELP = "labelled folders or patterns of folders; each pattern provides the same share of the samples"


def add_options(parser, batch):
    """Adds the options of every run on files to an argument parser; `batch` is the default batch size."""
    parser.add_argument("--data", nargs="+", required=True, metavar="PATTERN", help=DATA_HELP)
    add_run_options(parser, batch)


def add_run_options(parser, batch, must_end=True):
    """Adds the options of every run that do not depend on where its samples come from.

    With `must_end`, a number of steps or minutes is required.
    """
    add = parser.add_argument
    add("--out", required=True, metavar="RUN", help="folder of the run; if it has a checkpoint, training resumes")
    end = parser.add_mutually_exclusive_group(required=must_end)
    end.add_argument("--steps", type=int, help="end after this many steps")
    end.add_argument("--minutes", type=float, help="end after this time; results then depend on the machine's speed")
    add("--seed", type=int, default=0)
    add("--start", metavar="WEIGHTS", help="weights to begin with, for fine-tuning")
    add("--validate", nargs="*", default=[], metavar="FOLDER", help="labelled folders to evaluate at the end")
    add("--batch", type=int, default=batch)
    add("--rate", type=float, default=2e-3, help="maximum learning rate; it decays along a cosine")
    add("--workers", type=int, default=1, help="processes that prepare samples")
    add("--threads", type=int, default=2, help="threads of the network")
    add("--device", default="cuda" if torch.cuda.is_available() else "cpu", help="cpu, or a GPU as PyTorch names it")


class TrainingRun:
    """The state of a training run.

    Subclasses define `build`, `batches` and `loss`. `sizes` are the named values that determine the network's shape; a
    checkpoint with other values is refused.
    """

    def __init__(self, options, sizes):
        self.options, self.sizes = options, sizes
        os.makedirs(options.out, exist_ok=True)
        torch.set_num_threads(options.threads)
        torch.manual_seed(options.seed)
        net, make_optimisers = self.build()
        self.device = torch.device(options.device)
        self.step, self.seconds, self.losses = 0, 0.0, []
        self.net = net.to(self.device, memory_format=torch.channels_last)
        if options.start:
            self.start_from(options.start)
        self.average = copy.deepcopy(self.net).eval()
        self.optimisers = make_optimisers(self.net)
        self.resume()

    def build(self):
        """The network, and a function from the network to its optimisers."""
        raise NotImplementedError

    def start_from(self, path):
        """Loads the initial weights."""
        self.net.load_state_dict(torch.load(path, map_location=self.device, weights_only=True))

    def prepare(self):
        """Prepares a step, with the network in training mode."""

    def batches(self):
        """Batches, tuples of tensors, from step `self.step` on."""
        raise NotImplementedError

    def loss(self, *batch):
        """The loss of a batch on the device."""
        raise NotImplementedError

    def status(self):
        """Text to append to the progress lines."""
        return ""

    def autocast(self):
        """The context for computing in bfloat16."""
        return torch.autocast(self.device.type, dtype=torch.bfloat16)

    def train(self):
        """Trains until the steps or minutes are over; also saves when interrupted."""
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
        try:
            self._train()
        finally:
            self.save()

    def _train(self):
        source = iter(self.batches())
        last = shown = time.monotonic()
        while (done := self.progress()) < 1:
            self.losses.append(self.update(*next(source), self.rate(done)))
            self.step += 1
            now = time.monotonic()
            self.seconds, last = self.seconds + now - last, now
            if self.step % 50 == 0:
                line = f"step {self.step}  {self.seconds:.0f} s  loss {self.recent():.4f}"
                print(f"{line}  {self.status()}".rstrip(), flush=True)
            if now - shown > 120:
                self.save()
                shown = now

    def progress(self):
        """The completed share of the training."""
        options = self.options
        return self.step / options.steps if options.steps else self.seconds / (60 * options.minutes)

    def rate(self, done):
        """The learning rate: 100 steps of warm-up, then a cosine to 1 % of the maximum."""
        return self.options.rate * min(1, (self.step + 1) / 100) * (0.505 + 0.495 * math.cos(math.pi * done))

    def recent(self):
        recent = self.losses[-100:]
        return sum(recent) / max(1, len(recent))

    def update(self, *values):
        """Runs one optimiser step with the tensors of a batch and the learning rate; returns the loss."""
        *batch, rate = values
        for optimiser in self.optimisers:
            for group in optimiser.param_groups:
                group["lr"] = rate * group["scale"]
        self.net.train()
        self.prepare()
        loss = self.loss(*(tensor.to(self.device, non_blocking=True) for tensor in batch))
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
        """Writes the checkpoint, averaged weights and the loss curve; each file is replaced atomically."""
        state = self.sizes | {
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
        """Plots the loss over the steps, as means of about 200 bins."""
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
        """Resumes from the run's checkpoint, if there is one."""
        path = os.path.join(self.options.out, "checkpoint.pt")
        if not os.path.exists(path):
            return
        state = torch.load(path, map_location="cpu", weights_only=True)  # loading it below moves it to the device
        for name, value in self.sizes.items():
            if state.get(name) != value:
                raise ValueError(f"{path}: has {name} {state.get(name)}, not {value}")
        self.net.load_state_dict(state["net"])
        self.average.load_state_dict(state["average"])
        for optimiser, saved in zip(self.optimisers, state["optimisers"]):
            optimiser.load_state_dict(saved)
        self.step, self.seconds, self.losses = state["step"], state["seconds"], state["losses"]
        print(f"resuming from step {self.step}", flush=True)
