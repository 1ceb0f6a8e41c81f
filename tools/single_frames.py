"""VSQ of single frames (k = 1) over every frame of a run, instead of every fifteenth as in the protocol.

    splatseg run kitchen-dev --resize 320x240 --crop-border 5 --out OUT
    python tools/single_frames.py kitchen-dev OUT --resize 320x240 --crop-border 5

Segments and true objects are matched as in protocol `paper`: by F-score, with any overlap. Unlabelled ground is
excluded. Needs numpy, Pillow and SciPy.
"""

import sys

import numpy as np
from association_limit import frames, labels, scene_and_run
from PIL import Image
from scipy.optimize import linear_sum_assignment


def match(truth, seen):
    """Sum of IoUs, matched pairs, segments and true objects of one frame."""
    seen = np.where(truth > 0, seen, 0)
    objects, true_areas = np.unique(truth[truth > 0], return_counts=True)
    segments, areas = np.unique(seen[seen > 0], return_counts=True)
    shared = np.zeros((len(objects), len(segments)))
    both = seen > 0
    np.add.at(shared, (np.searchsorted(objects, truth[both]), np.searchsorted(segments, seen[both])), 1)
    sums = true_areas[:, None] + areas[None]
    pairs = linear_sum_assignment(-2 * shared / sums)
    ious = (shared / (sums - shared))[pairs]
    return np.array([ious.sum(), np.count_nonzero(ious), len(segments), len(objects)])


def main():
    arguments = scene_and_run(__doc__)
    found = frames(arguments.run / "segments")
    truths = {number: path for number, path in frames(arguments.scene / "instance-filt").items() if number in found}
    if not truths:
        sys.exit(f"no frame of {arguments.scene / 'instance-filt'} is among those of {arguments.run / 'segments'}")
    sums = sum(
        match(labels(path, arguments.resize, arguments.crop_border), np.array(Image.open(found[number])).astype(int))
        for number, path in truths.items()
    )
    iou, matched, segments, objects = sums / len(truths)
    print(f"VSQ of {len(truths)} single frames: {100 * iou / (0.5 * (segments + objects)):.1f}")
    print(f"per frame: {segments:.1f} segments, {objects:.1f} true objects, {matched:.1f} matched")


if __name__ == "__main__":
    main()
