"""``splatseg batch --ray``: thousands of videos on a Ray cluster.

One row is one video. Frames never go through Ray's object store: each actor starts a worker of the command, which reads
the scene and writes its results itself, and returns a summary. Needs ``pip install 'ray[data]'``.
"""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from . import _splatseg
from .command import PROGRAM

_BETWEEN_LINES_S = 10.0


class Worker:
    """An actor with a process of the command that handles one scene after another, so that networks are loaded once."""

    def __init__(self, retries: int) -> None:
        self.retries = retries
        self.process: subprocess.Popen[str] | None = None

    def __call__(self, row: dict[str, Any]) -> dict[str, Any]:
        """Runs a job; returns the scene, its number of frames and its error, which is empty on success."""
        job = row["job"]
        for _ in range(1 + self.retries):
            answer = self._answer(job)
            if answer is not None:
                return {"scene": row["scene"], "frames": answer["frames"], "error": answer["error"] or ""}
        error = f"the process that worked on it was killed, {1 + self.retries} times"
        return {"scene": row["scene"], "frames": 0, "error": error}

    def _answer(self, job: str) -> dict[str, Any] | None:
        if self.process is None or self.process.poll() is not None:
            self.process = subprocess.Popen(
                [*PROGRAM, "batch-worker"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                encoding="utf-8",
            )
        pipe_in, pipe_out = self.process.stdin, self.process.stdout
        assert pipe_in is not None and pipe_out is not None
        try:
            pipe_in.write(job + "\n")
            pipe_in.flush()
            line = pipe_out.readline()
        except OSError:
            line = ""
        if line.endswith("\n"):
            answer: dict[str, Any] = json.loads(line)
            return answer
        # The process was killed: the next call starts another.
        self.process.kill()
        self.process.wait()
        self.process = None
        return None


def main(arguments: list[str]) -> int:
    """Runs ``splatseg batch`` with these arguments, which include ``--ray``; returns the exit code."""
    address, rest = _without_ray(arguments)
    try:
        import ray
    except ImportError:
        print("error: --ray needs Ray: pip install 'ray[data]'", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory(prefix="splatseg-batch-") as folder:
        plan_file, failed_file = Path(folder) / "plan.json", Path(folder) / "failed.jsonl"
        code = _splatseg.run_command(["splatseg", *rest, "--plan", str(plan_file)], PROGRAM)
        if code != 0 or not plan_file.exists():
            return code
        plan = json.loads(plan_file.read_bytes())
        failed_file.write_text("")
        if plan["jobs"]:
            ray.init(address=address, log_to_driver=False, logging_level=logging.WARNING)
            try:
                failed_file.write_text("".join(json.dumps(row) + "\n" for row in _work(plan)))
            finally:
                ray.shutdown()
        return _splatseg.run_command(["splatseg", *rest, "--collect", str(failed_file)], PROGRAM)


def _without_ray(arguments: list[str]) -> tuple[str, list[str]]:
    address, rest, left = "auto", [], iter(arguments)
    for argument in left:
        if argument == "--ray":
            address = next(left, "auto")
        elif argument.startswith("--ray="):
            address = argument.removeprefix("--ray=")
        else:
            rest.append(argument)
    return address, rest


def _work(plan: dict[str, Any]) -> list[dict[str, str]]:
    """Runs all jobs of a plan; returns the failed scenes with their errors."""
    import ray.data

    context = ray.data.DataContext.get_current()
    context.enable_progress_bars = False
    # If an actor is lost with its machine, another actor gets its job.
    context.max_errored_blocks = 0
    jobs = [{"scene": job["scene"], "job": json.dumps(job)} for job in plan["jobs"]]
    cpus = int(ray.cluster_resources().get("CPU", 1))
    actors = max(1, min(len(jobs), cpus // plan["num_cpus"]))
    rows = (
        ray.data.from_items(jobs, override_num_blocks=len(jobs))
        .map(
            Worker,
            fn_constructor_kwargs={"retries": plan["retries"]},
            # One scene at a time for each actor: queued scenes would wait for it while other actors are idle.
            compute=ray.data.ActorPoolStrategy(
                min_size=1, max_size=actors, initial_size=actors, max_tasks_in_flight_per_actor=1
            ),
            num_cpus=plan["num_cpus"],
            memory=plan["memory"],
        )
        .iter_rows()
    )
    progress, failed = _Progress(len(jobs)), []
    for row in rows:
        if row["error"]:
            failed.append({"scene": row["scene"], "error": row["error"]})
        progress.add(row["frames"], failed=bool(row["error"]), running=actors)
    return failed


class _Progress:
    """Prints the progress of a batch from time to time."""

    def __init__(self, jobs: int) -> None:
        self.jobs, self.done, self.failed, self.frames = jobs, 0, 0, 0
        self.started = self.latest = time.monotonic()

    def add(self, frames: int, *, failed: bool, running: int) -> None:
        self.done, self.failed, self.frames = self.done + (not failed), self.failed + failed, self.frames + frames
        now = time.monotonic()
        ended = self.done + self.failed
        if now - self.latest < _BETWEEN_LINES_S and ended < self.jobs:
            return
        self.latest, elapsed = now, max(now - self.started, 1e-3)
        left = elapsed * (self.jobs - ended) / ended / 60
        print(
            f"{self.done} of {self.jobs} scenes done, {min(running, self.jobs - ended)} running, {self.failed} failed; "
            f"{self.frames / elapsed:.1f} frames/s, about {left:.0f} min left",
            file=sys.stderr,
        )
