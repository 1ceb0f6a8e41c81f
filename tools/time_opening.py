#!/usr/bin/env python3
"""Times how long recordings with many messages take to open, and how much memory that takes.

    pip install rosbags==0.11.9 mcap mcap-ros2-support numpy pillow        # in a virtual environment
    python tools/time_opening.py SPLATSEG [--messages 100000] [--folder DIR]

Writes recordings of two frames and that many poses in MCAP, SQLite and a bag of ROS 1, and opens each three times with
`splatseg inspect`: the shortest processor time and wall time, and the largest memory.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy
from make_bag_test_data import OPTICAL, Messages, messages, move_out, write_bag, write_rosbag2
from make_mcap_test_data import FRAME_NS, START
from rosbags.rosbag2 import StoragePlugin


def stream(version, count):
    """The messages of two frames, and poses between them."""
    make = Messages(version)
    frames = [part for part in messages(make, range(2)) if part[0].startswith(("/camera", "/chatter"))]
    yield from frames[: len(frames) // 2]
    pose = numpy.eye(4)
    for index in range(count):
        at = START + index * FRAME_NS // count
        yield "/tf", make.tf(make.transform(at, "map", OPTICAL, pose)), at
    yield from frames[len(frames) // 2 :]


def write(folder, count):
    """Writes the recordings that are missing."""
    paths = [folder / f"many_{count}{ending}" for ending in (".mcap", ".db3", ".bag")]
    for path, plugin in zip(paths, [StoragePlugin.MCAP, StoragePlugin.SQLITE3], strict=False):
        if not path.exists():
            move_out(write_rosbag2(folder / "tmp", plugin, stream(2, count)), path.suffix, path)
    if not paths[2].exists():
        write_bag(paths[2], stream(1, count))
    return paths


def opened(program, path):
    """Opens a recording. Returns wall time, processor time (s) and memory (MB)."""
    started = time.monotonic()
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen([program, "inspect", path], stdout=subprocess.DEVNULL, stderr=errors)
        _, status, usage = os.wait4(process.pid, 0)
        wall = time.monotonic() - started
        if status != 0:
            errors.seek(0)
            print(errors.read().decode().strip())
            sys.exit(2)
    return wall, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("--messages", type=int, default=100_000)
    parser.add_argument("--folder", type=Path)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.folder or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        print(f"{'file':<24} {'MB':>7} {'wall s':>8} {'CPU s':>8} {'memory MB':>10}")
        for path in write(folder, arguments.messages):
            runs = [opened(arguments.program, path) for _ in range(3)]
            wall, processor = (min(run[part] for run in runs) for part in (0, 1))
            memory = max(run[2] for run in runs)
            print(f"{path.name:<24} {path.stat().st_size / 1e6:7.1f} {wall:8.2f} {processor:8.2f} {memory:10.0f}")


if __name__ == "__main__":
    main()
