"""Frames with a progress bar."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TypeVar

from .optional import require

_Item = TypeVar("_Item")


def with_progress(items: Iterable[_Item], wanted: bool | None, total: int | None) -> Iterable[_Item]:
    """The items, ``total`` of them, with a bar of ``tqdm``: always if ``wanted``; if that is ``None``, in terminals and if there is tqdm."""
    if wanted is False:
        return items
    try:
        bar = require("tqdm.auto", "tqdm", "progress=True").tqdm
    except ImportError:
        if wanted:
            raise
        return items
    # tqdm's None: none unless standard error is a terminal.
    shown: Iterable[_Item] = bar(items, total=total, unit="frame", disable=False if wanted else None)
    return shown
