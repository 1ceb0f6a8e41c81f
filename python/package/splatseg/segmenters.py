"""Segmenters: they compute masks from an image and depth."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _splatseg
from .forking import use_threads


class Segmenter:
    """A segmenter of splatseg. Pass it to a pipeline, or call it: ``masks, scores = segmenter(rgb, depth)``.

    A pipeline calls a subclass that has a ``__call__`` of its own as it calls a function. Raises ``TypeError`` for unknown
    settings, ``ValueError`` for invalid values.
    """

    def __init__(self, **settings: Any) -> None:
        self.settings = settings
        """The pipeline settings that select it."""
        if type(self).__call__ is Segmenter.__call__:
            _splatseg.check_settings(settings)
        self._segmenter: _splatseg.Segmenter | None = None

    def __call__(
        self,
        rgb: NDArray[np.uint8],
        depth: NDArray[np.floating] | NDArray[np.uint16] | None = None,
        K: NDArray[np.floating] | None = None,
        *,
        depth_scale: float | None = None,
    ) -> tuple[NDArray[np.bool_], NDArray[np.float32]]:
        """The masks of a frame, ``(masks, height, width)``, which may overlap, and their scores, ``(masks,)``.

        ``rgb``, ``depth`` and ``depth_scale`` are those of :meth:`Pipeline.step`. Without ``K``, the camera has a
        horizontal field of view of 60 degrees.
        """
        use_threads()
        if self._segmenter is None:
            self._segmenter = _splatseg.Segmenter(self.settings)
        return self._segmenter.segment(rgb, depth, K, depth_scale)

    def __repr__(self) -> str:
        given: dict[str, Any] = {}
        for name, value in self.settings.items():
            given.update(value if isinstance(value, dict) else {name: value})
        settings = ", ".join(f"{name}={value!r}" for name, value in given.items() if name != "segmenter")
        return f"splatseg.{type(self).__name__}({settings})"


def chosen(segmenter: Any) -> tuple[dict[str, Any], Callable[..., Any] | None]:
    """The settings that choose a segmenter, and the function to call if it is none of the library's."""
    if isinstance(segmenter, Segmenter):
        if type(segmenter).__call__ is Segmenter.__call__:
            return segmenter.settings, None
        return {}, segmenter
    if callable(segmenter):
        return {}, segmenter
    return {"segmenter": segmenter}, None


class Graph(Segmenter):
    """Cuts the image at object boundaries in depth, surface orientation and colour. Needs depth, but no weights.

    ``settings`` are those of ``graph``, e.g. ``Graph(min_area=50)``.
    """

    def __init__(self, **settings: Any) -> None:
        super().__init__(segmenter="graph", graph=settings)


class Affinity(Segmenter):
    """A small network, trained on rendered rooms, that predicts which pixels belong to the same object.

    ``weights`` is a ``.safetensors`` to use instead of the built-in weights. ``settings`` are those of ``affinity``,
    e.g. ``Affinity(threshold=-1.0)``.
    """

    def __init__(self, weights: str | os.PathLike[str] | None = None, **settings: Any) -> None:
        super().__init__(segmenter="affinity", affinity=settings)
        if weights is not None:
            self.settings["weights"] = os.fspath(weights)


class FastSam(Segmenter):
    """FastSAM: a YOLO-like network that segments everything.

    ``weights`` is a published checkpoint (``FastSAM-x.pt``, ``FastSAM-s.pt``; AGPL-3.0) or a ``.safetensors``; no code
    in it is executed. ``settings`` are those of ``fastsam``, e.g. ``FastSam("FastSAM-x.pt", confidence=0.5)``; ``device``
    is the device to run it on.
    """

    def __init__(self, weights: str | os.PathLike[str], device: str | None = None, **settings: Any) -> None:
        super().__init__(segmenter="fastsam", weights=os.fspath(weights), fastsam=settings)
        if device is not None:
            self.settings["device"] = device
