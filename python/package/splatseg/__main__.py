"""Runs the command ``splatseg`` as ``python -m splatseg``."""

from .command import main

main()
