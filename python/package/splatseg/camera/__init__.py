"""RGB-D cameras through their vendors' packages, live or recorded: ``python -m splatseg.camera realsense --map home.ply``.

::

    from splatseg.camera import open_camera

    with open_camera("orbbec") as pictures:
        for p in pictures:
            r = seg.step(p.rgb, p.depth, K=p.K, depth_scale=p.depth_scale, timestamp=p.timestamp, distortion=p.distortion)

Depth is registered to colour. The newest picture wins: those taken while a frame is processed are left out.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

PACKAGES = {
    "realsense": ("pyrealsense2", "pyrealsense2"),
    "orbbec": ("pyorbbecsdk", "pyorbbecsdk2"),
    "oak": ("depthai", '"depthai>=3"'),
}
"""For each camera, the module of its vendor and what ``pip`` installs it from."""


@dataclass(frozen=True, eq=False)
class Picture:
    """What a camera has taken at one time.

    ``rgb``: uint8 ``(height, width, 3)``. ``depth``: uint16 of the same pixels, ``depth_scale`` units per metre, 0 where
    nothing was measured. ``K``: the camera matrix, 3x3, pixels. ``timestamp``: seconds of the camera's clock.
    ``distortion``: the lens distortion of both, the model and its coefficients as in ``camera.json`` of the format
    ``folder``; ``None`` if there is none.
    """

    rgb: NDArray[np.uint8]
    depth: NDArray[np.uint16]
    K: NDArray[np.float64]
    depth_scale: float
    timestamp: float
    distortion: tuple[str, list[float]] | None = None


def open_camera(name: str, size: tuple[int, int] = (0, 0), rate: int = 0) -> AbstractContextManager[Iterator[Picture]]:
    """Opens the first camera of a kind, a key of :data:`PACKAGES`, for a ``with`` block: an endless iterator of pictures.

    ``size``: width and height of the pictures, ``rate``: pictures per second; 0 for the usual ones.

    Raises ``ImportError`` if the vendor's package is missing; what it raises itself, usually ``RuntimeError``, if there
    is no camera or it has no such pictures.
    """
    if name not in PACKAGES:
        raise ValueError(f"camera {name!r}, expected one of {', '.join(PACKAGES)}")
    module = importlib.import_module(f".{name}", __name__)
    camera: AbstractContextManager[Iterator[Picture]] = module.pictures(size, rate)
    return camera


def camera_matrix(fx: float, fy: float, cx: float, cy: float) -> NDArray[np.float64]:
    """The matrix of a camera, 3x3."""
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=np.float64)
