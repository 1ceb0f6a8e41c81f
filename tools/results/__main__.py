#!/usr/bin/env python3
"""Makes the tables of docs/RESULTS.md and docs/dev/ABLATIONS.md, and docs/RESULTS_TABLES.md, from commands.py.

    python tools/results --data ../shared/data            # run what has not been run on this commit, write the tables
    python tools/results --data ../shared/data --only map # only the commands of one table
    python tools/results --list                           # which commands there are, and which have been run

A command runs once for each version of the program, identified by the last commit that changed its sources. Its output
is kept in target/results/COMMIT. A table is written when all of its commands have run, on one machine; the tables of which
some have not run on this version stay as they are, so that a long measurement can be done in parts. Speed is measured only
while the machine is otherwise idle. Needs only Python's standard library, and Linux.
"""

import argparse
import datetime
import json
import subprocess
import sys
import time
from pathlib import Path

import documents
import machine
from commands import COMMANDS
from tables import TABLES

PROJECT = Path(__file__).resolve().parents[2]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="the folder with rooms/, kitchen-dev/ and redkitchen/")
    parser.add_argument(
        "--only", nargs="+", choices=sorted(TABLES), metavar="TABLE", help="run only these tables' commands"
    )
    parser.add_argument("--list", action="store_true", help="list the commands and stop")
    arguments = parser.parse_args()
    commit = machine.program_commit(PROJECT)
    folder = PROJECT / "target/results" / commit
    names = [name for table in arguments.only or TABLES for name in TABLES[table].commands]
    names = list(dict.fromkeys(names))
    missing = [name for name in names if not (folder / name / "done.json").is_file()]
    if arguments.list:
        for name in names:
            print(f"{'to run' if name in missing else 'done  '}  {name}: {COMMANDS[name].text()}")
        return
    if missing:
        if arguments.data is None:
            parser.error("--data is needed to run " + ", ".join(missing))
        run_missing(missing, folder, commit, arguments.data.resolve())
    documents.write(PROJECT, folder, commit)


def run_missing(missing, folder, commit, data):
    machine.refuse_changed_sources(PROJECT)
    # Timed commands last, so that only they wait for an idle machine.
    missing = sorted(missing, key=lambda name: COMMANDS[name].is_timed)
    features = "splatseg-cli/networks,splatseg-cli/ros2"
    build = ["cargo", "build", "--profile", "dist", "--workspace", "--bins", "--locked", "--features", features]
    subprocess.run(build, cwd=PROJECT, check=True)
    program = PROJECT / "target/dist/splatseg"
    for number, name in enumerate(missing, 1):
        command = COMMANDS[name]
        if command.is_timed:
            machine.wait_until_idle()
        out = folder / name
        out.mkdir(parents=True, exist_ok=True)
        print(f"[{number}/{len(missing)}] {name}: {command.text()}", flush=True)
        start = time.monotonic()
        with open(out / "log.txt", "w") as log:
            words = command.words(program, out)
            ended = subprocess.run(words, check=False, cwd=data, stdout=log, stderr=subprocess.STDOUT)
        if ended.returncode != 0:
            sys.exit(f"{name} failed with exit code {ended.returncode}; see {out / 'log.txt'}")
        done = {
            "commit": commit,
            "command": command.text(),
            "date": datetime.date.today().isoformat(),
            "machine": machine.description(),
            "seconds": round(time.monotonic() - start, 1),
        }
        (out / "done.json").write_text(json.dumps(done, indent=2))
        print(f"    {done['seconds']} s", flush=True)


if __name__ == "__main__":
    main()
