"""Pseudo-labels: objects on which two passes of `splatseg run` over a recording agree in many frames.

The first pass builds the memory. The second starts with it, so that its early frames benefit from later observations.
Where both passes agree, the memory is reliable.
"""

import os
from collections import Counter
from typing import NamedTuple

import cv2
import numpy as np


class Rules(NamedTuple):
    """Conditions for a label."""

    min_frames: int = 10  # minimum number of frames with agreement on an object
    min_agreement: float = 0.5  # minimum share of an object's pixels with agreement in such a frame
    margin: int = 2  # pixels excluded around pixels without agreement
    border: int = 2  # pixels excluded on both sides of borders between ids
    min_labelled: float = 0.3  # minimum share of labelled pixels; other frames are skipped


def names(run):
    """The names of the id images of a run, in order."""
    folder = os.path.join(run, "segments")
    found = sorted(name[:-4] for name in os.listdir(folder) if name.endswith(".png")) if os.path.isdir(folder) else []
    if not found:
        raise ValueError(f"{folder}: no id images")
    return found


def read_ids(run, name):
    """The ids [H, W] uint16 of a frame; 0 means no segment."""
    path = os.path.join(run, "segments", name + ".png")
    ids = cv2.imread(path, cv2.IMREAD_UNCHANGED)
    if ids is None or ids.dtype != np.uint16 or ids.ndim != 2:
        raise ValueError(f"{path}: not a 16-bit grey image")
    return ids


class Consensus:
    """The consensus of pass one and pass two, given as folders of runs."""

    def __init__(self, one, two, rules):
        self.one, self.two, self.rules = one, two, rules
        self.names = [name for name in names(two) if name in set(names(one))]
        self.match = self._match()
        self.kept = self._kept()

    def labels(self, name):
        """Labels [H, W] uint16 of a frame, 0 where there is no consensus; None if there are too few labels or
        objects."""
        ids, agreed = self._agreed(name)
        near, beside = _window(self.rules.margin), _window(self.rules.border)
        doubtful = cv2.dilate((~agreed).astype(np.uint8), near) > 0
        doubtful |= cv2.dilate(ids, beside) != cv2.erode(ids, beside)
        labels = np.where(self.kept[ids] & ~doubtful, ids, 0).astype(np.uint16)
        enough = np.count_nonzero(labels) >= self.rules.min_labelled * labels.size
        return labels if enough and len(np.unique(labels[labels > 0])) > 1 else None

    def _agreed(self, name):
        """Pass two's ids, and a mask of the pixels where pass one agrees."""
        one, two = read_ids(self.one, name), read_ids(self.two, name)
        return two, (two > 0) & (self.match[one] == two)

    def _match(self):
        """Maps each id of pass one to the id of pass two that shares most pixels with it.

        An object that pass one initially split has several ids there; all map to the same id.
        """
        shared = Counter()
        for name in self.names:
            pairs = np.stack([read_ids(self.one, name).ravel(), read_ids(self.two, name).ravel()])
            pairs, counts = np.unique(pairs, axis=1, return_counts=True)
            shared.update(dict(zip(map(tuple, pairs.T.tolist()), counts.tolist())))
        match = np.zeros(1 << 16, np.uint16)
        for (a, b), _ in reversed(shared.most_common()):
            if a and b:
                match[a] = b
        return match

    def _kept(self):
        """The ids of pass two with agreement in enough frames."""
        frames = np.zeros(1 << 16, int)
        for name in self.names:
            ids, agreed = self._agreed(name)
            areas, shared = np.bincount(ids.ravel()), np.bincount(ids[agreed], minlength=ids.max() + 1)
            frames[: len(areas)] += (areas > 0) & (shared >= self.rules.min_agreement * areas)
        frames[0] = 0
        return frames >= self.rules.min_frames


def _window(reach):
    """The kernel for `cv2.dilate`: the square of pixels within `reach`."""
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
