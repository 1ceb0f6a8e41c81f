#!/usr/bin/env python3
"""Compares a long run that is stopped or killed at random and resumed with an uninterrupted one.

    cargo build --profile dist
    tools/soak.py --splatseg target/dist/splatseg

Both process a synthetic tour with Kinect noise. The second is stopped repeatedly by a random signal and resumed with
`--resume`. Checks that

- both write the same bytes: ids, overlays, objects, everything but the times in `summary.json`; and the saved memory;
- memory and time per frame of the undisturbed run stay flat: at most 10 % more memory in the last quarter than in the
  second, at most 25 % more time (the median of the points of `summary.json`'s curve).

Needs only Python's standard library. Exits with 1 if a check fails.
"""

import argparse
import filecmp
import json
import random
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL]
MEMORY_GROWTH = 1.10
TIME_GROWTH = 1.25


def command(arguments, out, more):
    scene = f"synthetic:frames={arguments.frames},width=160,height=120,noise=kinect,seed={arguments.seed}"
    return [
        arguments.splatseg, "run", scene, "--threads", "1", "--out", str(out), "--save-memory", str(out) + ".ply", *more,
    ]  # fmt: skip


def undisturbed(arguments, folder):
    subprocess.run(command(arguments, folder / "whole", []), check=True, stdout=subprocess.DEVNULL)


def disturbed(arguments, folder, rng):
    """Runs until the end, with any number of stops; returns the number of signals of each kind."""
    sent = dict.fromkeys(SIGNALS, 0)
    more = ["--resume", "--save-every", str(arguments.save_every)]
    while True:
        process = subprocess.Popen(
            command(arguments, folder / "stopped", more), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        try:
            message = process.communicate(timeout=rng.uniform(0.2, 2 * arguments.mean_seconds))[1]
            if process.returncode == 0:
                return sent
            sys.exit(f"exit {process.returncode}: {message.decode()}")
        except subprocess.TimeoutExpired:
            how = rng.choice(SIGNALS)
            sent[how] += 1
            process.send_signal(how)
            process.communicate(timeout=60)


def differing_files(folder, frames):
    """Names of files that differ or are missing or unexpected."""
    listed = {}
    for name in ("whole", "stopped"):
        root = folder / name
        listed[name] = {path.relative_to(root): path for path in root.rglob("*") if path.is_file()}
        # The list contains rewritten files twice.
        for times in ("summary.json", "manifest.jsonl"):
            del listed[name][Path(times)]
    whole, stopped = listed["whole"], listed["stopped"]
    images = sum(path.parts[0] == "segments" for path in whole)
    if images != frames:
        sys.exit(f"{folder / 'whole'}: {images} frames instead of {frames}")
    both = set(whole) & set(stopped)
    differ = (path for path in both if not filecmp.cmp(whole[path], stopped[path], shallow=False))
    return sorted(str(path) for path in [*(set(whole) ^ set(stopped)), *differ]), len(whole)


def growth(whole):
    """Ratios of the last to the second quarter of the curve for memory and time, and the points themselves."""
    curve = json.loads((whole / "summary.json").read_text())["curve"]
    quarter = len(curve) // 4

    def ratio(key):
        middle = [statistics.median(point[key] for point in part) for part in (curve[quarter : 2 * quarter], curve[-quarter:])]
        return middle[1] / middle[0]

    return ratio("memory_mb"), ratio("ms"), curve


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--splatseg", default="target/dist/splatseg", help="the program")
    parser.add_argument("--frames", type=int, default=20_000)
    parser.add_argument("--save-every", type=int, default=200, help="frames between two saved states")
    parser.add_argument("--mean-seconds", type=float, default=20.0, help="between two signals")
    parser.add_argument("--seed", type=int, default=0, help="seed of the room and the signals")
    parser.add_argument("--keep", action="store_true", help="keep the results")
    arguments = parser.parse_args()
    # `nohup` makes its child ignore SIGHUP, and a shell makes background processes ignore SIGINT.
    for how in (signal.SIGHUP, signal.SIGINT):
        signal.signal(how, signal.SIG_DFL)
    folder = Path(tempfile.mkdtemp(prefix="splatseg-soak-"))
    started = time.monotonic()
    other = threading.Thread(target=undisturbed, args=(arguments, folder))
    other.start()
    sent = disturbed(arguments, folder, random.Random(arguments.seed))
    other.join()

    whole = folder / "whole"
    wrong, files = differing_files(folder, arguments.frames)
    same_memory = filecmp.cmp(folder / "whole.ply", folder / "stopped.ply", shallow=False)
    memory, milliseconds, curve = growth(whole)
    signals = ", ".join(f"{count} {how.name}" for how, count in sent.items())
    print(f"{arguments.frames} frames, {signals}; {time.monotonic() - started:.0f} s")
    for point in curve[:: max(1, len(curve) // 8)]:
        print("  " + ", ".join(f"{key} {value:.6g}" for key, value in point.items()))
    print(f"files that differ: {len(wrong)} of {files} {wrong[:3]}; saved memory the same: {same_memory}")
    print(f"last quarter over second: memory {memory:.3f} (at most {MEMORY_GROWTH}), time {milliseconds:.3f} (at most {TIME_GROWTH})")
    if arguments.keep:
        print(f"results: {folder}")
    else:
        shutil.rmtree(folder)
    if wrong or not same_memory or memory > MEMORY_GROWTH or milliseconds > TIME_GROWTH:
        sys.exit(1)


if __name__ == "__main__":
    main()
