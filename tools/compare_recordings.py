#!/usr/bin/env python3
"""Checks that a scene gives the same ids and poses in every format of recordings.

    pip install rosbags==0.11.9 mcap mcap-ros2-support numpy pillow        # in a virtual environment
    python tools/compare_recordings.py SPLATSEG SCENE [--folder DIR] [--only NAME,...]

SCENE has the layout of ScanNet, with ground truth, e.g. ../shared/data/kitchen-dev. It is written as

    db3, bag, mcap       by the package rosbags (tools/make_bag_test_data.py)
    transforms           nerfstudio's transforms.json, with the images beside it
    r3d                  Record3D
    converted            `splatseg convert SCENE`, and `splatseg convert` of each of the others: converted_db3 and so on

Each is run with the same settings and compared with SCENE: the share of pixels with equal ids, the largest difference of a
number in the matrices of poses.txt, and VSQ against the ground truth of SCENE. Limits: 99.9 % of the pixels and 1e-6, but
for r3d only 1 VSQ. With --lidar, only r3d is written, with depth of 256x192 pixels as a phone has it, and all is compared at
that size.
Exit code: 0 within the limits, 1 not, 2 bad usage or the program failed.
"""

import argparse
import json
import struct
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy
from make_bag_test_data import write_scene
from make_mcap_test_data import quaternion
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from PIL import Image

LEAST_EQUAL, MOST_APART, MOST_VSQ_APART = 0.999, 1e-6, 1.0
# Size of the depth of an iPhone's LiDAR.
LIDAR_SIZE = ["--resize", "256x192"]
# From axes x right, y down, z forward to OpenGL's.
OPENGL = numpy.diag([1.0, -1.0, -1.0, 1.0])


class Scene:
    """A scene in the layout of ScanNet."""

    def __init__(self, folder):
        self.folder = folder
        colors = sorted((int(path.stem), path) for path in (folder / "color").iterdir())
        self.colors = [path for _, path in colors]
        self.depths = [folder / f"depth/{stem}.png" for stem, _ in colors]
        self.poses = [numpy.loadtxt(folder / f"pose/{stem}.txt") for stem, _ in colors]
        self.k = numpy.loadtxt(folder / "intrinsic/intrinsic_color.txt")
        self.size = Image.open(self.colors[0]).size

    def metres(self, index):
        return numpy.asarray(Image.open(self.depths[index])).astype(numpy.float32) / 1000

    def to_y_up(self):
        """The rotation, 3x3, from its world to one whose y axis is up, as far as its cameras are upright."""
        up = -numpy.mean([pose[:3, 1] for pose in self.poses], axis=0)
        axis = int(numpy.abs(up).argmax())
        turn = numpy.zeros((3, 3))
        turn[1, axis] = numpy.sign(up[axis])
        turn[0, (axis + 1) % 3] = 1.0
        turn[2] = numpy.cross(turn[0], turn[1])
        return turn


def write_transforms(scene, folder):
    """Writes nerfstudio's list of frames, which counts the principal point from the image's corner."""
    folder.mkdir(parents=True, exist_ok=True)
    frames = []
    for index, (color, depth, pose) in enumerate(zip(scene.colors, scene.depths, scene.poses, strict=True)):
        names = [f"{index:06}{color.suffix}", f"{index:06}.png"]
        if names[0] == names[1]:
            names[1] = f"depth_{index:06}.png"
        for name, path in zip(names, [color, depth], strict=True):
            (folder / name).write_bytes(path.read_bytes())
        matrix = (pose @ OPENGL).tolist()
        frames.append({"file_path": names[0], "depth_file_path": names[1], "transform_matrix": matrix})
    k, (width, height) = scene.k, scene.size
    camera = {"fl_x": k[0, 0], "fl_y": k[1, 1], "cx": k[0, 2] + 0.5, "cy": k[1, 2] + 0.5, "w": width, "h": height}
    (folder / "transforms.json").write_text(json.dumps(camera | {"frames": frames}))
    return folder


def lzfse(data):
    """Wraps bytes as LZFSE, as a block that is not compressed."""
    return b"bvx-" + struct.pack("<I", len(data)) + data + b"bvx$"


def write_r3d(scene, path, depths=None):
    """Writes a file of Record3D: JPEG colour, depth in metres, poses with OpenGL's axes, the y axis of the world up.
    `depths` replaces the depth of the scene, in metres."""
    k, (width, height) = scene.k, scene.size
    turn = numpy.eye(4)
    turn[:3, :3] = scene.to_y_up()
    poses = []
    with zipfile.ZipFile(path, "w") as archive:
        for index, (color, pose) in enumerate(zip(scene.colors, scene.poses, strict=True)):
            matrix = turn @ pose @ OPENGL
            poses.append([*quaternion(matrix[:3, :3]), *matrix[:3, 3]])
            metres = depths[index] if depths else scene.metres(index)
            archive.writestr(f"rgbd/{index}.jpg", color.read_bytes())
            archive.writestr(f"rgbd/{index}.depth", lzfse(metres.astype("<f4").tobytes()))
            archive.writestr(f"rgbd/{index}.conf", lzfse(numpy.full(metres.shape, 2, numpy.uint8).tobytes()))
        size = {"w": width, "h": height, "dw": metres.shape[1], "dh": metres.shape[0]}
        columns = [k[0, 0], 0, 0, 0, k[1, 1], 0, k[0, 2], k[1, 2], 1]
        archive.writestr("metadata", json.dumps(size | {"fps": 30, "K": columns, "poses": poses}))
    return path


def resized_depths(program, scene, folder, size):
    """Depth in metres of all frames, as `--resize` makes it: a hole is filled by a measurement under the larger pixel."""
    path = folder / "resized.mcap"
    splatseg(program, "convert", scene.folder, path, "--overwrite", "--quiet", *size)
    depths = []
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for *_, image in reader.iter_decoded_messages(topics=["/camera/aligned_depth_to_color/image_raw"]):
            kind = {"16UC1": "<u2", "32FC1": "<f4"}[image.encoding]
            depth = numpy.frombuffer(bytes(image.data), kind).reshape(image.height, image.width)
            depths.append(depth.astype(numpy.float32) / (1000 if kind == "<u2" else 1))
    return depths


def splatseg(program, *arguments):
    finished = subprocess.run([program, *map(str, arguments)], check=False, capture_output=True, text=True)
    if finished.returncode != 0:
        print(f"{' '.join(map(str, arguments))} ended with {finished.returncode}: {finished.stderr[-1000:]}")
        sys.exit(2)
    return finished.stdout


def run(program, scene, out, *more):
    splatseg(program, "run", scene, "--out", out, "--overwrite", "--no-page", "--quiet", *more)
    images = [numpy.asarray(Image.open(path)).astype(numpy.int64) for path in sorted((out / "segments").iterdir())]
    lines = (out / "poses.txt").read_text().splitlines()
    # Times are those of each format.
    return images, [pose_of(line.split()[1:]) for line in lines if not line.startswith("#")]


def pose_of(numbers):
    """The matrix, 3x4, of a position and a quaternion x y z w."""
    *position, x, y, z, w = map(float, numbers)
    rotation = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return numpy.hstack([rotation, numpy.array(position)[:, None]])


def vsq(program, out, truth):
    return json.loads(splatseg(program, "eval", "--pred", out, "--gt", truth, "--allow-other-scene", "--json"))["vsq"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("scene", type=Path)
    parser.add_argument("--folder", type=Path, help="where the recordings are written and kept")
    parser.add_argument("--lidar", action="store_true", help="Record3D with depth of 256x192 pixels")
    parser.add_argument("--only", type=lambda text: text.split(","), help="names of formats")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        sys.exit(compare(arguments, folder))


def write(arguments, scene, folder):
    """Writes the recordings. Returns their paths by name."""
    if arguments.lidar:
        depths = resized_depths(arguments.program, scene, folder, LIDAR_SIZE)
        return {"lidar_r3d": write_r3d(scene, folder / "lidar.r3d", depths)}
    recordings = {name: folder / f"kitchen.{name}" for name in ("db3", "bag", "mcap")}
    if not recordings["bag"].exists():
        write_scene(folder, scene.folder)
    write_transforms(scene, folder / "transforms")
    write_r3d(scene, folder / "kitchen.r3d")
    recordings |= {"transforms": folder / "transforms", "r3d": folder / "kitchen.r3d"}
    for name, path in ({"": scene.folder} | recordings).items():
        converted = f"converted_{name}".rstrip("_")
        if arguments.only is None or converted in arguments.only:
            recordings[converted] = folder / f"{converted}.mcap"
            splatseg(arguments.program, "convert", path, recordings[converted], "--overwrite", "--quiet")
    return {name: path for name, path in recordings.items() if arguments.only is None or name in arguments.only}


def compare(arguments, folder):
    scene = Scene(arguments.scene)
    size = LIDAR_SIZE if arguments.lidar else []
    expected, poses = run(arguments.program, scene.folder, folder / "out_scene", *size)
    score = vsq(arguments.program, folder / "out_scene", scene.folder)
    print(f"{'format':<20} {'MB':>7} {'equal pixels':>13} {'poses apart':>12} {'VSQ':>7}")
    print(f"{'scene':<20} {'':>7} {'':>13} {'':>12} {score:7.2f}")
    is_good = True
    for name, path in write(arguments, scene, folder).items():
        out = folder / f"out_{name}"
        found, found_poses = run(arguments.program, path, out, *size)
        equal = numpy.mean([(one == other).mean() for one, other in zip(found, expected, strict=True)])
        turn = scene.to_y_up() if name.endswith("r3d") else numpy.eye(3)
        apart = numpy.abs(numpy.array(found_poses) - turn @ numpy.array(poses)).max()
        found_score = vsq(arguments.program, out, scene.folder)
        is_within = abs(found_score - score) <= MOST_VSQ_APART
        if not name.endswith("r3d"):
            is_within = is_within and equal >= LEAST_EQUAL and apart <= MOST_APART
        is_good = is_good and is_within
        files = [path] if path.is_file() else path.iterdir()
        megabytes = sum(file.stat().st_size for file in files) / 1e6
        line = f"{name:<20} {megabytes:7.1f} {100 * equal:12.3f}% {apart:12.1e} {found_score:7.2f}"
        print(line + ("" if is_within else "  BEYOND THE LIMITS"), flush=True)
    return 0 if is_good else 1


if __name__ == "__main__":
    main()
