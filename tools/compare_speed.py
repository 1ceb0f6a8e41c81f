#!/usr/bin/env python3
"""Compares how fast two splatseg binaries run whole videos, in turn, on a machine that does nothing else.

    tools/compare_speed.py OLD NEW [--shared ../shared] [--rounds 7] [--only NAME,...] [--new-args ...]

Each round runs the old binary, then the new one, on the same input with everything written. Prints, per case, the medians
of the seconds from start to end, and the median, smallest and largest ratio old / new of a round. `--new-args` are added to
the new binary's arguments, for example `--online`. Exit code: 0, or 2 if a binary failed.
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ONE_THREAD = {"RAYON_NUM_THREADS": "1"}
# By name: arguments of `run`, and environment.
CASES = {
    "320x240": (["{shared}/data/redkitchen", "--resize", "320x240"], {}),
    "640x480": (["{shared}/data/redkitchen"], {}),
    "1280x720": (["{shared}/data/redkitchen", "--resize", "1280x720"], {}),
    "one-thread-320x240": (["{shared}/data/redkitchen", "--resize", "320x240"], ONE_THREAD),
    "one-thread-640x480": (["{shared}/data/redkitchen"], ONE_THREAD),
    "tracked-640x480": (["{shared}/data/redkitchen_dense", "--poses", "track"], {}),
}


class Failed(Exception):
    """A binary failed."""


def timed(command, environment):
    """Runs a command; returns its seconds and its peak memory in megabytes."""
    start = time.monotonic()
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=errors, env={**os.environ, **environment})
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.monotonic() - start
        if status != 0:
            errors.seek(0)
            raise Failed(f"{' '.join(command)}\n  ended with status {status}: {errors.read().decode()[-2000:]}")
    return seconds, usage.ru_maxrss / 1024


def compare(name, options):
    arguments, environment = CASES[name]
    arguments = [argument.format(shared=options.shared) for argument in arguments]
    seconds, memory = ([], []), ([], [])
    for round_ in range(options.rounds):
        for which, (binary, more) in enumerate(((options.old, []), (options.new, options.new_args))):
            with tempfile.TemporaryDirectory() as folder:
                command = [str(binary), "run", *arguments, *more, "--out", f"{folder}/out"]
                taken, peak = timed([*command, "--save-memory", f"{folder}/map.ply"], environment)
            seconds[which].append(taken)
            memory[which].append(peak)
        print(f"  {name} {round_ + 1}: {seconds[0][-1]:.1f} s, {seconds[1][-1]:.1f} s", file=sys.stderr, flush=True)
    ratios = [old / new for old, new in zip(*seconds, strict=True)]
    old, new = (statistics.median(times) for times in seconds)
    old_peak, new_peak = (statistics.median(peaks) for peaks in memory)
    print(
        f"{name}: {old:.1f} s, {new:.1f} s, ratio {statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f}); "
        f"peak memory {old_peak:.0f} MB, {new_peak:.0f} MB",
        flush=True,
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--shared", type=Path, default=Path(__file__).resolve().parents[2] / "shared",
                        help="folder with data/ (default: %(default)s)")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--only", help="cases to run, of: " + ", ".join(CASES))
    parser.add_argument("--new-args", nargs=argparse.REMAINDER, default=[], metavar="ARG")
    options = parser.parse_args()
    chosen = options.only.split(",") if options.only else list(CASES)
    if unknown := [name for name in chosen if name not in CASES]:
        parser.error(f"no case {', '.join(unknown)}; there are {', '.join(CASES)}")
    for name in chosen:
        compare(name, options)


if __name__ == "__main__":
    try:
        main()
    except (Failed, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
