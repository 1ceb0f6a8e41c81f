#!/usr/bin/env python3
"""Makes `crates/metrics/tests/data/single_frames.json`: segments of single frames with the scores of COCO's own code.

    pip install numpy scipy pycocotools
    python tools/make_single_frame_test_data.py crates/metrics/tests/data/single_frames.json

Objects and segments are Voronoi cells; segments have moved cells, more or fewer of them, and holes. Confidences are
distinct multiples of 0.01, so that the order is the same as ours. Boundaries are counted with SciPy.
"""

import argparse
import contextlib
import io
import itertools
import json
from pathlib import Path

import numpy as np
from pycocotools import mask as coco_mask
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval
from scipy import ndimage

HEIGHT, WIDTH, FRAMES = 90, 120, 6
AREAS = {"all": (0, 1e9), "small": (0, 399.5), "medium": (399.5, 4000.5), "large": (4000.5, 1e9)}
TOLERANCE = 2


def cells(centres):
    """The nearest centre of each pixel, from 1; horizontal distances count less than vertical ones."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    distances = [(rows - y) ** 2 + 0.5 * (columns - x) ** 2 for y, x in centres]
    return np.argmin(distances, axis=0) + 1


def frame(rng):
    """A true frame with unlabelled ground, and a prediction."""
    centres = rng.uniform(0, 1, (int(rng.integers(4, 14)), 2)) ** 1.7 * (HEIGHT, WIDTH)
    truth = cells(centres)
    truth[truth == rng.integers(1, len(centres) + 1)] = 0
    moved = centres + rng.normal(0, 2.5, centres.shape)
    keep = rng.random(len(moved)) < 0.8
    keep[0] = True
    moved = np.concatenate([moved[keep], rng.uniform(0, 1, (int(rng.integers(0, 3)), 2)) * (HEIGHT, WIDTH)])
    predicted = cells(moved)
    y, x = rng.integers(0, HEIGHT - 20), rng.integers(0, WIDTH - 20)
    predicted[y : y + 15, x : x + 18] = 0
    return truth, predicted


def runs(labels):
    return [[int(label), len(list(same))] for label, same in itertools.groupby(labels.ravel())]


def encoded(mask):
    rle = coco_mask.encode(np.asfortranarray(mask.astype(np.uint8)))
    return {"size": rle["size"], "counts": rle["counts"].decode()}


def coco_scores(frames, confidences):
    """AP, AP50, AR@100 and AR@100 by area, percent; None if there is no object."""
    objects, segments = [], []
    for number, (truth, predicted) in enumerate(frames):
        for label in np.unique(truth[truth > 0]):
            mask = truth == label
            objects.append({
                "id": len(objects) + 1, "image_id": number, "category_id": 1, "iscrowd": 0,
                "segmentation": encoded(mask), "area": int(mask.sum()), "bbox": [0, 0, 1, 1],
            })  # fmt: skip
        for label, confidence in confidences[number].items():
            mask = (predicted == label) & (truth > 0)
            if mask.any():
                segment = {"image_id": number, "category_id": 1, "segmentation": encoded(mask), "score": confidence}
                segments.append(segment)
    with contextlib.redirect_stdout(io.StringIO()):
        coco = COCO()
        images = [{"id": number, "width": WIDTH, "height": HEIGHT} for number in range(len(frames))]
        coco.dataset = {"images": images, "annotations": objects, "categories": [{"id": 1, "name": "thing"}]}
        coco.createIndex()
        evaluation = COCOeval(coco, coco.loadRes(segments), "segm")
        evaluation.params.areaRng, evaluation.params.areaRngLbl = list(AREAS.values()), list(AREAS)
        evaluation.params.maxDets = [100]
        evaluation.evaluate()
        evaluation.accumulate()
    precision, recall = evaluation.eval["precision"][:, :, 0, :, 0], evaluation.eval["recall"][:, 0, :, 0]
    mean = lambda values: None if (values < 0).all() else 100 * float(values.mean())
    return {
        "ap": mean(precision[:, :, 0]),
        "ap50": mean(precision[0, :, 0]),
        "ar": mean(recall[:, 0]),
        "ar_by_size": {name: mean(recall[:, index]) for index, name in enumerate(AREAS) if index},
    }


def boundary_f(frames):
    """F-score of boundary pixels over all frames; pixels near unlabelled ground are excluded."""
    steps = np.arange(-TOLERANCE, TOLERANCE + 1)
    disc = steps[:, None] ** 2 + steps[None] ** 2 <= TOLERANCE**2
    sums = np.zeros(4)
    for truth, predicted in frames:
        counted = ~ndimage.binary_dilation(truth == 0, disc)
        edges = []
        for labels in (truth, predicted):
            edge = np.zeros(labels.shape, bool)
            edge[:, :-1] |= labels[:, :-1] != labels[:, 1:]
            edge[:-1] |= labels[:-1] != labels[1:]
            edges.append(edge & counted)
        true, found = edges
        sums += [found.sum(), (found & ndimage.binary_dilation(true, disc)).sum()] + [
            true.sum(),
            (true & ndimage.binary_dilation(found, disc)).sum(),
        ]
    precision, recall = sums[1] / sums[0], sums[3] / sums[2]
    return 200 * precision * recall / (precision + recall)


def outside_largest(frames, transposed):
    """Percent of the pixels with both labels outside the largest part of their object, or of their segment."""
    inside = total = 0
    for truth, predicted in frames:
        both = (truth > 0) & (predicted > 0)
        table = np.zeros((truth.max() + 1, predicted.max() + 1), int)
        np.add.at(table, (truth[both], predicted[both]), 1)
        inside += table.max(axis=0 if transposed else 1).sum()
        total += both.sum()
    return float(100 - 100 * inside / total)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    out = parser.parse_args().out
    rng = np.random.default_rng(7)
    frames = [frame(rng) for _ in range(FRAMES)]
    steps, confidences = iter(rng.permutation(100)), []
    for _, predicted in frames:
        labels = np.unique(predicted[predicted > 0])
        confidences.append({int(label): float(next(steps) + 0.5) / 100 for label in labels})
    expected = coco_scores(frames, confidences) | {
        "boundary_f": boundary_f(frames),
        "over_segmentation": outside_largest(frames, transposed=False),
        "under_segmentation": outside_largest(frames, transposed=True),
    }
    listed = [
        {"truth": runs(truth), "predicted": runs(predicted), "confidences": known}
        for (truth, predicted), known in zip(frames, confidences)
    ]
    out.write_text(json.dumps({"width": WIDTH, "height": HEIGHT, "frames": listed, "expected": expected}) + "\n")
    print(json.dumps(expected, indent=1))


if __name__ == "__main__":
    main()
