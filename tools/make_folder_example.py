#!/usr/bin/env python3
"""Makes the example of the format `folder`: four frames of a rendered room, 160x120 pixels (docs/FOLDER_FORMAT.md).

Needs `pip install pillow numpy` and a scene in ScanNet's exported layout with 320x240 pixels:
    python tools/make_folder_example.py ../shared/data/rooms/dev-a [--folder crates/dataset/tests/data/folder/room]
"""

import argparse
import json
from pathlib import Path

import numpy as np
from PIL import Image

FRAMES = range(40, 44)


def quaternion(rotation):
    """qx, qy, qz, qw of a rotation matrix."""
    m = rotation
    w = np.sqrt(max(0.0, 1 + m[0, 0] + m[1, 1] + m[2, 2])) / 2
    x = np.sqrt(max(0.0, 1 + m[0, 0] - m[1, 1] - m[2, 2])) / 2
    y = np.sqrt(max(0.0, 1 - m[0, 0] + m[1, 1] - m[2, 2])) / 2
    z = np.sqrt(max(0.0, 1 - m[0, 0] - m[1, 1] + m[2, 2])) / 2
    return (
        np.copysign(x, m[2, 1] - m[1, 2]),
        np.copysign(y, m[0, 2] - m[2, 0]),
        np.copysign(z, m[1, 0] - m[0, 1]),
        w,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--folder", type=Path, default=Path("crates/dataset/tests/data/folder/room"))
    arguments = parser.parse_args()
    scene, folder = arguments.scene, arguments.folder
    for part in ("color", "depth"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    poses = ["# time tx ty tz qx qy qz qw"]
    for index, frame in enumerate(FRAMES):
        color = Image.open(scene / f"color/{frame}.jpg").resize((160, 120), Image.Resampling.BOX)
        color.save(folder / f"color/{index:04}.jpg", quality=88)
        depth = np.array(Image.open(scene / f"depth/{frame}.png")).astype(np.uint16)[::2, ::2]
        Image.fromarray(depth).save(folder / f"depth/{index:04}.png", optimize=True)
        pose = np.loadtxt(scene / f"pose/{frame}.txt")
        numbers = [*pose[:3, 3], *quaternion(pose[:3, :3])]
        poses.append(f"{index / 1.5:.6f} " + " ".join(f"{number:.6f}" for number in numbers))
    (folder / "poses.txt").write_text("\n".join(poses) + "\n")
    matrix = np.loadtxt(scene / "intrinsic/intrinsic_color.txt")
    camera = {
        "width": 160,
        "height": 120,
        "fx": matrix[0, 0] / 2,
        "fy": matrix[1, 1] / 2,
        "cx": (matrix[0, 2] + 0.5) / 2 - 0.5,
        "cy": (matrix[1, 2] + 0.5) / 2 - 0.5,
        "depth_scale": 1000,
    }
    (folder / "camera.json").write_text(json.dumps(camera, indent=2) + "\n")


if __name__ == "__main__":
    main()
