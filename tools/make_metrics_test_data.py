#!/usr/bin/env python3
"""Recomputes the reference scores in `crates/metrics/tests/data`, without the code under test, and compares them.

    pip install numpy scipy pillow        # in a virtual environment
    python tools/make_metrics_test_data.py crates/metrics/tests/data [--write]

The label videos (`stq/<video>/gt_*.png`, `pred_*.png`: 16-bit ids, 0 = none) are random blobs with switches, splits,
merges, misses and false positives; they are inputs, which the script does not make. It computes from them, with one
boolean mask per tube:

  vsq/expected.json           VSQ as printed: windows every 15 frames that fit, Hungarian algorithm on IoU, IoU > 0.5
  vsq/authors_protocol.json   VSQ and STQ as the authors' evaluation code computes them (opipari/FastSPAM, opipari/MVPd)
  stq/expected.json           STQ of STEP; `float64` is this script's. The other numbers are deeplab2's (google-research/deeplab2,
                              STQuality with num_classes=2), and `unit_vectors.json` holds the vectors of its own unit test

`--write` replaces the stored numbers by this script's.
"""

import argparse
import json
import math
from pathlib import Path

import numpy
from PIL import Image
from scipy.optimize import linear_sum_assignment

LENGTHS = [1, 5, 10, 15]
STEP = 15


def read(folder):
    def maps(kind):
        return numpy.stack([numpy.array(Image.open(path)).astype(int) for path in sorted(folder.glob(f"{kind}_*.png"))])

    return maps("gt"), maps("pred")


def tubes(maps):
    return [maps == index for index in numpy.unique(maps) if index > 0]


def matched(truths, predictions, use_f_score):
    """Indices of the best one-to-one matching, and the IoU of each pair."""
    overlap = numpy.array([[(t & p).sum() for p in predictions] for t in truths], float).reshape(len(truths), -1)
    sizes = numpy.array([t.sum() for t in truths])[:, None] + numpy.array([p.sum() for p in predictions])[None, :]
    with numpy.errstate(divide="ignore", invalid="ignore"):
        score = numpy.nan_to_num(2 * overlap / sizes if use_f_score else overlap / (sizes - overlap))
        iou = numpy.nan_to_num(overlap / (sizes - overlap))
    rows, columns = linear_sum_assignment(score, maximize=True)
    return list(zip(rows, columns, iou[rows, columns]))


def counted(truths, predictions, use_f_score, is_hit):
    hits = []
    if truths and predictions:
        hits = [iou for _, _, iou in matched(truths, predictions, use_f_score) if is_hit(iou)]
    return {"sum_iou": sum(hits), "tp": len(hits), "fp": len(predictions) - len(hits), "fn": len(truths) - len(hits)}


def linked(maps):
    """Masks without ids as tubes: masks of consecutive frames are linked by the best summed F-score."""
    tubes_, open_ = [], []
    for frame, labels in enumerate(maps):
        # A frame without masks gets an empty one.
        masks = [labels == index for index in numpy.unique(labels) if index > 0] or [numpy.zeros_like(labels, bool)]
        partner = {}
        if open_:
            previous = [tube[frame - 1] for tube in open_]
            partner = {column: row for row, column, iou in matched(previous, masks, True) if iou > 0}
        still = []
        for column, mask in enumerate(masks):
            tube = open_[partner[column]] if column in partner else numpy.zeros_like(maps, bool)
            tube[frame] = mask
            still.append(tube)
            if column not in partner:
                tubes_.append(tube)
        open_ = still
    return tubes_


def vsq(videos, windows, predicted, use_f_score, is_hit):
    """VSQ and its counts by window length, per video and summed over the videos."""
    def add(parts):
        total = {key: sum(part[key] for part in parts) for key in ("sum_iou", "tp", "fp", "fn", "windows")}
        base = total["tp"] + total["fp"] / 2 + total["fn"] / 2
        return total | {"VSQ": total["sum_iou"] / base if base else None}

    empty = {"sum_iou": 0.0, "tp": 0, "fp": 0, "fn": 0, "windows": 0}
    result = {}
    for name, (truth, prediction) in videos.items():
        result[name] = {"per_k": {}}
        for length in LENGTHS:
            parts = [empty]
            for start in windows(len(truth), length):
                cut = slice(start, start + length)
                found = counted(tubes(truth[cut]), predicted(prediction, start, length), use_f_score, is_hit)
                parts.append(found | {"windows": 1})
            result[name]["per_k"][str(length)] = add(parts)
    per_k = {str(k): add([video["per_k"][str(k)] for video in result.values()]) for k in LENGTHS}
    return {"VSQ": numpy.mean([part["VSQ"] for part in per_k.values()]), "per_k": per_k, "videos": result}


def associations(truth, predictions):
    """For every true track: the sum over predicted tracks of TPA · TPA / (sizes - TPA), by its size."""
    for track in tubes(truth):
        overlaps = [(int((track & p).sum()), int(p.sum())) for p in predictions]
        size = int(track.sum())
        yield sum(o * (o / (s + size - o)) for o, s in overlaps if o) / size


def strict_stq(videos):
    result, terms, pixels = {}, [], numpy.zeros(2, int)
    for name, (truth, prediction) in videos.items():
        own = list(associations(truth, tubes(prediction)))
        both, either = ((truth > 0) & (prediction > 0)).sum(), ((truth > 0) | (prediction > 0)).sum()
        terms, pixels = terms + own, pixels + [both, either]
        result[name] = {"float64": stq(own, both, either)}
    return {"float64": stq(terms, *pixels), "videos": result}


def stq(terms, both, either):
    aq, sq = (sum(terms) / len(terms) if terms else 0.0), (both / either if either else 0.0)
    return {"AQ": aq, "SQ": float(sq), "STQ": math.sqrt(aq * sq), "intersection": int(both), "union": int(either)}


def authors_stq(videos, tracks):
    result, terms, pixels = {}, [], numpy.zeros(2, int)
    for name, (truth, prediction) in videos.items():
        own = list(associations(truth, tracks(prediction)))
        pair = [int(((truth > 0) & (prediction > 0)).sum()), int((truth > 0).sum())]
        terms, pixels = terms + own, pixels + pair
        result[name] = {"AQ": sum(own) / len(own), "SQ": halved_recall(*pair), "gt_tracks": len(own)}
        result[name] |= {"intersection": [pair[0], 0], "union": [pair[1], pair[1] - pair[0]]}
    aq, sq = sum(terms) / len(terms), halved_recall(*pixels)
    total = {"AQ": aq, "SQ": sq, "STQ": math.sqrt(aq * sq)}
    both, labelled = (int(count) for count in pixels)
    return total | {"intersection": [both, 0], "union": [labelled, labelled - both], "videos": result}


def halved_recall(both, labelled):
    """The authors' SQ is the mean IoU of two classes, and the background's IoU is 0 as soon as a labelled pixel is
    missed."""
    return float(both / labelled / (2 if both < labelled else 1))


def merged(there, made, tolerance, where, write):
    """Compares the computed values with the stored ones, key by key, and replaces them if `write`."""
    for key, value in made.items():
        at = f"{where}.{key}"
        if isinstance(value, dict):
            merged(there.setdefault(key, {}) if write else there[key], value, tolerance, at, write)
        elif write:
            there[key] = value
        elif key in there and not numpy.allclose(*(numpy.array(x, float) for x in (there[key], value)), 0, tolerance, True):
            raise SystemExit(f"{at}: {there[key]} is stored, {value} is computed")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    folders = sorted(path for path in (arguments.data / "stq").iterdir() if path.is_dir())
    every = {folder.name: read(folder) for folder in folders}
    videos = {name: video for name, video in every.items() if name.startswith("v")}
    excluded = {name: (t, numpy.where(t > 0, p, 0)) for name, (t, p) in videos.items()}
    extra = {name: video for name, video in every.items() if name not in videos}

    def fits(frames, length):
        return range(0, frames - length + 1, STEP)

    def authors(frames, _):
        return range(0, max(frames - STEP, 0), STEP)

    def by_id(prediction, start, length):
        return tubes(prediction[start : start + length])

    def without_ids(prediction, start, length):
        return linked(prediction[start : start + length])

    strict = {"use_f_score": False, "is_hit": lambda iou: iou > 0.5}
    loose = {"use_f_score": True, "is_hit": lambda iou: iou > 0}
    made = {
        "vsq/expected.json": {
            "variants": {
                "void_counted/full_windows/iou_gt_0.5": vsq(videos, fits, by_id, **strict),
                "void_excluded/full_windows/iou_gt_0.5": vsq(excluded, fits, by_id, **strict),
            }
        },
        "vsq/authors_protocol.json": {
            "vsq": {
                "ids": vsq(videos, authors, by_id, **loose),
                "no_ids": vsq(videos, authors, without_ids, **loose),
            },
            "stq": {"ids": authors_stq(videos, tubes), "no_ids": authors_stq(videos, linked)},
        },
        "stq/expected.json": {
            "void_counted": strict_stq(videos),
            "void_excluded": strict_stq(excluded),
            "extra_void_counted": strict_stq(extra),
        },
    }
    for name, values in made.items():
        path = arguments.data / name
        there = json.loads(path.read_text())
        # The authors' code and deeplab2 sum in float32.
        merged(there, values, 1e-6 if "authors" in name else 1e-9, name, arguments.write)
        if arguments.write:
            path.write_text(json.dumps(there, indent=1) + "\n")
        print(f"{name}: {'written' if arguments.write else 'agrees'}")


if __name__ == "__main__":
    main()
