"""Processes that were started by fork."""

from __future__ import annotations

import os


class _Process:
    """Whether this process can have the threads of the library."""

    uses_threads = False
    """They have been started."""
    lacks_threads = False
    """They had been started in the process that this one was forked from: the library would wait for them."""


def _after_fork() -> None:
    _Process.lacks_threads |= _Process.uses_threads


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def require_threads() -> None:
    """Raises ``RuntimeError`` in a process that was started by fork after the library had started its threads."""
    if _Process.lacks_threads:
        raise RuntimeError(
            "splatseg was in use before this process was started by fork, which does not copy its threads: "
            "use the start method 'spawn', e.g. multiprocessing.get_context('spawn')"
        )


def use_threads() -> None:
    """As :func:`require_threads`, for what starts them."""
    require_threads()
    _Process.uses_threads = True
