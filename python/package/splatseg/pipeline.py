"""Methods, run frame by frame."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _splatseg
from .memory import Memory
from .objects import Object, ObjectSighting, parse
from .result import StepResult
from .segmenters import Segmenter

Masks = NDArray[np.bool_] | NDArray[np.integer]
SegmenterLike = str | Segmenter | Callable[[NDArray[np.uint8], NDArray[np.float32]], Masks | tuple[Masks, ArrayLike]]


class Pipeline:
    """A segmenter, a method and its memory: takes frames and returns persistent ids.

    ``segmenter`` is a name (``"affinity"``, the default, or ``"graph"``), a :class:`Segmenter` such as
    ``ss.FastSam("FastSAM-x.pt")``, or any callable ``(rgb, depth) -> masks``. It is called with uint8
    ``(height, width, 3)`` and float32 metres ``(height, width)``, and returns masks, bool ``(masks, height, width)``,
    which may overlap, or an image of ids ``(height, width)`` with 0 for none, or a pair of masks and their scores.

    ``method`` is one of ``fastsam-splat``, ``fastsam``, ``fastspam``, ``sam2``, ``sam2-splat``. ``config`` is a TOML
    file or the ``summary.json`` of a run; keywords override its settings. All other keywords are settings, see
    ``splatseg settings``.

    Raises ``TypeError`` for unknown settings, ``ValueError`` for invalid values and files.
    """

    _method: str | None = None

    def __init__(
        self,
        method: str | None = None,
        segmenter: SegmenterLike | None = None,
        *,
        config: str | os.PathLike[str] | None = None,
        **settings: Any,
    ) -> None:
        self._start(method, segmenter, config, settings, None)

    def _start(
        self,
        method: str | None,
        segmenter: SegmenterLike | None,
        config: str | os.PathLike[str] | None,
        settings: dict[str, Any],
        saved_memory: str | os.PathLike[str] | None,
    ) -> None:
        settings = {**settings, "method": method if method is not None else self._method}
        function = None
        if isinstance(segmenter, Segmenter):
            for name, value in segmenter.settings.items():
                both = isinstance(value, dict) and isinstance(settings.get(name), dict)
                settings[name] = {**value, **settings[name]} if both else settings.get(name, value)
        elif callable(segmenter):
            function = segmenter
        elif segmenter is not None:
            settings["segmenter"] = segmenter
        self._pipeline = _splatseg.Pipeline(settings, function, config, saved_memory)

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        method: str | None = None,
        segmenter: SegmenterLike | None = None,
        *,
        config: str | os.PathLike[str] | None = None,
        **settings: Any,
    ) -> Pipeline:
        """Creates a pipeline that continues with a saved memory and its ids.

        Raises ``ValueError`` if the file is damaged or does not fit the settings.
        """
        pipeline = cls.__new__(cls)
        pipeline._start(method, segmenter, config, settings, path)
        return pipeline

    def step(
        self,
        rgb: NDArray[np.uint8],
        depth: NDArray[np.floating] | NDArray[np.uint16],
        *,
        K: ArrayLike,
        camera_to_world: ArrayLike | None = None,
        timestamp: float | None = None,
        name: str | None = None,
        depth_scale: float | None = None,
    ) -> StepResult:
        """Processes the next frame of a camera.

        ``rgb``: uint8 ``(height, width, 3)``, C-contiguous, RGB. ``depth``: float32 or float64 z-depth in metres
        ``(height, width)`` of the same pixels, 0 or NaN where nothing was measured; with ``depth_scale`` in units per
        metre (1000 for millimetres) also uint16. ``K``: the camera matrix, 3x3, pixels. ``camera_to_world``: the pose,
        4x4, metres, camera axes x right, y down, z forward; without it the camera is tracked. ``timestamp``: seconds.

        The GIL is released during the computation. Invalid arguments raise ``TypeError`` or ``ValueError`` with the
        found and the expected value, and leave the memory unchanged. Exceptions of the segmenter are passed on.
        """
        ids, confidence, sightings, masks, times, pose, pose_state, remapped = self._pipeline.step(
            rgb, depth, K, camera_to_world, timestamp, name, depth_scale
        )
        return StepResult(
            ids=ids,
            confidence=confidence,
            objects=[ObjectSighting(*sighting) for sighting in sightings],
            times_ms=dict(times),
            rgb=rgb,
            depth=depth,
            K=np.asarray(K, dtype=np.float64),
            camera_to_world=pose,
            pose_state=pose_state,
            remapped=remapped,
            timestamp=timestamp,
            name=name,
            _masks=masks,
        )

    def objects(self) -> list[Object]:
        """Every object seen so far or in the memory, by increasing id, with its shape in the world."""
        return [parse(entry) for entry in json.loads(self._pipeline.objects())["objects"]]

    @property
    def memory(self) -> Memory:
        """The map. Raises ``ValueError`` if the method has none."""
        if not self._pipeline.has_memory:
            raise ValueError(f"the method {self.settings['method']} has no memory")
        return Memory(self._pipeline)

    @property
    def frames(self) -> int:
        """Number of processed frames."""
        return self._pipeline.frames

    @property
    def settings(self) -> dict[str, Any]:
        """All settings, as in ``summary.json``."""
        settings: dict[str, Any] = json.loads(self._pipeline.settings)
        return settings

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Saves the memory as a PLY file, which Gaussian splat viewers can open and :meth:`load` reads.

        Raises ``FileExistsError`` if the file exists, unless ``overwrite``; ``ValueError`` without a memory.
        """
        if not overwrite and os.path.lexists(path):
            raise FileExistsError(f"{os.fspath(path)}: exists: pass overwrite=True to replace it")
        self._pipeline.save(path)

    def __repr__(self) -> str:
        return f"<splatseg.{type(self).__name__}: {self.settings['method']}, {self.frames} frames>"

    def _repr_html_(self) -> str:
        from .pictures import objects_table

        return objects_table(self)


class FastSamSplat(Pipeline):
    """FastSAM-Splat: masks of any segmenter, with a splat as memory (Opipari et al., RA-L 2025).

    >>> import splatseg as ss
    >>> seg = ss.FastSamSplat(seed=1, memory={"max_votes": 8})
    >>> seg.settings["memory"]["max_votes"]
    8.0
    """

    _method = "fastsam-splat"

    def __init__(
        self,
        segmenter: SegmenterLike | None = None,
        *,
        config: str | os.PathLike[str] | None = None,
        **settings: Any,
    ) -> None:
        super().__init__(None, segmenter, config=config, **settings)


class Sam2Splat(Pipeline):
    """SAM2-Splat: SAM 2.1 tracks a segmenter's masks, and a splat re-prompts it when it loses an object.

    ``weights`` is Meta's ``sam2.1_hiera_*.pt`` as published (Apache-2.0), or a ``.safetensors``; no code in it is
    executed.
    """

    _method = "sam2-splat"

    def __init__(
        self,
        weights: str | os.PathLike[str] | None = None,
        segmenter: SegmenterLike | None = None,
        *,
        config: str | os.PathLike[str] | None = None,
        **settings: Any,
    ) -> None:
        super().__init__(None, segmenter, config=config, tracker_weights=weights, **settings)
