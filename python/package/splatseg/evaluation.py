"""Scores of predictions against true ids."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from typing import Any

from . import _splatseg
from .forking import use_threads


@dataclass(frozen=True, repr=False)
class Scores:
    """Scores of predictions, percent, as reported by ``splatseg eval``."""

    vsq: float | None
    """Video segmentation quality: the mean of ``vsq_k``."""
    stq: float | None
    """Segmentation and tracking quality: the root of ``aq`` times ``sq``."""
    aq: float | None
    """Association quality."""
    sq: float | None
    """Segmentation quality."""
    vsq_k: dict[int, float | None]
    """VSQ by window length, frames."""
    by_size: dict[str, dict[str, Any]]
    """How well objects keep their ids, by object size: ``small``, ``medium``, ``large``."""
    frames: int
    """Number of scored frames."""
    missing: dict[str, int]
    """Numbers of frames that were left out or scored as empty."""

    def __repr__(self) -> str:
        vsq, stq = ("–" if score is None else f"{score:.1f}" for score in (self.vsq, self.stq))
        return f"<splatseg.Scores: VSQ {vsq}, STQ {stq}, {self.frames} frames>"


def evaluate(
    gt: str | os.PathLike[str],
    predictions: str | os.PathLike[str],
    protocol: str = "paper",
    *,
    exclude_void: bool = False,
    min_truth_area: float = 0.0,
    allow_missing: bool = False,
    ids: bool = True,
    **settings: Any,
) -> Scores:
    """Scores predictions for a scene with true ids, as ``splatseg eval`` does.

    ``gt``: the scene. ``predictions``: a folder of id images, the folder of a run, or a JSON file with masks.
    ``protocol``: ``paper``, as in the paper's evaluation code, or ``strict``, as VPQ and STEP define the metrics.
    ``settings`` are those of :func:`splatseg.open_scene`; the defaults are those of the run.

    Ctrl-C interrupts it. Raises ``ValueError`` if something cannot be read or, without ``allow_missing``, frames are
    missing.
    """
    use_threads()
    options = (protocol, exclude_void, min_truth_area, allow_missing, ids)
    try:
        scores = json.loads(_splatseg.evaluate(gt, predictions, settings, *options))
    except ValueError as error:
        text = str(error).replace("--allow-missing", "allow_missing=True").replace("--no-ids", "ids=False")
        raise ValueError(text) from None
    return Scores(
        vsq=scores["vsq"],
        stq=scores["stq"],
        aq=scores["aq"],
        sq=scores["sq"],
        vsq_k={int(length): value for length, value in scores["vsq_k"].items()},
        by_size=scores["by_size"],
        frames=scores["frames"],
        missing=scores["missing"],
    )
