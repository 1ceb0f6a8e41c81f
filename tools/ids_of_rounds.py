"""Counts the objects that have the same id in both halves of a video, such as the two rounds of a rendered room.

    python tools/ids_of_rounds.py SCENE OUT

SCENE is a labelled scene in ScanNet's exported layout, OUT the results of `splatseg run`. An object counts if each half
shows at least 200 of its pixels in five frames or more. Its id is the one that most of its pixels have. Needs NumPy and
Pillow.
"""

import argparse
from collections import Counter, defaultdict
from pathlib import Path

import numpy as np
from PIL import Image

MIN_PIXELS = 200
MIN_FRAMES = 5


def ids_of_objects(frames):
    """The predicted ids of each true object, with their pixels, and the number of frames that show it."""
    ids, shown = defaultdict(Counter), Counter()
    for truth, predicted in frames:
        truth, predicted = np.asarray(Image.open(truth)), np.asarray(Image.open(predicted))
        for label, area in zip(*np.unique(truth, return_counts=True), strict=True):
            if label and area >= MIN_PIXELS:
                shown[label] += 1
                found, counts = np.unique(predicted[truth == label], return_counts=True)
                ids[label].update(dict(zip(found.tolist(), counts.tolist(), strict=True)))
    return {label: ids[label].most_common(1)[0][0] for label, frames in shown.items() if frames >= MIN_FRAMES}


def numbered(path):
    return int(path.stem.split("-")[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    truth = {numbered(path): path for path in (arguments.scene / "instance-filt").glob("*.png")}
    predicted = {numbered(path): path for path in (arguments.out / "segments").glob("*.png")}
    pairs = [(truth[number], predicted[number]) for number in sorted(truth.keys() & predicted.keys())]
    first, second = (ids_of_objects(half) for half in (pairs[: len(pairs) // 2], pairs[len(pairs) // 2 :]))
    both = sorted(first.keys() & second.keys())
    same = [label for label in both if first[label] == second[label] != 0]
    print(f"{len(same)} of {len(both)} objects ({100 * len(same) / max(len(both), 1):.1f} %) have the same id in both halves")
    for label in sorted(set(both) - set(same)):
        print(f"  object {label}: {first[label]}, then {second[label]}")
    merged = [ids for ids, count in Counter(first[label] for label in both).items() if ids and count > 1]
    print(f"{len(merged)} ids of the first half belong to several objects")


if __name__ == "__main__":
    main()
