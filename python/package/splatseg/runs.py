"""Whole runs, as by the command ``splatseg run``."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .command import PROGRAM
from .objects import Objects, parse
from .predicted_depth import is_function, with_network
from .segmenters import Segmenter, chosen
from .settings import combined


@dataclass(frozen=True, repr=False)
class Run:
    """The results of a run: the folder that ``splatseg run`` writes."""

    out: Path
    """The folder."""
    summary: dict[str, Any]
    """``summary.json``: counts, times, settings."""

    @property
    def page(self) -> Path | None:
        """The page that shows the results in a browser; ``None`` if none was written."""
        page = self.out / "index.html"
        return page if page.is_file() else None

    def objects(self) -> Objects:
        """All objects, the longest seen first."""
        return Objects(parse(entry) for entry in json.loads((self.out / "objects.json").read_bytes())["objects"])

    def __repr__(self) -> str:
        return f"<splatseg.Run {os.fspath(self.out)!r}: {self.summary['frames']} frames>"


def run(
    source: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    segmenter: str | Segmenter | None = None,
    config: str | os.PathLike[str] | None = None,
    load_memory: str | os.PathLike[str] | None = None,
    save_memory: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    **settings: Any,
) -> Run:
    """Processes a whole scene and writes all results to the folder ``out``, as the command ``splatseg run`` does.

    ``source`` is a folder, a recording or ``synthetic:frames=60``. ``load_memory`` is a saved map to continue, ``save_memory``
    the file for the map. ``overwrite`` replaces an earlier run's files. ``config`` is a TOML file or the ``summary.json`` of a
    run; all other keywords are settings: ``seed=3``, ``dataset={"stride": 2}``, ``memory={"max_votes": 8}``.

    The run is a process of its own, which shows its progress in a terminal. Ctrl-C, or another exception in this program,
    ends it after the current frame; it keeps its results, and the exception goes on. Raises ``ValueError`` for a
    scene or a setting that cannot be used, and ``RuntimeError`` if the run fails.
    """
    of_segmenter, function = chosen(segmenter)
    if function is not None:
        kind = f"of type {type(segmenter).__name__}, which has its own __call__" if isinstance(segmenter, Segmenter) else "a function"
        raise TypeError(f"segmenter is {kind}: use FastSamSplat(segmenter=...).run(source)")
    if is_function(settings.get("depth_predictor")):
        raise TypeError("depth_predictor is a function: use FastSamSplat(depth_predictor=...).run(source)")
    arguments = ["run", f"--out={os.fspath(out)}"]
    paths = {"--config": config, "--load-memory": load_memory, "--save-memory": save_memory}
    arguments += [f"{name}={os.fspath(path)}" for name, path in paths.items() if path is not None]
    arguments += ["--overwrite"] if overwrite else []
    arguments += [f"--set={key}={_text(value)}" for key, value in combined(of_segmenter, with_network(settings)).items()]
    _execute([*arguments, "--", os.fspath(source)])
    return Run(Path(out), json.loads((Path(out) / "summary.json").read_bytes()))


def _text(value: Any) -> str:
    """A value as the command reads it."""
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    return os.fspath(value) if hasattr(value, "__fspath__") else str(value)


def _execute(arguments: list[str]) -> None:
    """Runs the command. Its messages go to this program's standard error."""
    # A terminal shows the progress of the command itself; a notebook gets its lines.
    terminal = sys.__stderr__
    in_terminal = terminal is not None and sys.stderr is terminal and terminal.isatty()
    process = subprocess.Popen(
        [*PROGRAM, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=None if in_terminal else subprocess.PIPE,
        encoding="utf-8",
        errors="replace",
        # A second signal ends the command at once: it gets none from the terminal, only those that are passed on.
        start_new_session=True,
    )
    error = "its message is above"
    with process:
        try:
            for line in process.stderr or ():
                if line.startswith("error: "):
                    error = line.removeprefix("error: ").strip()
                    error = error.replace("--out,", "out,").replace("give --overwrite", "pass overwrite=True")
                else:
                    print(line, end="", file=sys.stderr)
            process.wait()
        except BaseException:
            _interrupt(process)
            raise
    if process.returncode == 130:
        raise KeyboardInterrupt
    if process.returncode == 2:
        raise ValueError(error)
    if process.returncode != 0:
        raise RuntimeError(f"splatseg run ended with exit code {process.returncode}: {error}")


def _interrupt(process: subprocess.Popen[str]) -> None:
    """Ends the command after its current frame, so that it keeps its results. A second Ctrl-C ends it at once."""
    while process.poll() is None:
        try:
            # Windows sends Ctrl-C to the command itself.
            if os.name != "nt":
                process.send_signal(signal.SIGINT)
            for line in process.stderr or ():
                with contextlib.suppress(OSError, ValueError):
                    print(line, end="", file=sys.stderr)
            process.wait()
        except KeyboardInterrupt:
            continue
