"""Quality of single frames: `python -m splatseg_training.evaluate WEIGHTS FOLDER...`, over labelled folders.

Per threshold: k1, the quality of the paper's protocol at k = 1 (matched IoU over the mean number of segments and
objects, unlabelled pixels and a border excluded); segments per frame; and the share of objects found at an IoU over
0.5. Choose thresholds on real folders: rendered ones rank them wrongly.

With `--best-of-all`, each object takes the segment that fits it best, at whichever of the thresholds: an upper bound of
what choosing among the levels of the merge tree could give. It prints the mean IoU and the share of objects found.
"""

import argparse

import numpy as np
import torch
from scipy.optimize import linear_sum_assignment

from .agglomerate import merges, segments
from .augment import matrix
from .dataset import read_folder
from .inputs import inputs
from .network import load

THRESHOLDS = (0.0, -0.5, -1.0, -1.5, -2.0)
BORDER = 5  # pixels
LEAST_PIXELS = 100  # smaller segments are dropped
CHANNELS = {"colour": slice(0, 3), "depth": slice(3, 8)}  # of the input


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights")
    parser.add_argument("folders", nargs="+", metavar="FOLDER")
    parser.add_argument("--thresholds", type=float, nargs="+", default=THRESHOLDS)
    parser.add_argument("--every", type=int, default=1, help="use every n-th frame")
    parser.add_argument("--without", choices=sorted(CHANNELS), help="omit these channels, as training sometimes does")
    parser.add_argument(
        "--best-of-all", action="store_true", help="instead, how well the best segments of all thresholds fit"
    )
    options = parser.parse_args()
    show = report_best if options.best_of_all else report
    show(load(options.weights), options.folders, options.thresholds, options.every, options.without)


def report(net, folders, thresholds=THRESHOLDS, every=1, without=None):
    """Prints one line per folder and threshold."""
    for folder in folders:
        views = [view for _, view in read_folder(folder, every)]
        for threshold, (quality, found, count) in zip(thresholds, evaluate(net, views, thresholds, without)):
            line = f"threshold {threshold:5.2f}  k1 {quality:.1f}  {count:.1f} segments  recall50 {found:.1f}"
            print(f"{folder}  {len(views)} frames  {line}", flush=True)


def report_best(net, folders, thresholds=THRESHOLDS, every=1, without=None):
    """Prints one line per folder: how well the best segments of all thresholds fit."""
    for folder in folders:
        views = [view for _, view in read_folder(folder, every)]
        best = np.concatenate([best_iou(view.ids, cuts(net, view, thresholds, without)) for view in views])
        line = f"best of {len(thresholds)} thresholds  mean IoU {100 * best.mean():.1f}"
        print(f"{folder}  {len(views)} frames  {line}  recall50 {100 * (best > 0.5).mean():.1f}", flush=True)


def evaluate(net, views, thresholds, without=None):
    """For each threshold: k1 (percent), recall at IoU 0.5 (percent) and segments per frame."""
    totals = np.zeros((len(thresholds), 4))
    for view in views:
        for total, predicted in zip(totals, cuts(net, view, thresholds, without)):
            total += score(view.ids, predicted)
    iou, found, predicted, objects = totals.T
    return list(zip(200 * iou / (predicted + objects), 100 * found / objects, predicted / len(views)))


def cuts(net, view, thresholds, without=None):
    """For each threshold, the ids of a view's segments."""
    logits = predict(net, view, without)
    done = merges(logits, min(thresholds))
    return [full_size(segments(done, threshold, logits.shape[1:]), view.ids.shape) for threshold in thresholds]


@torch.no_grad()
def predict(net, view, without=None):
    """Log-odds [12, H/2, W/2] of a view; `without` names `CHANNELS` to omit."""
    x = inputs(view.colour, view.depth, matrix(view.camera))
    if without:
        x[CHANNELS[without]] = 0
    return net.eval()(torch.from_numpy(x)[None])[0].numpy()


def full_size(small, shape):
    """Upscales segments of the half-size image to ids from 1; 0 where a segment is too small."""
    ids = small.repeat(2, 0).repeat(2, 1)[: shape[0], : shape[1]] + 1
    inner = ids[BORDER:-BORDER, BORDER:-BORDER]
    large = np.bincount(inner.ravel(), minlength=ids.max() + 1) >= LEAST_PIXELS
    return np.where(large[ids], ids, 0)


def score(truth, predicted):
    """Sum of matched IoU, objects found at IoU 0.5, segments, objects; matched for the largest sum of F-scores."""
    shared, sums = _overlaps(truth, predicted)
    pairs = linear_sum_assignment(-2 * shared / sums)
    iou = (shared / (sums - shared))[pairs]
    return np.array([iou.sum(), (iou > 0.5).sum(), *shared.shape[::-1]])


def best_iou(truth, predictions):
    """For each object, the IoU of the segment that fits it best, from any of the predictions."""
    best = []
    for predicted in predictions:
        shared, sums = _overlaps(truth, predicted)
        best.append((shared / (sums - shared)).max(1, initial=0))
    return np.max(best, 0)


def _overlaps(truth, predicted):
    """Shared pixels of each object and segment, and the sums of their areas."""
    inner = (slice(BORDER, -BORDER), slice(BORDER, -BORDER))
    truth, predicted = truth[inner].astype(int), predicted[inner]
    objects, areas = np.unique(truth[truth > 0], return_counts=True)
    both = (truth > 0) & (predicted > 0)
    found, sizes = np.unique(predicted[both], return_counts=True)
    shared = np.zeros((len(objects), len(found)))
    np.add.at(shared, (np.searchsorted(objects, truth[both]), np.searchsorted(found, predicted[both])), 1)
    return shared, areas[:, None] + sizes[None]


if __name__ == "__main__":
    main()
