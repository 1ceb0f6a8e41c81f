"""SAM 2.1 alone: tracks prompted objects through a video."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _splatseg
from .forking import use_threads


@dataclass(frozen=True, eq=False, repr=False)
class Tracks:
    """Objects and their masks on a frame."""

    ids: list[int]
    """The id of each object."""
    masks: NDArray[np.bool_]
    """Its mask, ``(objects, height, width)``; empty where it is not in the frame. Masks may overlap."""

    def __getitem__(self, id: int) -> NDArray[np.bool_]:
        """The mask of one object, ``(height, width)``."""
        mask: NDArray[np.bool_] = self.masks[self.ids.index(id)]
        return mask

    def __repr__(self) -> str:
        return f"<splatseg.Tracks: {len(self.ids)} objects>"


class Sam2:
    """SAM 2.1 (Ravi et al. 2024) as a tracker.

    Pass in a frame with :meth:`step`, then prompt objects on it; each is tracked from there on::

        sam = ss.Sam2("sam2.1_hiera_tiny.pt")
        sam.step(frames[0])
        sam.add_clicks(1, [[210, 350]])
        for rgb in frames[1:]:
            mask = sam.step(rgb)[1]

    ``weights`` is Meta's checkpoint as published or a ``.safetensors``; no code in it is executed. ``settings`` are
    those of ``sam2``, e.g. ``image_size=512``; ``device`` is the device to run it on.
    """

    def __init__(self, weights: str | os.PathLike[str], device: str | None = None, **settings: Any) -> None:
        chosen = {"method": "sam2", "tracker_weights": os.fspath(weights), "device": device, "sam2": settings}
        use_threads()
        self._compiled = _splatseg.Sam2(chosen)

    @property
    def _sam2(self) -> _splatseg.Sam2:
        """The compiled part."""
        use_threads()
        return self._compiled

    def step(self, rgb: NDArray[np.uint8]) -> Tracks:
        """Processes the next frame, uint8 ``(height, width, 3)``, and tracks every object in it."""
        return Tracks(*self._sam2.step(rgb))

    def add_mask(self, id: int, mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Prompts an object with its mask on the current frame, bool ``(height, width)``; returns its updated mask.

        A new id adds an object; a known id corrects its object.
        """
        return Tracks(*self._sam2.add_mask(id, mask))[id]

    def add_clicks(
        self, id: int, points: ArrayLike, labels: ArrayLike | None = None, *, more: bool = False
    ) -> NDArray[np.bool_]:
        """Prompts an object with clicks on the current frame; returns its updated mask.

        ``points``: x and y of each click, pixels, ``(clicks, 2)``. ``labels``: 1 on the object (the default) or 0
        beside it, ``(clicks,)``. With ``more``, they are added to earlier prompts of this object on this frame.
        """
        return Tracks(*self._sam2.add_points(id, points, labels, None, more))[id]

    def add_box(self, id: int, box: ArrayLike) -> NDArray[np.bool_]:
        """Prompts an object with a box on the current frame: x0, y0, x1, y1, pixels; returns its updated mask."""
        return Tracks(*self._sam2.add_points(id, None, None, box, False))[id]

    def remove(self, id: int) -> None:
        """Stops tracking an object; its id may be prompted again."""
        self._sam2.remove(id)
