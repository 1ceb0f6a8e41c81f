"""The map of a pipeline."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from . import _splatseg


class Memory:
    """The current Gaussians of a pipeline's memory.

    Each property returns a new array, because the memory changes with every step.
    """

    def __init__(self, pipeline: _splatseg.Pipeline) -> None:
        self._pipeline = pipeline

    def __len__(self) -> int:
        """The number of Gaussians."""
        return self._pipeline.gaussian_count()

    @property
    def means(self) -> NDArray[np.float64]:
        """Centres, world coordinates, metres, ``(Gaussians, 3)``."""
        return self._pipeline.means()

    @property
    def radii(self) -> NDArray[np.float32]:
        """Standard deviations, metres, ``(Gaussians,)``; the Gaussians are isotropic."""
        return self._pipeline.radii()

    @property
    def colors(self) -> NDArray[np.uint8]:
        """Colours, sRGB, ``(Gaussians, 3)``."""
        return self._pipeline.colors()

    @property
    def has_place(self) -> NDArray[np.bool_]:
        """``(Gaussians,)``; False where no depth was measured nearby, as in the sky: the distance is arbitrary then."""
        return self._pipeline.has_place()

    @property
    def segment_ids(self) -> NDArray[np.uint32]:
        """The id of each Gaussian, ``(Gaussians,)``; 0 for none."""
        return self._pipeline.segment_ids()

    def __repr__(self) -> str:
        return f"<splatseg.Memory: {len(self)} Gaussians>"
