"""Quality of masks: `python -m splatseg_training.fastsam.evaluate WEIGHTS FOLDER...`, over labelled folders.

Average precision of masks for one class as COCO defines it (Lin et al. 2014): mAP50 at an IoU of 0.5, mAP50-95 the mean
over IoUs from 0.5 to 0.95 in steps of 0.05, at most 100 masks per image; and the share of objects found at 0.5. Views
without colour and objects with few pixels are excluded.
"""

import argparse
import glob

import numpy as np

from ..dataset import read_folder
from .network import load
from .predict import Settings, predict
from .samples import Settings as SampleSettings

IOUS = np.linspace(0.5, 0.95, 10)
RECALLS = np.linspace(0, 1, 101)
PER_IMAGE = 100


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", help="weights.pt of a run, or .safetensors")
    parser.add_argument("folders", nargs="+", metavar="FOLDER", help="labelled folders or patterns of folders")
    parser.add_argument("--image-size", type=int, default=320)
    parser.add_argument("--iou", type=float, default=0.7, help="IoU threshold of the non-maximum suppression")
    parser.add_argument("--every", type=int, default=1, help="use every n-th frame")
    parser.add_argument("--min-pixels", type=int, default=SampleSettings().min_pixels)
    options = parser.parse_args()
    report(load(options.weights), options.folders, options.image_size, options.min_pixels, options.iou, options.every)


def report(net, patterns, image_size, min_pixels, iou=0.7, every=1):
    """Prints one line; returns mAP50 and mAP50-95."""
    folders = sorted(folder for pattern in patterns for folder in glob.glob(pattern))
    views = [view for folder in folders for _, view in read_folder(folder, every, view_size(image_size))]
    views = [view for view in views if view.colour is not None]
    if not views:
        raise ValueError(f"{' '.join(patterns)}: no views with colours")
    settings = Settings(image_size, 0.001, iou, PER_IMAGE)
    precision, recall = average_precision((predict(net, v.colour, settings), truth(v.ids, min_pixels)) for v in views)
    line = f"mask mAP50 {precision[0]:.3f}  mAP50-95 {precision.mean():.3f}  recall50 {recall[0]:.3f}"
    print(f"{len(views)} views from {len(folders)} folders: {line}", flush=True)
    return precision[0], precision.mean()


def view_size(image_size):
    """Width and height of views for an input whose longer side is `image_size`."""
    return image_size, image_size * 3 // 4


def truth(ids, min_pixels):
    """Masks [K, height, width] of the objects with enough pixels."""
    numbers, areas = np.unique(ids[ids > 0], return_counts=True)
    return ids == numbers[areas >= min_pixels, None, None]


def average_precision(images):
    """Average precision and recall at each of `IOUS`, from pairs of `Objects` and true masks [G, h, w]."""
    scores, hits, count = [], [], 0
    for objects, masks in images:
        scores.append(objects.scores)
        hits.append(_hits(mask_iou(objects.masks, masks)))
        count += len(masks)
    order = np.argsort(-np.concatenate(scores), kind="stable")
    hits = np.concatenate(hits, 1)[:, order].cumsum(1)
    recall = hits / max(1, count)
    precision = hits / np.arange(1, hits.shape[1] + 1)
    # The precision at a recall is the maximum at that recall or a higher one.
    precision = np.maximum.accumulate(precision[:, ::-1], 1)[:, ::-1]
    mean = [_sampled(r, p).mean() for r, p in zip(recall, precision)]
    return np.array(mean), recall[:, -1] if hits.shape[1] else np.zeros(len(IOUS))


def _sampled(recall, precision):
    """The precision at each of `RECALLS`; 0 where that recall is not reached."""
    return np.append(precision, 0)[np.searchsorted(recall, RECALLS)]


def _hits(iou):
    """For each of `IOUS` and each mask, best first, true if it finds an object that no better mask has found."""
    found = np.zeros((len(IOUS), len(iou)), bool)
    for row, least in zip(found, IOUS):
        free = np.ones(iou.shape[1], bool)
        for i, overlap in enumerate(iou):
            overlap = np.where(free, overlap, -1)
            if overlap.size and overlap.max() >= least:
                row[i], free[overlap.argmax()] = True, False
    return found


def mask_iou(a, b):
    """IoU [K, G] of masks [K, h, w] and [G, h, w]."""
    a, b = (masks.reshape(len(masks), -1).astype(np.float32) for masks in (a, b))
    # Pixel counts are integers, exact in single precision; quotients may equal one of `IOUS`.
    shared = (a @ b.T).astype(np.float64)
    return shared / np.maximum(a.sum(1)[:, None] + b.sum(1) - shared, 1)


if __name__ == "__main__":
    main()
