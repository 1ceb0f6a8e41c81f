"""Upper bound for better ids: AQ of a run, and AQ of the same segments with perfect ids.

    splatseg run kitchen-dev --resize 320x240 --crop-border 5 --out OUT
    python tools/association_limit.py kitchen-dev OUT --resize 320x240 --crop-border 5

With perfect ids, every segment of every frame has the id of the true object that it covers most. The remaining loss
comes from the segments: merged objects and inaccurate outlines. Unlabelled ground is excluded, as with `bench
--exclude-void`. Needs numpy and Pillow.
"""

import argparse
from collections import Counter
from pathlib import Path

import numpy as np
from PIL import Image


def frames(folder):
    """The images of a folder, by frame number."""
    return {int(path.stem): path for path in folder.glob("*.png")}


def labels(path, size, border):
    """The true ids of a frame, at the size of the run; 0 where unlabelled."""
    image = Image.open(path)
    pixels = np.array(image.resize(size, Image.NEAREST) if size else image).astype(int)
    return pixels[border : pixels.shape[0] - border, border : pixels.shape[1] - border]


def association_quality(true_areas, areas, shared):
    """AQ of STEP: for each true track, the IoUs with predicted tracks, weighted by the overlap."""
    sums = Counter()
    for (true, predicted), both in shared.items():
        sums[true] += both * both / (true_areas[true] + areas[predicted] - both)
    return sum(sums[true] / area for true, area in true_areas.items()) / len(true_areas)


def scene_and_run(description):
    """The arguments of a tool that compares a run with its scene."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="a folder in ScanNet's layout, with instance-filt/")
    parser.add_argument("run", type=Path, help="the output folder of `splatseg run`")
    parser.add_argument("--resize", type=image_size, help="as given to the run, e.g. 320x240")
    parser.add_argument("--crop-border", type=int, default=0, help="as given to the run")
    return parser.parse_args()


def image_size(text):
    """Parses `320x240` to a pair."""
    width, height = text.split("x")
    return int(width), int(height)


def main():
    arguments = scene_and_run(__doc__)
    true_areas, ids, perfect = Counter(), (Counter(), Counter()), (Counter(), Counter())
    found = frames(arguments.run / "segments")
    for number, path in sorted(frames(arguments.scene / "instance-filt").items()):
        if number not in found:
            continue
        truth = labels(path, arguments.resize, arguments.crop_border)
        seen = np.array(Image.open(found[number])).astype(int)
        true_areas.update(Counter(truth[truth > 0].tolist()))
        both = (truth > 0) & (seen > 0)
        pairs = Counter(zip(truth[both].tolist(), seen[both].tolist()))
        areas, owners = Counter(), {}
        for (true, segment), count in sorted(pairs.items()):
            areas[segment] += count
            if count > pairs.get((owners.get(segment), segment), 0):
                owners[segment] = true
        ids[0].update(areas)
        ids[1].update(pairs)
        for segment, area in areas.items():
            perfect[0][owners[segment]] += area
        for (true, segment), count in pairs.items():
            perfect[1][true, owners[segment]] += count
    print(f"AQ {100 * association_quality(true_areas, *ids):.1f}")
    print(f"AQ with perfect ids {100 * association_quality(true_areas, *perfect):.1f}")


if __name__ == "__main__":
    main()
