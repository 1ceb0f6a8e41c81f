"""Batches of training samples. Sample number `i` depends on the seed, `i` and the views, not on the number of workers."""

import cv2
import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset, Sampler


class Samples(Dataset):
    """An endless set of augmented samples, indexed by number; `sample(view, settings, rng)` makes one, as arrays.

    Each of `groups`, lists of views, provides the same share of the samples. If there are `measured` groups, half of
    the samples are from them, without the sensor model and with their own colours, because a real camera has its own
    errors.
    """

    def __init__(self, groups, sample, settings, seed, measured=()):
        self.groups, self.sample, self.settings, self.seed = groups, sample, settings, seed
        self.measured = measured

    def __getitem__(self, number):
        rng = np.random.default_rng([self.seed, number])
        groups, settings = self.groups, self.settings
        if self.measured and rng.random() < 0.5:
            groups, settings = self.measured, settings._replace(sensor=0.0, recolour=0.0)
        views = groups[rng.integers(len(groups))]
        arrays = self.sample(views[rng.integers(len(views))], settings, rng)
        return tuple(torch.from_numpy(array) for array in arrays)


class NumbersFrom(Sampler):
    """The numbers from `first`, endless."""

    def __init__(self, first):
        self.first = first

    def __iter__(self):
        number = self.first
        while True:
            yield number
            number += 1


def batches(samples, first_step, batch_size, workers):
    """Batches of `Samples`, starting with `first_step`, as stacked arrays."""
    return DataLoader(
        samples,
        batch_size=batch_size,
        sampler=NumbersFrom(first_step * batch_size),
        num_workers=workers,
        worker_init_fn=_one_thread,
        prefetch_factor=4 if workers else None,
    )


def _one_thread(_worker):
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
