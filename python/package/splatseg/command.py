"""The command ``splatseg``."""

from __future__ import annotations

import signal
import sys

from . import _splatseg

PROGRAM = [sys.executable, "-m", "splatseg"]
"""Command line that starts another process of the command."""


def main() -> None:
    """Runs the command line and exits with its exit code."""
    arguments = sys.argv[1:]
    if arguments[:1] == ["batch"] and any(argument.split("=")[0] == "--ray" for argument in arguments):
        from .batch import main as batch

        sys.exit(batch(arguments))
    # The command handles SIGINT itself; Python's handler would raise KeyboardInterrupt after it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(_splatseg.run_command(["splatseg", *arguments], PROGRAM))


if __name__ == "__main__":
    main()
