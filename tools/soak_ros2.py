#!/usr/bin/env python3
"""Runs `splatseg ros2` for a long time with the camera of ros2_peers.py, and tells how its memory grows; or kills it again
and again while it saves, and checks what it leaves. Use the virtual environment of ros2_peers.py that has Cyclone DDS.

    cargo build --profile dist --features ros2
    tools/soak_ros2.py SCENE --minutes 20 --rate 5
    tools/soak_ros2.py SCENE --kills 20 --width 160 --rate 10
"""

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy

PEERS = Path(__file__).with_name("ros2_peers.py")


def start_camera(arguments):
    command = [sys.executable, PEERS, "cyclone", arguments.scene, "--rate", arguments.rate]
    command += ["--frames", arguments.frames, "--repeat", 10**6]
    command += ["--width", arguments.width] if arguments.width else []
    command += [] if arguments.jumps else ["--back-and-forth"]
    return subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL)


def start_node(arguments, home, *options):
    command = [arguments.splatseg, "ros2", "--map", home, *options]
    return subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def memory(process):
    """Resident and anonymous memory of a process, MB."""
    lines = Path(f"/proc/{process.pid}/status").read_text().splitlines()
    values = {line.split(":")[0]: line.split(":")[1] for line in lines}
    return [int(values[name].split()[0]) / 1024 for name in ("VmRSS", "RssAnon")]


def soak(arguments, home):
    node, camera = start_node(arguments, home), start_camera(arguments)
    samples, begin = [], time.monotonic()
    try:
        while (minutes := (time.monotonic() - begin) / 60) < arguments.minutes and node.poll() is None:
            samples.append((minutes, *memory(node)))
            if len(samples) % 12 == 1:
                print("{:5.1f} min: {:.1f} MB, of it anonymous {:.1f} MB".format(*samples[-1]), flush=True)
            time.sleep(5)
    finally:
        camera.kill()
        node.send_signal(signal.SIGTERM)
        node.wait(10)
    times, _, anonymous = numpy.transpose([sample for sample in samples if sample[0] > arguments.minutes / 2])
    slope = numpy.polyfit(times, anonymous, 1)[0]
    print(f"second half: {slope * 1024:+.0f} kB per minute")


def kills(arguments, home):
    camera, good = start_camera(arguments), 0
    try:
        for number in range(arguments.kills):
            node = start_node(arguments, home, "--save-interval", "0.1")
            # Different moments of saving.
            time.sleep(6 + 0.037 * number)
            node.kill()
            node.wait()
            listed = json.loads(home.with_suffix(".objects.json").read_text())["objects"]
            command = [arguments.splatseg, "export", home, "--out", home.with_name(f"objects{number}.ply")]
            read = subprocess.run(command, check=False, capture_output=True)
            good += read.returncode == 0
            print(f"{number + 1}: {len(listed)} objects, map read with status {read.returncode}", flush=True)
    finally:
        camera.kill()
    print(f"{good} of {arguments.kills} maps valid")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder with frame-000000.color.jpg and so on")
    parser.add_argument("--splatseg", type=Path, default="target/dist/splatseg", help="the command")
    parser.add_argument("--minutes", type=float, default=20)
    parser.add_argument("--kills", type=int, help="kill it this many times instead")
    parser.add_argument("--rate", type=float, default=5, help="frames per second")
    parser.add_argument("--frames", type=int, default=100, help="frames of the scene")
    parser.add_argument("--width", type=int, help="resize the images to this width")
    parser.add_argument("--jumps", action="store_true", help="begin anew after the last frame, instead of going back")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        (kills if arguments.kills else soak)(arguments, Path(folder) / "home.ply")


if __name__ == "__main__":
    main()
