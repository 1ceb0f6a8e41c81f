"""Two saved maps in one."""

from __future__ import annotations

import json
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from . import _splatseg
from .files import require_new
from .forking import use_threads


def merge(
    earlier: str | os.PathLike[str],
    later: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    transform: ArrayLike | None = None,
    overwrite: bool = False,
) -> dict[str, Any]:
    """Makes one map of two maps of a place, from two days or two robots, as ``splatseg merge`` does.

    ``out`` is the file of the merged map, which has the world coordinates and the ids of ``earlier``. Where the maps differ,
    ``later`` is right. They need not have the same world coordinates, but must show a common place, unless ``transform``
    gives the pose of the later map's world in the earlier one's, a 4x4 matrix::

        merged = ss.merge("monday.ply", "tuesday.ply", "home.ply")
        print(merged["transform"], [o["id"] for o in merged["objects"] if o["earlier"] and o["later"]])

    Returns the report that docs/MERGING.md describes. Raises ``FileExistsError`` if ``out`` exists, unless ``overwrite``, and
    ``ValueError`` if a file cannot be used or the maps do not fit; then no file is written.
    """
    require_new(out, overwrite)
    pose: list[float] | None = None
    if transform is not None:
        matrix = np.asarray(transform, np.float64)
        if matrix.shape != (4, 4):
            raise ValueError(f"transform has the shape {matrix.shape}, expected (4, 4)")
        pose = matrix.ravel().tolist()
    use_threads()
    report: dict[str, Any] = json.loads(_splatseg.merge(earlier, later, out, pose))
    return report
