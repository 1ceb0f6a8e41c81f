#!/usr/bin/env python3
"""Makes `crates/metrics/tests/data/trajectories.json`: pairs of trajectories with the errors that `evo` computes.

    pip install evo==1.38.1 numpy       # in a virtual environment
    python tools/make_trajectory_test_data.py crates/metrics/tests/data/trajectories.json

The trajectories are random walks, with the difficulties of real ones: other world coordinates, drift, gaps, other rates,
shifted stamps, unsorted and repeated stamps, few poses, straight lines. The commands `evo_ape` and `evo_rpe` are run on
their files; where they refuse, the result is null. Statistics of the rotation are in degrees, the others in metres.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy

STATISTICS = ["rmse", "mean", "median", "std", "min", "max"]
RATE = 30.0


def quaternion(vector):
    """The quaternion (x, y, z, w) of a rotation vector."""
    angle = numpy.linalg.norm(vector)
    axis = vector / angle if angle > 0 else vector
    return numpy.append(axis * numpy.sin(angle / 2), numpy.cos(angle / 2))


def product(left, right):
    """The product of two quaternions (x, y, z, w)."""
    vector = left[3] * right[:3] + right[3] * left[:3] + numpy.cross(left[:3], right[:3])
    return numpy.append(vector, left[3] * right[3] - left[:3] @ right[:3])


def turned(rotation, vector):
    """The vector after the rotation."""
    inverse = rotation * [-1, -1, -1, 1]
    return product(product(rotation, numpy.append(vector, 0.0)), inverse)[:3]


def walk(rng, count, start=0.0, step=0.02, turn=0.03):
    """A random walk: one row per pose, `seconds tx ty tz qx qy qz qw`."""
    velocity, spin = rng.normal(size=3) * step, rng.normal(size=3) * turn
    position, rotation, rows = rng.normal(size=3), quaternion(rng.normal(size=3)), []
    for index in range(count):
        rows.append([start + index / RATE, *position, *rotation])
        velocity += rng.normal(size=3) * step * 0.3
        spin += rng.normal(size=3) * turn * 0.3
        position = position + velocity
        rotation = product(rotation, quaternion(spin))
    return numpy.array(rows)


def disturbed(rng, rows, metres=0.005, radians=0.005):
    """The trajectory with drift."""
    out, offset, turn = rows.copy(), numpy.zeros(3), numpy.array([0.0, 0.0, 0.0, 1.0])
    for row in out:
        offset = offset + rng.normal(size=3) * metres
        turn = product(turn, quaternion(rng.normal(size=3) * radians))
        row[1:4] += offset
        row[4:] = product(row[4:], turn)
    return out


def moved(rng, rows, metres=5.0):
    """The trajectory in other world coordinates."""
    turn, shift, out = quaternion(rng.normal(size=3) * 2), rng.normal(size=3) * metres, rows.copy()
    for row in out:
        row[1:4] = turned(turn, row[1:4]) + shift
        row[4:] = product(turn, row[4:])
    return out


def straight(count, direction):
    """A straight path without rotation."""
    return numpy.array([[index / RATE, *(numpy.array(direction) * index), 0, 0, 0, 1] for index in range(count)])


def shifted(rows, seconds):
    """The trajectory with other stamps."""
    return rows + numpy.outer(numpy.broadcast_to(seconds, len(rows)), [1, 0, 0, 0, 0, 0, 0, 0])


def cases(rng):
    """Name, frames of the relative error, true and estimated trajectory."""
    yield "identical", 30, *[walk(rng, 35)] * 2
    truth = walk(rng, 50)
    yield "drift", 30, truth, disturbed(rng, truth)
    truth = walk(rng, 40)
    yield "other world", 10, truth, moved(rng, disturbed(rng, truth))
    yield "unrelated", 7, walk(rng, 30), walk(rng, 30)
    truth = walk(rng, 40, start=1305031102.1753)
    keep = numpy.sort(rng.choice(40, size=25, replace=False))
    yield "gaps", 5, truth, moved(rng, disturbed(rng, truth))[keep]
    yield "longer estimate", 5, truth[keep], moved(rng, disturbed(rng, truth))
    truth = walk(rng, 40)
    yield "shifted stamps", 3, truth, shifted(disturbed(rng, truth), rng.uniform(-0.0125, 0.0125, size=40))
    yield "between stamps", 3, truth, shifted(disturbed(rng, truth)[:-1], 1 / 60 - 0.008)
    fast = walk(rng, 90, step=0.005)
    fast[:, 0] /= 5
    yield "other rates", 4, fast, shifted(disturbed(rng, fast)[2::7], 0.0021)
    truth = walk(rng, 20)
    yield "unsorted estimate", 4, truth, disturbed(rng, truth)[rng.permutation(20)]
    yield "unsorted truth", 4, truth[rng.permutation(20)], disturbed(rng, truth)[:15]
    twice = numpy.repeat(disturbed(rng, truth), 2, axis=0)
    twice[1::2, 1:4] += 0.1
    yield "repeated stamps", 4, twice, truth
    yield "one pose for two", 2, truth, shifted(numpy.repeat(twice[:14:2], 2, axis=0), numpy.tile([-0.004, 0.005], 7))
    far = walk(rng, 30) + [0, 500000, 5400000, 120, 0, 0, 0, 0]
    yield "map projection", 10, far, moved(rng, disturbed(rng, far))
    flat = walk(rng, 30) * [1, 1, 1, 0, 1, 1, 1, 1]
    yield "in a plane", 10, flat, moved(rng, disturbed(rng, flat))
    mirrored = flat * [1, -1, 1, 1, 1, 1, 1, 1]
    yield "mirrored", 10, walk(rng, 30), disturbed(rng, mirrored)
    turn = walk(rng, 25, step=0.1, turn=0.5)
    yield "large angles", 6, turn, disturbed(rng, turn, metres=0.5, radians=0.8)
    few = walk(rng, 4)
    yield "too few for relative errors", 4, few, disturbed(rng, few)
    yield "enough for one relative error", 3, few, disturbed(rng, few)
    yield "three poses", 1, few[:3], disturbed(rng, few)[:3]
    yield "two poses", 1, few[:2], disturbed(rng, few)[:2]
    yield "one pose", 1, few[:1], disturbed(rng, few)[:1]
    yield "no pairs", 1, truth, shifted(truth, 100.0)
    yield "straight line", 5, straight(20, [0.25, 0, 0]), straight(20, [0, 0.25, 0])
    yield "at rest", 5, straight(20, [0, 0, 0]), truth


def statistics(folder, command, *options):
    """The statistics that an `evo` command prints; None if it refuses."""
    saved = folder / "result.zip"
    saved.unlink(missing_ok=True)
    program = Path(sys.executable).with_name(command)
    arguments = [program, "tum", folder / "truth.txt", folder / "estimate.txt", *options, "--save_results", saved]
    environment = {**os.environ, "HOME": str(folder)}
    done = subprocess.run(arguments, check=False, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    if not saved.exists():
        print(f"{command} refuses: {done.stderr.decode().strip().splitlines()[-1:]}")
        return None
    with zipfile.ZipFile(saved) as archive:
        found = json.loads(archive.read("stats.json"))
        errors = "error_array.npy"
        with archive.open(errors) as file:
            count = len(numpy.load(file))
    return {"count": count, **{name: found[name] for name in STATISTICS}}


def lines(rows):
    """The trajectory as TUM lines, rounded. The rounded trajectory is the one that is compared."""
    return [" ".join(f"{number:.6f}".rstrip("0").rstrip(".") for number in row) for row in rows]


def scored(name, frames, truth, estimate):
    """A case with the results of `evo`."""
    case = {"name": name, "rpe_frames": frames, "truth": lines(truth), "estimate": lines(estimate)}
    with tempfile.TemporaryDirectory() as path:
        folder = Path(path)
        for part in ["truth", "estimate"]:
            (folder / f"{part}.txt").write_text("".join(f"{line}\n" for line in case[part]))
        case["ate_m"] = statistics(folder, "evo_ape", "-a")
        relative = ["-d", str(frames), "-u", "f", "--all_pairs"]
        case["rpe_m"] = statistics(folder, "evo_rpe", *relative)
        case["rpe_deg"] = statistics(folder, "evo_rpe", *relative, "-r", "angle_deg")
    return case


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    found = [scored(*case) for case in cases(numpy.random.default_rng(0))]
    arguments.out.write_text("[\n" + ",\n".join(json.dumps(case) for case in found) + "\n]\n")


if __name__ == "__main__":
    main()
