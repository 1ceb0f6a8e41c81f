"""A frame of an RGB-D video."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """A registered RGB-D frame of a scene, resized and cropped according to the scene's settings."""

    index: int
    """Its index in the scene, from 0."""
    name: str
    """Its name in the scene, e.g. ``frame-000150``."""
    rgb: NDArray[np.uint8]
    """Colour, sRGB, ``(height, width, 3)``."""
    depth: NDArray[np.float32]
    """z-depth in metres, ``(height, width)``; 0 where nothing was measured."""
    K: NDArray[np.float64]
    """The camera matrix ``[[fx, 0, cx], [0, fy, cy], [0, 0, 1]]``, pixels."""
    camera_to_world: NDArray[np.float64] | None
    """The pose: a 4x4 matrix from the camera's coordinates (x right, y down, z forward) to the world's, metres; ``None``
    if none was recorded for this frame."""
    timestamp: float | None
    """Timestamp, seconds; ``None`` if the scene has none."""
    ground_truth: NDArray[np.uint32] | None
    """True ids, ``(height, width)``, 0 where unlabelled; ``None`` if there are none for this frame."""

    def __repr__(self) -> str:
        height, width = self.depth.shape
        pose = "with a pose" if self.camera_to_world is not None else "without a pose"
        return f"<splatseg.Frame {self.name!r}: {width}x{height}, {pose}>"
