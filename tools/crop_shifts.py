"""Scores of a scene at several crops, on the interior that they have in common, and how far adjacent crops differ.

    python tools/crop_shifts.py kitchen-dev --resize 320x240 --crops 0-12 -- --segmenter affinity

`bench --crop-border` also crops the ground truth, so its scores at two crops are of different pixels. Here the segments
of `splatseg run` at each crop are cut to the interior of the largest crop and scored there by `splatseg eval`, without
unlabelled pixels. Options after `--` go to `splatseg run`. Needs numpy and Pillow.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

SCORES = ("VSQ", "STQ", "single", "boundary F")


def crops(text):
    """Parses `0-12` or `0,5,7`."""
    first, _, last = text.partition("-")
    return list(range(int(first), int(last) + 1)) if last else [int(crop) for crop in text.split(",")]


def command(arguments, *words):
    """Runs splatseg with the scene's resizing."""
    resize = ["--resize", arguments.resize] if arguments.resize else []
    subprocess.run([arguments.program, *words, *resize], check=True, capture_output=True)


def score(arguments, crop, largest, folder):
    """Scores of one crop on the interior of the largest."""
    run, cut, result = folder / f"run-{crop}", folder / f"cut-{crop}", folder / f"{crop}.json"
    command(arguments, "run", arguments.scene, "--crop-border", str(crop), "--out", str(run), *arguments.options)
    cut.mkdir()
    for path in (run / "segments").glob("*.png"):
        ids = np.array(Image.open(path))
        inner = slice(largest - crop, crop - largest or None)
        Image.fromarray(ids[inner, inner]).save(cut / path.name)
    eval_options = ("--crop-border", str(largest), "--exclude-void", "--json", str(result))
    command(arguments, "eval", "--gt", arguments.scene, "--pred", str(cut), *eval_options)
    found = json.loads(result.read_text())
    frames = found["single_frames"]
    return np.array([found["vsq"], found["stq"], frames["quality"], frames["boundary_f"]])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--program", default="splatseg")
    parser.add_argument("--resize", help="as for the program, e.g. 320x240")
    parser.add_argument("--crops", type=crops, default=crops("0-12"), help="e.g. 0-12 or 0,5,7")
    given = sys.argv[1:]
    end = given.index("--") if "--" in given else len(given)
    arguments = parser.parse_args(given[:end], argparse.Namespace(options=given[end + 1 :]))
    with tempfile.TemporaryDirectory() as folder:
        rows = [score(arguments, crop, max(arguments.crops), Path(folder)) for crop in arguments.crops]
    print("crop  " + "  ".join(f"{name:>10}" for name in SCORES))
    for crop, row in zip(arguments.crops, rows):
        print(f"{crop:4}  " + "  ".join(f"{value:10.2f}" for value in row))
    print("mean  " + "  ".join(f"{value:10.2f}" for value in np.mean(rows, axis=0)))
    steps = np.abs(np.diff(rows, axis=0)).max(axis=0)
    print("greatest difference of adjacent crops: " + ", ".join(f"{n} {v:.2f}" for n, v in zip(SCORES, steps)))


if __name__ == "__main__":
    main()
