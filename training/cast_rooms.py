"""Depth and ids of rendered rooms without their colours, in a fifth of the time.

    python cast_rooms.py ROOMS_TOOL --out DIR --first-seed 6001 --rooms 40 --views 10

ROOMS_TOOL is the folder of `rooms.py`; run this in its environment (bpy). Each room becomes a folder of DIR in ScanNet's
exported layout, which `splatseg_training.train` reads; a folder that exists is kept.
"""

import argparse
import os
import sys

import numpy as np
from PIL import Image

WIDTH, HEIGHT = 320, 240
FOCAL = 577.87 / 640 * WIDTH  # ScanNet's field of view


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tool", metavar="ROOMS_TOOL")
    parser.add_argument("--out", required=True)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--rooms", type=int, default=10)
    parser.add_argument("--views", type=int, default=10)
    options = parser.parse_args()
    sys.path.insert(0, options.tool)
    import rooms

    for seed in range(options.first_seed, options.first_seed + options.rooms):
        folder = os.path.join(options.out, f"s{seed}")
        if not os.path.exists(folder):
            write_room(rooms, seed, options.views, folder)
            print(folder, flush=True)


def write_room(rooms, seed, count, folder):
    """Builds the room of a seed and writes scattered views of it."""
    camera = np.diag([FOCAL, FOCAL, 1.0, 1.0])
    camera[:2, 2] = WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5
    rooms.setup(WIDTH, HEIGHT, FOCAL, 1, 1)
    room = rooms.Room(seed)
    staged = folder + ".tmp"
    for name in ("depth", "pose", "intrinsic", "instance-filt"):
        os.makedirs(os.path.join(staged, name), exist_ok=True)
    np.savetxt(os.path.join(staged, "intrinsic", "intrinsic_depth.txt"), camera, "%.6f")
    for number, pose in enumerate(rooms.scattered(room, count, camera, WIDTH, HEIGHT)):
        z, ids, _ = room.cast(pose, camera, WIDTH, HEIGHT)
        z = np.where((z > 0) & (z <= 10), np.rint(z * 1000), 0).astype(np.uint16)
        Image.fromarray(z).save(os.path.join(staged, "depth", f"{number}.png"))
        Image.fromarray(ids.astype(np.uint16)).save(os.path.join(staged, "instance-filt", f"{number}.png"))
        np.savetxt(os.path.join(staged, "pose", f"{number}.txt"), pose, "%.8f")
    os.rename(staged, folder)


if __name__ == "__main__":
    main()
