#!/usr/bin/env python3
"""Tests `splatseg batch --ray` on a cluster of two nodes on this machine, killing first a worker, then a whole node.

    pip install './python[ray]' pyarrow
    tools/ray_batch.py [--scenes 12] [--frames 40]

Runs the same batch without Ray first. Checks that with Ray no scene is lost or processed twice, and that every file is
the same. Then compares the speed of one worker and two. Exits with 1 if a check fails.
"""

import argparse
import filecmp
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

PROGRAM = [sys.executable, "-m", "splatseg"]
TIMES = {"summary.json", "manifest.jsonl"}


def ray(*arguments, **more):
    program = Path(sys.executable).parent / "ray"
    return subprocess.run([program, *arguments], check=True, capture_output=True, text=True, **more)


def scenes(arguments):
    return [f"synthetic:frames={arguments.frames},seed={seed},width=160,height=120" for seed in range(arguments.scenes)]


def batch(arguments, out, more):
    command = [
        *PROGRAM,
        "batch",
        *scenes(arguments),
        "nowhere",
        "--out",
        str(out),
        "--no-page",
        "--threads",
        "1",
        *more,
    ]
    started = time.monotonic()
    ended = subprocess.run(command, check=False, capture_output=True, text=True)
    if ended.returncode != 1 or "1 scene failed" not in ended.stderr:
        sys.exit(f"exit {ended.returncode}: {ended.stdout}{ended.stderr}")
    return time.monotonic() - started, ended.stderr


def pids(pattern):
    found = subprocess.run(["pgrep", "-f", pattern], check=False, capture_output=True, text=True).stdout
    return [int(pid) for pid in found.split()]


class Killer(threading.Thread):
    """Kills processes as soon as some scenes are done."""

    def __init__(self, out, rows, find):
        super().__init__(daemon=True)
        self.out, self.rows, self.find, self.killed = out, rows, find, []

    def run(self):
        while sum(1 for _ in (self.out / "rows").glob("*.json")) < self.rows if (self.out / "rows").is_dir() else True:
            time.sleep(0.02)
        for pid in self.find():
            os.kill(pid, signal.SIGKILL)
            self.killed.append(pid)


def files(out):
    found = (path for path in (out / "scenes").rglob("*") if path.is_file() and path.name not in TIMES)
    return {path.relative_to(out): path for path in found}


def check_same(expected, found):
    one, other = files(expected), files(found)
    if one.keys() != other.keys():
        sys.exit(f"files differ: {sorted(map(str, one.keys() ^ other.keys()))[:5]}")
    for name, path in one.items():
        if not filecmp.cmp(path, other[name], shallow=False):
            sys.exit(f"{name} differs")
    for name in ("scores.json", "failed.csv"):
        if (expected / name).read_bytes() != (found / name).read_bytes():
            sys.exit(f"{name} differs")
    return len(one)


def check_rows(arguments, out):
    """Checks that every scene has one row and was processed by one run: its results are listed once."""
    import pyarrow.parquet

    table = pyarrow.parquet.read_table(out / "results.parquet").to_pylist()
    if [row["scene"] for row in table] != scenes(arguments):
        sys.exit(f"rows: {[row['scene'] for row in table]}")
    for row in table:
        listed = (Path(row["out"]) / "manifest.jsonl").read_text().splitlines()
        images = [line for line in listed if "segments/" in line]
        if len(images) != len(set(images)) or len(images) != row["frames"]:
            sys.exit(f"{row['scene']}: {len(images)} images listed for {row['frames']} frames")


def second_node_pids(port):
    """The processes of the second node: its raylet, and the workers started by the raylet."""
    raylets = [pid for pid in pids("raylet/raylet") if f"--node_manager_port={port}" in command_line(pid)]
    children = [child for pid in raylets for child in children_of(pid)]
    return raylets + children


def command_line(pid):
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def children_of(pid):
    found = subprocess.run(["pgrep", "-P", str(pid)], check=False, capture_output=True, text=True).stdout
    own = [int(child) for child in found.split()]
    return own + [further for child in own for further in children_of(child)]


def cluster(cpus):
    """Starts nodes as processes on this machine; `cpus` is the number of CPUs of each."""
    ray("stop", "--force")
    ray("start", "--head", "--port=6399", f"--num-cpus={cpus[0]}", "--include-dashboard=false", "--disable-usage-stats")
    for number, count in enumerate(cpus[1:]):
        ray("start", "--address=127.0.0.1:6399", f"--num-cpus={count}", f"--node-manager-port={NODE_PORT + number}")


NODE_PORT = 6501


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--frames", type=int, default=40)
    arguments = parser.parse_args()
    os.environ["RAY_ENABLE_UV_RUN_RUNTIME_ENV"] = "0"
    with tempfile.TemporaryDirectory(prefix="splatseg-ray-") as folder:
        folder = Path(folder)
        try:
            measure(arguments, folder)
        finally:
            ray("stop", "--force")


def measure(arguments, folder):
    alone, _ = batch(arguments, folder / "alone", ["--jobs", "1"])
    two, _ = batch(arguments, folder / "two", ["--jobs", "2"])
    check_rows(arguments, folder / "alone")
    print(f"without Ray: 1 process {alone:.1f} s, 2 processes {two:.1f} s, efficiency {alone / two / 2:.2f}")

    with_ray = ["--ray", "127.0.0.1:6399"]
    seconds = {}
    for name, cpus in (("one", [1]), ("both", [1, 1])):
        cluster(cpus)
        seconds[name], _ = batch(arguments, folder / name, with_ray)
        count = check_same(folder / "alone", folder / name)
        check_rows(arguments, folder / name)
    efficiency = seconds["one"] / seconds["both"] / 2
    print(f"with Ray: 1 node {seconds['one']:.1f} s, 2 nodes {seconds['both']:.1f} s, efficiency {efficiency:.2f}")
    print(f"{count} files of the scenes are the same")

    for what, find in (
        ("a worker of the command", lambda: pids("splatseg batch-worker")[:1]),
        ("the second node with all its processes", lambda: second_node_pids(NODE_PORT)),
    ):
        cluster([1, 1])
        out = folder / what.replace(" ", "-")
        killer = Killer(out, arguments.scenes // 3, find)
        killer.start()
        elapsed, _ = batch(arguments, out, with_ray)
        if not killer.killed:
            sys.exit(f"{what}: nothing was killed")
        check_same(folder / "alone", out)
        check_rows(arguments, out)
        print(f"killed {what} ({len(killer.killed)} processes): nothing lost, nothing twice, {elapsed:.1f} s")
        before = {path: path.stat().st_mtime_ns for path in (out / "rows").iterdir()}
        elapsed, _ = batch(arguments, out, with_ray)
        if {path: path.stat().st_mtime_ns for path in (out / "rows").iterdir()} != before:
            sys.exit("finished scenes were processed again")
    print(json.dumps({"alone": alone, "two": two, **seconds, "efficiency": efficiency}))


if __name__ == "__main__":
    main()
