#!/usr/bin/env python3
"""Checks that two splatseg binaries give the same results, byte for byte.

    tools/compare_binaries.py OLD NEW [--shared ../shared] [--keep DIR] [--only NAME,...] [--new-args A=B ...]

Each case runs both binaries on the same input and compares the results that must not change:

  run cases    the id images (segments/*.png) and the saved memory (PLY), byte for byte;
  bench cases  results.csv, every column but the measured speeds, digit for digit.

If NEW has another name for an option or setting, `--new-args fastsam.image_size=segmenter.image_size` replaces the text
in NEW's arguments. Exit code: 0 the same, 1 different, 2 bad usage or a binary failed.
"""

import argparse
import csv
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FRAMING = ["--resize", "320x240", "--crop-border", "5"]
NET = ["--segmenter", "fastsam", "--weights", "{shared}/models/fastsam-rooms-n.pt", "--set", "fastsam.image_size=320",
       "--set", "fastsam.confidence=0.25", "--set", "fastsam.iou=0.7"]
ORACLE = ["--segmenter", "oracle", "--set", "oracle.preset=fastsam-like"]
METHODS = ["--methods", "fastsam,fastspam,fastsam-splat"]
KITCHEN = ["run", "{shared}/data/redkitchen", *FRAMING]
ROOM = ["bench", "--scenes", "{shared}/data/rooms/dev-a", *FRAMING]

# Arguments by name of the case. `--out` and, for run, `--save-memory` are added.
CASES = {
    "redkitchen-graph": KITCHEN,
    "redkitchen-net": [*KITCHEN, *NET, "--max-frames", "30"],
    "redkitchen-features": [*KITCHEN, "--set", "memory.kind=features", "--max-frames", "20"],
    "dev-a-net": [*ROOM, *NET, *METHODS],
    "dev-a-graph": [*ROOM, "--segmenter", "graph", *METHODS],
    "dev-a-oracle": [*ROOM, *ORACLE, *METHODS],
    "dev-a-sim-tracker": [*ROOM, *ORACLE, "--methods", "sam2,sam2-splat", "--tracker", "sim"],
}
# Columns of results.csv that are measured times.
SPEEDS = {"fps_total", "fps_without_segmenter"}
# Columns that identify a row.
ROW_KEYS = ["scene", "method", "variant", "seed"]


class Failed(Exception):
    """A binary failed."""


def run_case(binary, arguments, out):
    """Runs the binary with `--out out`; returns the time in seconds."""
    memory = ["--save-memory", str(out.with_suffix(".ply"))] if arguments[0] == "run" else []
    command = [str(binary), *arguments, "--out", str(out), *memory]
    start = time.monotonic()
    finished = subprocess.run(command, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if finished.returncode != 0:
        raise Failed(f"{' '.join(command)}\n  ended with {finished.returncode}: {finished.stderr.strip()[-2000:]}")
    return time.monotonic() - start


def compare_run(old, new):
    """Compares two folders of `run`; returns a summary and the differences."""
    def names(out):
        return {path.name for path in (out / "segments").iterdir()}

    differences = [f"segments/{name}: only in one of the two" for name in sorted(names(old) ^ names(new))]
    common = sorted(names(old) & names(new))
    differences += [f"segments/{name}: other bytes" for name in common
                    if (old / "segments" / name).read_bytes() != (new / "segments" / name).read_bytes()]
    if not common:
        differences.append("no id images to compare")
    if old.with_suffix(".ply").read_bytes() != new.with_suffix(".ply").read_bytes():
        differences.append("saved memory (PLY): bytes differ")
    return f"{len(common)} id images, PLY", differences


def compare_bench(old, new):
    """Compares two folders of `bench`; returns a summary and the differences."""
    def rows(out):
        with open(out / "results.csv", newline="") as file:
            return {tuple(row[key] for key in ROW_KEYS): row for row in csv.DictReader(file)}

    old, new = rows(old), rows(new)
    differences = [f"row {key}: only in one of the two" for key in sorted(old.keys() ^ new.keys())]
    compared = 0
    for key in sorted(old.keys() & new.keys()):
        for column in old[key].keys() - SPEEDS:
            compared += 1
            if old[key][column] != new[key].get(column):
                differences.append(f"row {key}, {column}: {old[key][column]} and {new[key].get(column, 'no such column')}")
    if compared == 0:
        differences.append("no scores to compare")
    return f"{len(old)} rows, {compared} values", sorted(differences)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--shared", type=Path, default=Path(__file__).resolve().parents[2] / "shared",
                        help="folder with data/ and models/ (default: %(default)s)")
    parser.add_argument("--keep", type=Path, help="new folder in which the outputs are kept")
    parser.add_argument("--only", help="cases to run, of: " + ", ".join(CASES))
    parser.add_argument("--new-args", nargs="*", default=[], metavar="A=B", help="replace A by B in NEW's arguments")
    options = parser.parse_args()
    chosen = options.only.split(",") if options.only else list(CASES)
    if unknown := [name for name in chosen if name not in CASES]:
        parser.error(f"no case {', '.join(unknown)}; there are {', '.join(CASES)}")
    renames = [rename.partition("=")[::2] for rename in options.new_args]
    if any(not a or not b for a, b in renames):
        parser.error("--new-args takes A=B")

    with tempfile.TemporaryDirectory() as scratch:
        folder = options.keep or Path(scratch)
        (folder / "old").mkdir(parents=True)
        (folder / "new").mkdir()
        different = []
        for name in chosen:
            arguments = [argument.format(shared=options.shared) for argument in CASES[name]]
            renamed = arguments
            for a, b in renames:
                renamed = [argument.replace(a, b) for argument in renamed]
            old_out, new_out = folder / "old" / name, folder / "new" / name
            old_s = run_case(options.old, arguments, old_out)
            new_s = run_case(options.new, renamed, new_out)
            compare = compare_run if arguments[0] == "run" else compare_bench
            what, differences = compare(old_out, new_out)
            verdict = "the same" if not differences else f"DIFFERENT ({len(differences)})"
            print(f"{name}: {verdict} ({what}; {old_s:.1f} s and {new_s:.1f} s)", flush=True)
            for difference in differences[:10]:
                print(f"    {difference}", flush=True)
            if differences:
                different.append(name)
    print(f"all {len(chosen)} cases the same" if not different else f"different: {', '.join(different)}")
    return 1 if different else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (Failed, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
