"""Depth that is predicted from colour."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _splatseg
from .forking import use_threads
from .settings import combined


class Depth:
    """A network that predicts depth from an image, on the CPU; see :func:`depth`."""

    def __init__(self, weights: str | os.PathLike[str], *, short_side: int = 252, output: str = "auto") -> None:
        self._depth = _splatseg.Depth(weights, short_side, output)
        self.settings: dict[str, Any] = {
            "depth_predictor": "depth-anything",
            "depth_weights": os.fspath(weights),
            "depth_anything": {"short_side": short_side, "output": output},
        }

    @property
    def is_metric(self) -> bool:
        """True if it returns metres, False if inverse depth up to scale and shift."""
        return self._depth.is_metric

    def __call__(self, rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
        """What the network returns for an image, uint8 ``(height, width, 3)``: float32 ``(height, width)``."""
        use_threads()
        return self._depth.predict(rgb)

    def __repr__(self) -> str:
        kind = "metres" if self.is_metric else "inverse depth"
        return f"<splatseg.Depth: {self.settings['depth_weights']}, {kind}>"


def is_function(predictor: Any) -> bool:
    """True for a callable that is no network of the library."""
    return callable(predictor) and not isinstance(predictor, Depth)


def with_network(settings: dict[str, Any]) -> dict[str, Any]:
    """Returns settings in which a :class:`Depth` as ``depth_predictor`` is replaced by the settings that choose it."""
    predictor = settings.get("depth_predictor")
    if not isinstance(predictor, Depth):
        return settings
    return combined(predictor.settings, {**settings, "depth_predictor": None})


def depth(weights: str | os.PathLike[str], *, short_side: int = 252, output: str = "auto") -> Depth:
    """Loads Depth Anything V2: ``ss.FastSamSplat(depth_predictor=ss.depth("depth_anything_v2_vits.pth"))``.

    ``weights`` is a ``.pth`` of its authors or a ``.safetensors`` of Hugging Face. ``short_side``: the image's short side
    as the network sees it, pixels. ``output``: ``"relative"``, ``"indoor"`` or ``"outdoor"``; ``"auto"``: as a
    ``config.json`` beside the file or the file's name says.

    Raises ``ValueError`` if the file cannot be used.
    """
    return Depth(weights, short_side=short_side, output=output)
