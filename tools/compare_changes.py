"""Scores the changes that `splatseg` finds between two visits of a synthetic room against the true ones.

    python tools/compare_changes.py target/release/splatseg target/release/examples/true_changes --seeds 20

The second visit starts elsewhere and takes another path. A change is right if its kind is and its place is within
0.25 m: of twins, either may be named. Everything else that is found is invented.
"""

import argparse
import json
import math
import subprocess
import tempfile
from pathlib import Path


class UnsuitableRoom(Exception):
    """The room of this seed has too few things that can be changed."""


def run(*command):
    ended = subprocess.run([str(part) for part in command], check=False, capture_output=True, text=True)
    if "enough clearly visible things to change" in ended.stderr:
        raise UnsuitableRoom
    if ended.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}: {ended.stderr}")
    return ended.stdout


def found_changes(changes):
    """(kind, place) of each change; a move is its old and its new place."""
    for kind in ("gone", "new"):
        for entry in changes[kind]:
            yield kind, [entry["shape"]["oriented_box"]["center"]]
    for entry in changes["moved"]:
        yield "moved", [entry[side]["shape"]["oriented_box"]["center"] for side in ("before", "after")]


def true_changes(changes):
    for change in changes:
        yield change["kind"], [change[side] for side in ("before", "after") if change[side]]


def agree(one, other):
    return one[0] == other[0] and all(math.dist(a, b) < 0.25 for a, b in zip(one[1], other[1], strict=True))


def score(arguments, seed, folder):
    scene = f"synthetic:frames={arguments.frames},speed={arguments.speed},seed={seed},noise={arguments.noise}"
    options = ["--segmenter", arguments.segmenter, "--poses", arguments.poses, "--overwrite", "--no-page"]
    before, after = folder / "before.ply", folder / "after.ply"
    run(arguments.program, "run", f"{scene},visit=before", "--out", folder / "before", "--save-memory", before, *options)
    run(
        arguments.program, "run", f"{scene},visit=after", "--out", folder / "after", "--load-memory", before,
        "--save-memory", after, *options,
    )  # fmt: skip
    found = list(found_changes(json.loads((folder / "after" / "changes.json").read_text())))
    truth = list(true_changes(json.loads(run(arguments.truth, f"{scene},visit=after"))))
    right, missed, rest = 0, [], list(found)
    for change in truth:
        match = next((other for other in rest if agree(change, other)), None)
        if match:
            rest.remove(match)
            right += 1
        else:
            missed.append(change)
    return len(truth), right, missed, rest


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("truth", type=Path)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--frames", type=int, default=240)
    parser.add_argument("--speed", default="0.2")
    parser.add_argument("--noise", default="none")
    parser.add_argument("--segmenter", default="oracle")
    parser.add_argument("--poses", default="track")
    arguments = parser.parse_args()
    total = all_right = invented = 0
    for seed in range(arguments.first, arguments.first + arguments.seeds):
        with tempfile.TemporaryDirectory() as folder:
            try:
                count, right, missed, rest = score(arguments, seed, Path(folder))
            except UnsuitableRoom:
                print(f"seed {seed}: left out, too few things can be changed in this room", flush=True)
                continue
        total, all_right, invented = total + count, all_right + right, invented + len(rest)
        described = [f"{kind} {[[round(x, 2) for x in place] for place in places]}" for kind, places in missed]
        others = [f"{kind} {[[round(x, 2) for x in place] for place in places]}" for kind, places in rest]
        print(f"seed {seed}: {right} of {count}; missed {described}; invented {others}", flush=True)
    print(f"{all_right} of {total} changes found ({100 * all_right / total:.1f} %), {invented} invented")


if __name__ == "__main__":
    main()
