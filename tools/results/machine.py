"""Version of the program and description of the machine, for the stamp of every table."""

import os
import re
import subprocess
import sys
import time
from pathlib import Path

# Paths that the numbers depend on. Changes to documents, tests and tools do not make a measurement outdated.
PROGRAM = [":(glob)crates/*/src/**", "Cargo.toml", "Cargo.lock", "rust-toolchain.toml"]


def program_commit(project):
    """The last commit that changed the program."""
    return git(project, "log", "-1", "--format=%h", "--abbrev=9", "--", *PROGRAM)


def refuse_changed_sources(project):
    """Exits if the sources have uncommitted changes."""
    changed = git(project, "status", "--porcelain", "--", *PROGRAM)
    if changed:
        sys.exit(f"the sources differ from the last commit; commit first:\n{changed}")


def git(project, *words):
    return subprocess.run(["git", *words], cwd=project, check=True, capture_output=True, text=True).stdout.strip()


def description():
    """The processor, e.g. `AMD EPYC 9R14 (2 cores, AVX-512)`."""
    text = Path("/proc/cpuinfo").read_text()
    model = re.search(r"^model name\s*:\s*(.*)$", text, re.MULTILINE)
    vectors = "AVX-512" if "avx512f" in text else "AVX2" if "avx2" in text else "no AVX2"
    name = model.group(1).strip() if model else "unknown processor"
    return f"{name} ({os.cpu_count()} cores, {vectors})"


def wait_until_idle(limit=0.05, patience=600):
    """Waits until other programs use less than `limit` of the processor; exits if they do not stop."""
    deadline = time.monotonic() + patience
    while (load := busy_fraction()) > limit:
        if time.monotonic() > deadline:
            sys.exit(f"speed cannot be measured: other programs take {load:.0%} of the processor")
        print(f"    waiting: other programs take {load:.0%} of the processor", flush=True)
        time.sleep(5)


def busy_fraction(seconds=3):
    """The share of the processor that is in use."""

    def times():
        values = [int(value) for value in Path("/proc/stat").read_text().splitlines()[0].split()[1:]]
        return sum(values), values[3] + values[4]

    total, idle = times()
    time.sleep(seconds)
    later_total, later_idle = times()
    return 1 - (later_idle - idle) / max(later_total - total, 1)
