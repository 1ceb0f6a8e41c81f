"""Display in notebooks."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

from . import _splatseg

if TYPE_CHECKING:
    from .objects import Object

_MOST_ROWS = 100


def segment_color(id: int) -> tuple[int, int, int]:
    """The colour of an id in overlays and tables, sRGB, the same in every run.

    >>> ss.segment_color(1)
    (5, 65, 209)
    """
    return _splatseg.segment_color(id)


def objects_table(entries: Sequence[Object], title: str) -> str:
    """Objects as an HTML table, the most often seen first."""
    objects = sorted(entries, key=lambda entry: (-entry.frames, entry.id))
    rows = "".join(_row(entry) for entry in objects[:_MOST_ROWS])
    more = f"<p>and {len(objects) - _MOST_ROWS} more</p>" if len(objects) > _MOST_ROWS else ""
    head = "".join(
        f"<th>{name}</th>" for name in ("", "id", "label", "state", "frames", "confidence", "centroid, m", "size, m")
    )
    return f"<p><b>{len(objects)} {html.escape(title)}</b></p><table><tr>{head}</tr>{rows}</table>{more}"


def _row(entry: Object) -> str:
    red, green, blue = _splatseg.segment_color(entry.id)
    swatch = f'<span style="display:inline-block;width:1em;height:1em;background:rgb({red},{green},{blue})"></span>'
    shape = entry.shape
    cells = (
        swatch,
        str(entry.id),
        html.escape(entry.label or ""),
        entry.state or "",
        str(entry.frames),
        "" if entry.confidence is None else f"{entry.confidence:.2f}",
        _numbers(shape.centroid) if shape else "",
        _numbers(shape.size) if shape else "",
    )
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _numbers(values: tuple[float, float, float]) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
