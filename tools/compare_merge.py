"""Scores `splatseg merge` on the two halves of videos: ids against true ones, poses of keyframes against true ones.

    python tools/compare_merge.py target/release/splatseg --data ../shared/data

Each half is a run of its own. A tracked one reads a copy of the scene without poses, so that it has its own world. Of the
things that both halves show, those count that have an id in both: most of their pixels have it, and it means them more than
any other thing. They are united if the two ids are one in the merged map. Truth: the labels of the scene, and the ids of a
run over the whole video (`whole`). A union is wrong if the two halves mean different things by it.
"""

import argparse
import json
import re
import subprocess
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

MIN_PIXELS = 1000
"""Pixels of a thing in each half, at 320x240 in all frames."""


@dataclass
class Case:
    name: str
    scene: str
    half: int
    labels: str | None
    labels_every: int = 1


CASES = [
    Case("redkitchen_dense", "redkitchen_dense", 150, "kitchen-dev", 10),
    Case("kitchen-dev", "kitchen-dev", 25, "kitchen-dev"),
    Case("rooms/dev-a", "rooms/dev-a", 40, "rooms/dev-a"),
    Case("rooms/dev-b", "rooms/dev-b", 40, "rooms/dev-b"),
    # Not used to choose anything.
    Case("hololens-dev", "hololens-dev", 47, "hololens-dev"),
]


def run(*command):
    ended = subprocess.run([str(part) for part in command], check=False, capture_output=True, text=True)
    if ended.returncode:
        raise SystemExit(f"{' '.join(map(str, command))}: {ended.stderr}")
    return ended.stdout


def state(path):
    """The arrays that a saved map has besides its Gaussians."""
    data = path.read_bytes()
    length = int(re.search(rb"splatseg memory 5 .* state (\d+)\n", data)[1])
    block = data[len(data) - 4 - length : -4]
    size = int.from_bytes(block[:8], "little")
    types = {
        "F64": "<f8",
        "F32": "<f4",
        "U32": "<u4",
        "U8": "u1",
        "I64": "<i8",
        "U64": "<u8",
        "I16": "<i2",
        "I32": "<i4",
    }
    arrays = {}
    for name, entry in json.loads(block[8 : 8 + size]).items():
        if name != "__metadata__":
            start, end = (8 + size + offset for offset in entry["data_offsets"])
            arrays[name] = np.frombuffer(block[start:end], types[entry["dtype"]]).reshape(entry["shape"])
    return arrays


def keyframes(path):
    """Numbers and poses of a map's keyframes."""
    arrays = state(path)
    return arrays["keyframes.id"], arrays["keyframes.world_from_camera"]


def id_images(folder):
    return {int(re.findall(r"\d+", path.stem)[-1]): path for path in (folder / "segments").glob("*.png")}


def pixels(path, size):
    return np.asarray(Image.open(path).resize(size, Image.NEAREST), np.int64).ravel()


class Half:
    """A run over half of a video."""

    def __init__(self, program, scene, options, folder, name):
        self.map, self.out, self.name = folder / f"{name}.ply", folder / name, name
        if not self.map.exists():
            run(
                program,
                "run",
                scene,
                "--out",
                self.out,
                "--save-memory",
                self.map,
                "--no-page",
                "--overwrite",
                *options,
            )
        self.images = id_images(self.out)

    def ids_of(self, truth):
        """The id that most pixels of each true thing have, and the thing that each id is, from images by frame."""
        counts, totals = Counter(), Counter()
        for frame, path in self.images.items():
            if frame in truth:
                found = np.asarray(Image.open(path), np.int64)
                pairs = np.stack([pixels(truth[frame], found.shape[::-1]), found.ravel()])
                values, numbers = np.unique(pairs[:, pairs[0] > 0], axis=1, return_counts=True)
                for (thing, id_), number in zip(values.T.tolist(), numbers.tolist(), strict=True):
                    counts[thing, id_] += number
                    totals[thing] += number
        of_things = {
            thing: id_
            for (thing, id_), number in counts.items()
            if id_ and totals[thing] >= MIN_PIXELS and 2 * number > totals[thing]
        }
        of_ids = {}
        for (thing, id_), _ in sorted(counts.items(), key=lambda entry: entry[1]):
            of_ids[id_] = thing
        return of_things, of_ids

    def true_poses(self, poses):
        """True poses of the keyframes in the map, by number: those of the frames with the pose nearest to theirs."""
        numbers, found = keyframes(self.map)
        lines = np.loadtxt(self.out / "poses.txt")
        times = np.array([line[0] for line in lines])
        frames = np.rint(times * 30).astype(int)
        of_keyframes = {}
        for number, pose in zip(numbers.tolist(), found, strict=True):
            distances = np.linalg.norm(lines[:, 1:4] - pose[:3, 3], axis=1) + rotations_apart(
                lines[:, 4:8], pose[:3, :3]
            )
            of_keyframes[number] = poses[frames[int(distances.argmin())]]
        return of_keyframes


def rotations_apart(quaternions, rotation):
    x, y, z, w = quaternions.T
    trace = (
        (1 - 2 * (y * y + z * z)) * rotation[0, 0] + 2 * (x * y - z * w) * rotation[0, 1] + 2 * (x * z + y * w) * rotation[0, 2]
        + 2 * (x * y + z * w) * rotation[1, 0] + (1 - 2 * (x * x + z * z)) * rotation[1, 1] + 2 * (y * z - x * w) * rotation[1, 2]
        + 2 * (x * z - y * w) * rotation[2, 0] + 2 * (y * z + x * w) * rotation[2, 1] + (1 - 2 * (x * x + y * y)) * rotation[2, 2]
    )  # fmt: skip
    return np.arccos(np.clip((trace - 1) / 2, -1, 1))


def true_poses(scene):
    paths = list((scene / "pose").glob("*.txt")) or list(scene.glob("*.pose.txt"))
    poses = {int(re.findall(r"\d+", path.name)[0]): np.loadtxt(path).reshape(4, 4) for path in paths}
    # Frames without a true pose are not compared.
    return {index: poses[number] for index, number in enumerate(sorted(poses))}


def without_poses(scene, folder):
    """A copy of a scene without its poses."""
    for path in scene.rglob("*"):
        copy = folder / path.relative_to(scene)
        if path.is_file() and path.parent.name != "pose" and not path.name.endswith(".pose.txt") and not copy.exists():
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.symlink_to(path.resolve())
    return folder


def absolute_error(found, true):
    """Root mean square distance after the best rigid motion, metres."""
    found, true = np.array(found), np.array(true)
    a, b = found - found.mean(0), true - true.mean(0)
    u, _, v = np.linalg.svd(a.T @ b)
    rotation = (u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v).T
    return float(np.sqrt(((a @ rotation.T - b) ** 2).sum(1).mean()))


def united(halves, table, truth):
    """Things that both halves show, those that have one id in the merged map, and ids that mean different things."""
    ids = [half.ids_of(truth) for half in halves]
    now = [{}, {}]
    for row in table:
        for side, key in enumerate(("earlier", "later")):
            now[side].update((id_, row["id"]) for id_ in row[key])
    meant = [{thing for thing, id_ in of_things.items() if of_ids[id_] == thing} for of_things, of_ids in ids]
    both = sorted(meant[0] & meant[1])
    places = [[now[side].get(ids[side][0][thing]) for thing in both] for side in (0, 1)]
    same = [thing for thing, one, other in zip(both, *places, strict=True) if one is not None and one == other]
    wrong = 0
    for row in table:
        things = [
            {ids[side][1][id_] for id_ in row[key] if id_ in ids[side][1]}
            for side, key in enumerate(("earlier", "later"))
        ]
        wrong += bool(things[0] and things[1] and not things[0] & things[1])
    return both, same, wrong


def measure(program, data, case, poses, folder):
    scene = data / case.scene
    true, source = true_poses(scene), scene
    common = ["--resize", "320x240", "--poses", poses]
    folder = folder / f"{case.name.replace('/', '-')}-{poses}"
    folder.mkdir(parents=True, exist_ok=True)
    if poses == "track":
        source = without_poses(scene, folder / "scene")
    halves = [
        Half(program, source, [*common, "--max-frames", case.half], folder, "earlier"),
        Half(program, source, [*common, "--start", case.half], folder, "later"),
    ]
    whole = Half(program, source, common, folder, "whole")
    merged = folder / "merged.ply"
    ended = subprocess.run(
        [program, "merge", halves[0].map, halves[1].map, "--out", merged, "--overwrite", "--json"],
        check=False,
        capture_output=True,
        text=True,
    )
    if ended.returncode:
        refused = ended.stderr.strip().split(": ", 2)[-1]
        print(f"| {case.name}, {poses} | refused: {refused} | | | | |")
        return
    report = json.loads(ended.stdout)
    keys = report["keyframes"]
    recognised = f"{keys['later_recognised']} of {keys['later']}, {keys['earlier_recognised']} of {keys['earlier']}"
    row = [f"{case.name}, {poses}", recognised, f"{100 * keyframe_error(halves, merged, true):.2f}"]
    truths = [whole.images]
    if case.labels:
        images = (data / case.labels / "instance-filt").glob("*.png")
        truths.append({int(path.stem) * case.labels_every: path for path in images})
    wrong = []
    for images in truths:
        both, same, wrong_unions = united(halves, report["objects"], images)
        row.append(f"{len(same)} of {len(both)}")
        wrong.append(str(wrong_unions))
    unions = sum(bool(entry["earlier"] and entry["later"]) for entry in report["objects"])
    print(f"| {' | '.join(row)} | {', '.join(wrong)} of {unions} |")


def keyframe_error(halves, merged, true):
    """Absolute error of the merged map's keyframes, metres."""
    first = json.loads(state(halves[0].map)["keyframes.state.json"].tobytes())["next"]
    of_halves = [half.true_poses(true) for half in halves]
    pairs = []
    for number, pose in zip(*keyframes(merged), strict=True):
        true_pose = of_halves[0][number] if number < first else of_halves[1][number - first]
        pairs.append((pose[:3, 3], true_pose[:3, 3]))
    return absolute_error(*zip(*pairs, strict=True))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=Path)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    parser.add_argument("--poses", nargs="+", default=["given", "track"])
    parser.add_argument("--only", nargs="+", help="scenes")
    parser.add_argument("--work", type=Path, help="folder that keeps the halves, for another time")
    arguments = parser.parse_args()
    print("| scene, poses | keyframes recognised | ATE, cm | united, whole | united, labels | wrong: whole, labels |")
    print("| --- | --- | ---: | ---: | ---: | ---: |")
    with tempfile.TemporaryDirectory() as temporary:
        for case in CASES:
            if not arguments.only or case.name in arguments.only:
                for poses in arguments.poses:
                    measure(arguments.program, arguments.data, case, poses, arguments.work or Path(temporary))


if __name__ == "__main__":
    main()
