"""``python -m splatseg`` is the command ``splatseg``."""

from .command import main

main()
