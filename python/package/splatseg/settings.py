"""Settings as keyword arguments."""

from __future__ import annotations

from typing import Any


def flat(settings: dict[str, Any], section: str = "") -> dict[str, Any]:
    """Settings by their full names, ``memory.max_votes``. ``None`` stands for a setting that is not given."""
    found: dict[str, Any] = {}
    for name, value in settings.items():
        if isinstance(value, dict):
            found.update(flat(value, f"{section}{name}."))
        elif value is not None:
            found[f"{section}{name}"] = value
    return found


def combined(*layers: dict[str, Any]) -> dict[str, Any]:
    """Settings of several layers by their full names. Later layers override earlier ones."""
    found: dict[str, Any] = {}
    for layer in layers:
        found.update(flat(layer))
    return found
