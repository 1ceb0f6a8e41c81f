#!/usr/bin/env python3
"""Makes `crates/metrics/tests/data/instances.json`: 3D instances with the scores of ScanNet's own script.

    git clone https://github.com/ScanNet/ScanNet
    pip install numpy plyfile imageio             # in a virtual environment with Python 3.12 or older, for lib2to3
    python tools/make_instance_test_data.py ScanNet crates/metrics/tests/data/instances.json

The scenes are random: instances with sizes around the minimum, unlabelled ground, predictions that split, merge,
repeat, miss and overlap them, and equal confidences. The script is run unchanged except for porting to Python 3 and
NumPy 2. All instances are labelled as chairs, so that there is one class.
"""

import argparse
import itertools
import json
import lib2to3.refactor
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy

CHAIR = 5
SCRIPTS = ["3d_evaluation/evaluate_semantic_instance.py", "util.py", "util_3d.py"]
RENAMED = [("np.float ", "float "), ("np.bool ", "bool "), ("np.in1d", "np.isin")]


def ported(scannet, folder):
    """Ports the scripts to current Python; returns the one to run."""
    fixers = lib2to3.refactor.get_fixers_from_package("lib2to3.fixes")
    tool = lib2to3.refactor.RefactoringTool(fixers)
    for name in SCRIPTS:
        text = str(tool.refactor_string((scannet / "BenchmarkScripts" / name).read_text() + "\n", name))
        for old, new in RENAMED:
            text = text.replace(old, new)
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return folder / SCRIPTS[0]


def truth(rng):
    """Random runs of vertices: id and length."""
    sizes = rng.choice([60, 99, 100, 101, 150, 300, 700], size=rng.integers(3, 9))
    runs = []
    for number, size in enumerate(sizes, start=1):
        runs += [[number, int(size)], [0, int(rng.choice([0, 40, 200]))]]
    return runs


def predictions(rng, runs):
    """Confidence and vertex ranges of each prediction."""
    starts = numpy.concatenate([[0], numpy.cumsum([count for _, count in runs])])
    spans = [(int(start), int(end)) for start, end in itertools.pairwise(starts) if end > start]
    count, found = int(starts[-1]), []
    for start, end in spans:
        kind = rng.choice(
            ["exact", "shifted", "half", "twice", "wide", "none", "same"], p=[0.2, 0.25, 0.1, 0.15, 0.1, 0.1, 0.1]
        )
        length = end - start
        shift = int(rng.integers(-length // 2, length // 2 + 1))
        ranges = {
            "exact": [[(start, end)]],
            "shifted": [[(start + shift, end + shift)]],
            "half": [[(start, start + length // 2)]],
            "twice": [[(start, end)], [(start + length // 10, end)]],
            "wide": [[(start - 150, end + 150)]],
            "none": [],
            "same": [[(start, end)], [(start, end)]],
        }[str(kind)]
        found += ranges
    if len(spans) > 1:
        found.append([spans[0], spans[-1]])
    found.append([(count // 3, count // 3 + 120)])
    confidences = rng.choice([0.2, 0.5, 0.5, 0.75, 0.9, 1.0], size=len(found))
    clipped = [[[max(0, a), min(count, b)] for a, b in ranges if min(count, b) > max(0, a)] for ranges in found]
    pairs = zip(confidences, clipped, strict=True)
    return [{"confidence": float(confidence), "ranges": ranges} for confidence, ranges in pairs if ranges]


def official(script, scenes):
    """AP, AP50 and AP25 of the scenes, percent; None if there is no true instance."""
    with tempfile.TemporaryDirectory() as folder:
        gt, pred = Path(folder) / "gt", Path(folder) / "pred"
        gt.mkdir()
        (pred / "masks").mkdir(parents=True)
        for number, scene in enumerate(scenes):
            ids = numpy.concatenate([numpy.full(count, CHAIR * 1000 + id if id else 0) for id, count in scene["truth"]])
            (gt / f"{number}.txt").write_text("".join(f"{id}\n" for id in ids))
            lines = []
            for index, prediction in enumerate(scene["predictions"]):
                mask = numpy.zeros(len(ids), int)
                for start, end in prediction["ranges"]:
                    mask[start:end] = 1
                name = f"masks/{number}_{index}.txt"
                (pred / name).write_text("".join(f"{inside}\n" for inside in mask))
                lines.append(f"{name} {CHAIR} {prediction['confidence']}\n")
            (pred / f"{number}.txt").write_text("".join(lines))
        out = Path(folder) / "scores.txt"
        command = [sys.executable, script, "--pred_path", pred, "--gt_path", gt, "--output_file", out]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        row = next(line for line in out.read_text().splitlines() if line.startswith("chair,"))
        return [None if value == "nan" else 100 * float(value) for value in row.split(",")[2:]]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("scannet", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--sets", type=int, default=40, help="number of sets of one to three scenes scored together")
    arguments = parser.parse_args()
    rng = numpy.random.default_rng(0)
    sets = []
    with tempfile.TemporaryDirectory() as folder:
        script = ported(arguments.scannet, Path(folder))
        for _ in range(arguments.sets):
            scenes = []
            for _ in range(rng.integers(1, 4)):
                runs = truth(rng)
                scenes.append({"truth": runs, "predictions": predictions(rng, runs)})
            sets.append({"scenes": scenes, "scores": official(script, scenes)})
    arguments.out.write_text("[\n" + ",\n".join(json.dumps(entry) for entry in sets) + "\n]\n")


if __name__ == "__main__":
    main()
