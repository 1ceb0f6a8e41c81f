"""Methods, run frame by frame."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _splatseg
from .files import require_new
from .forking import require_threads, use_threads
from .frame import Frame
from .memory import Memory
from .naming import Names
from .objects import FoundObject, Object, Objects, ObjectSighting, Sightings, parse
from .predicted_depth import with_network
from .progress import with_progress
from .result import StepResult
from .scene import Scene, open_scene
from .segmenters import Segmenter, chosen
from .settings import combined

if TYPE_CHECKING:
    from typing_extensions import Self

Masks = NDArray[np.bool_] | NDArray[np.integer]
SegmenterLike = str | Segmenter | Callable[[NDArray[np.uint8], NDArray[np.float32]], Masks | tuple[Masks, ArrayLike]]

Name = str | ArrayLike | tuple[str | None, ArrayLike | float | None] | None

# The settings of poses that need no conversion.
_POSES_AS_THEY_ARE = {"pose_convention": "camera-to-world", "quaternion_order": "xyzw", "pose_scale": 1.0}


class Pipeline:
    """A segmenter, a method and its memory: takes frames and returns persistent ids.

    ``segmenter`` is a name (``"affinity"``, the default, or ``"graph"``), a :class:`Segmenter` such as
    ``ss.FastSam("FastSAM-x.pt")``, or any callable ``(rgb, depth) -> masks``. It is called with uint8
    ``(height, width, 3)`` and float32 metres ``(height, width)``, and returns masks, bool ``(masks, height, width)``,
    which may overlap, or an image of ids ``(height, width)`` with 0 for none, or a pair of masks and their scores from 0 to 1.

    ``method`` is one of ``fastsam-splat``, ``fastsam``, ``fastspam``, ``sam2``, ``sam2-splat``. ``config`` is a TOML file
    or the ``summary.json`` of a run; keywords override its settings. All other keywords are settings, see
    ``splatseg settings``. ``depth_predictor`` is a name, :func:`ss.depth(...) <depth>`, or any callable ``rgb -> depth`` or
    ``rgb -> (depth, confidence)``, whose float arrays are as large as the image, depth with 0 where nothing is predicted
    and confidence from 0 to 1; ``predicted_depth="holes"`` (the default) or ``"all"``, which needs metres, says where it is
    used. With a function, settings of the library's segmenters are refused as keywords and ignored in ``config``, and
    :attr:`settings` has the name ``python`` for it. ``keep_views`` keeps the best view of each object for
    :meth:`name_objects`, at most 64 MiB.

    Raises ``TypeError`` for unknown settings, ``ValueError`` for invalid values and files, and ``RuntimeError`` in a process
    that was started by fork after this package had been in use: use the start method ``spawn``.
    """

    _method: str | None = None
    _is_loaded = False

    def __init__(
        self,
        method: str | None = None,
        segmenter: SegmenterLike | None = None,
        *,
        config: str | os.PathLike[str] | None = None,
        keep_views: bool = False,
        **settings: Any,
    ) -> None:
        self._start(method, segmenter, config, settings, None, keep_views)

    def _start(
        self,
        method: str | None,
        segmenter: SegmenterLike | None,
        config: str | os.PathLike[str] | None,
        settings: dict[str, Any],
        saved_memory: str | os.PathLike[str] | None,
        keep_views: bool,
    ) -> None:
        require_threads()
        of_segmenter, function = chosen(segmenter)
        settings = {**settings, "method": method if method is not None else self._method}
        settings = combined(of_segmenter, with_network(settings))
        predictor, used = settings.get("depth_predictor"), None
        if callable(predictor):
            settings.pop("depth_predictor")
            used = predictor, settings.pop("predicted_depth", None)
        self._compiled = _splatseg.Pipeline(settings, function, config, saved_memory, keep_views, used)
        self._lens = _splatseg.Lens()

    @property
    def _pipeline(self) -> _splatseg.Pipeline:
        """The compiled part, for what uses its threads."""
        use_threads()
        return self._compiled

    @classmethod
    def load(
        cls,
        path: str | os.PathLike[str],
        method: str | None = None,
        segmenter: SegmenterLike | None = None,
        *,
        config: str | os.PathLike[str] | None = None,
        keep_views: bool = False,
        **settings: Any,
    ) -> Self:
        """Creates a pipeline that continues with a saved memory, its ids and names.

        A saved map has no views of its objects: with ``keep_views``, an object has one once it is seen again.

        Raises ``ValueError`` if the file is damaged or does not fit the settings.
        """
        use_threads()
        pipeline = cls.__new__(cls)
        pipeline._start(method, segmenter, config, settings, path, keep_views)
        pipeline._is_loaded = True
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
        distortion: tuple[str, Sequence[float]] | None = None,
    ) -> StepResult:
        """Processes the next frame of a camera.

        ``rgb``: uint8 ``(height, width, 3)``, C-contiguous, RGB. ``depth``: float32 or float64 z-depth in metres
        ``(height, width)`` of the same pixels, 0 or NaN where nothing was measured; with ``depth_scale`` in units per metre
        (1000 for millimetres) other units, and uint16. Floats whose median is above 100 are refused without it. ``K``: the
        camera matrix, 3x3, pixels. ``camera_to_world``: the pose, 4x4, metres, camera axes x right, y down, z forward,
        unless the pipeline was made with ``dataset.pose_convention`` and kin (poses of a scene opened with them are
        converted already); without it the camera is tracked. ``timestamp``: seconds. ``distortion``: the lens of both
        images, a model and its coefficients as in ROS's ``CameraInfo``, e.g. ``("plumb_bob", [k1, k2, p1, p2, k3])``: they
        are undistorted first, and the result has the undistorted images, with depth in metres. The result has copies of the
        images, so their buffers can be used again. Input that contradicts itself, e.g. poses that do not fit the images,
        causes a ``UserWarning``, or with ``strict_input=True`` a ``ValueError``, after the frame was processed.

        The GIL is released during the computation. Invalid arguments raise ``TypeError`` or ``ValueError`` with the
        found and the expected value, and leave the memory unchanged. Exceptions of the segmenter are passed on.
        """
        if distortion is not None:
            rgb, depth = self._lens.undistort(rgb, depth, K, _lens(distortion), depth_scale)
            depth_scale = None
        else:
            # The result keeps them, and cameras use their buffers again.
            rgb, depth = _copy(rgb), _copy(depth)
        ids, confidence, sightings, masks, times, pose, pose_state, remapped, regions, anchor = self._pipeline.step(
            rgb, depth, K, camera_to_world, timestamp, name, depth_scale
        )
        return StepResult(
            ids=ids,
            confidence=confidence,
            objects=Sightings(ObjectSighting(*sighting) for sighting in sightings),
            times_ms=dict(times),
            rgb=rgb,
            depth=depth,
            K=np.array(K, dtype=np.float64),
            camera_to_world=pose,
            pose_state=pose_state,
            remapped=remapped,
            timestamp=timestamp,
            name=name,
            regions=regions,
            _masks=masks,
            _depth_scale=depth_scale,
            _anchor=anchor,
        )

    def run(
        self, source: str | os.PathLike[str] | Iterable[Frame], *, progress: bool | None = None, **settings: Any
    ) -> Iterator[StepResult]:
        """Processes the frames of a scene, and yields the result of each::

            for r in seg.run("drive.mcap", stride=2):
                print(r.name, len(r.objects))

        ``source`` is what :func:`splatseg.open_scene` opens with ``settings``, or a scene or other frames. A path is opened
        with the pipeline's settings of the section ``dataset``, which ``settings`` override. With ``strict_input=True``, a
        frame of a path or scene that cannot be used raises ``ValueError``, where it is skipped otherwise. A terminal or
        notebook shows a progress bar if tqdm is installed; ``progress`` demands it (``True``) or leaves it out (``False``).

        Raises what :func:`splatseg.open_scene` and :meth:`step` do, ``ValueError`` if the scene has no depth and none is
        predicted in its place, and ``ImportError`` if a demanded bar is not possible.
        """
        frames: Iterable[Frame] = self._open(source, settings) if isinstance(source, str | os.PathLike) else source
        if settings and frames is source:
            raise TypeError(f"{', '.join(settings)}: settings are for a source that is opened here: a path")
        if isinstance(frames, Scene) and not frames.has_depth and not self._pipeline.predicts_all_depth:
            raise ValueError(
                f"{frames.path}: colour without depth, and depth is needed: make the pipeline with "
                'depth_predictor=ss.depth(FILE), predicted_depth="all"'
            )
        total = len(frames) if isinstance(frames, Sized) else None
        if isinstance(frames, Scene) and self.settings["strict_input"]:
            frames = frames._usable_frames()
        shown = with_progress(frames, progress, total)
        return (
            self.step(f.rgb, f.depth, K=f.K, camera_to_world=f.camera_to_world, timestamp=f.timestamp, name=f.name)
            for f in shown
        )

    def _open(self, path: str | os.PathLike[str], settings: dict[str, Any]) -> Scene:
        """Opens a scene with the settings of this pipeline and others."""
        own = {f"dataset.{name}": value for name, value in self.settings["dataset"].items()}
        # `step` converts the poses.
        converted = {name: own.pop(f"dataset.{name}") for name in _POSES_AS_THEY_ARE}
        for name, value in converted.items():
            if value != _POSES_AS_THEY_ARE[name] and (name in settings or f"dataset.{name}" in settings):
                raise TypeError(f"{name}: the pipeline has dataset.{name} already, and converts the poses")
        return open_scene(path, **{**own, **settings})

    def settle(self) -> bool:
        """Decides from all frames so far which parts of the map are one object.

        Every frame's evidence counts, where votes only remember the last few frames. Objects keep their ids as far as they
        are still one object. Call it after the last frame, and then :meth:`look_again`: ``splatseg run`` does the same.
        Returns ``False``, and changes nothing, if the segmenter does not say how surely pixels belong together; the default
        one does.
        """
        return self._pipeline.settle()

    def look_again(self, result: StepResult) -> NDArray[np.uint32]:
        """The ids of an earlier frame as they are known now: uint32, ``(height, width)``.

        ``result`` is what :meth:`step` returned for the frame. What later frames have taught also names the objects of the
        first ones; ``splatseg run`` does this for every frame at the end. The frame is looked at from where it is by now: if
        a closed loop has corrected the camera's path, from the corrected pose. Without a known pose, the ids stay as they
        are.

        Raises ``ValueError`` if the method cannot: only ``fastsam-splat`` with ``memory.kind=evidence`` can.
        """
        if result.pose_state == "lost":
            return result.ids
        return self._pipeline.look_again(
            result.rgb,
            result.depth,
            result.K,
            result.camera_to_world,
            result.ids,
            result.regions,
            result._depth_scale,
            result._anchor,
        )

    def objects(self) -> Objects:
        """The objects that are in the memory and that two frames or more show, the longest seen first, with their shapes in
        the world."""
        return Objects(parse(entry) for entry in json.loads(self._pipeline.objects())["objects"])

    def name_objects(self, fn: Names | Callable[[NDArray[np.uint8], NDArray[np.bool_], Object], Name]) -> int:
        """Names objects with ``fn(rgb, mask, object)``, e.g. a CLIP network; returns for how many it was called.

        ``fn`` can also be a network of :func:`names`: it looks at up to four views of each object, and chooses the labels
        of all objects together.

        ``rgb``: the best view so far, uint8 ``(height, width, 3)``, sRGB, at most 224 pixels wide and high. ``mask``: the
        object's pixels in it, bool ``(height, width)``. It returns a label, an embedding (a vector whose length is the same
        for all), a pair of both, a pair of a label and its score (a number from 0 to 1), or ``None``. It is called for
        objects without a name, and again for those whose best view has become clearly better. :meth:`objects` has the
        labels, :meth:`save` saves the names.

        Exceptions of ``fn`` are passed on; names given before stay. Raises ``ValueError`` for an unusable name, without
        ``keep_views=True``, and for a loaded map before its first frame. Objects of a loaded map that were not seen again
        are told in a ``UserWarning``.
        """
        if isinstance(fn, Names):
            return self._pipeline.name_with_network(fn._names)
        named = self._pipeline.name_objects(
            lambda rgb, mask, entry: _name(fn(rgb, mask, parse(json.loads(entry))))
        )
        if self._is_loaded:
            self._tell_unseen()
        return named

    def _tell_unseen(self) -> None:
        """Tells which objects of a loaded map have no view."""
        objects = [entry for entry in self.objects() if entry.state != "forgotten"]
        unseen = sum(entry.best_view is None and entry.label is None for entry in objects)
        text = (
            f"{unseen} of {len(objects)} objects have no view, because a saved map has none: pass frames that show them"
        )
        if unseen and self.frames == 0:
            raise ValueError(f"{text}, or name the map from its keyframes with the command splatseg name")
        if unseen:
            warnings.warn(f"{text}; they were not named", stacklevel=3)

    def finish_names(self) -> int:
        """Names objects with the namer of the settings, ``namer="clip", names="FILE.safetensors"``; returns for how many.

        A network takes longer than a frame may, so it is used only here: call it after the last frame, or when the frames
        pause. Only objects without a name, or with a clearly better view, are looked at.
        """
        return self._pipeline.finish_names()

    def name_by_hand(self, id: int, label: str | None) -> None:
        """Gives an object a label that no namer replaces, or takes its label away with ``None``.

        Raises ``ValueError`` if the label cannot be used.
        """
        self._pipeline.name_by_hand(id, label)

    def find(self, what: str | ArrayLike, top: int = 5) -> list[FoundObject]:
        """The named objects that are still there and fit best, at most ``top``.

        ``what`` is a text, e.g. ``"red mug"`` or ``"the smallest box"``: labels, their synonyms, colours and sizes count, and
        with a network of :func:`names` or of the settings also pictures. Or it is an embedding: then the most similar come
        first. Raises ``ValueError`` if the embedding has another length than those of the objects.
        """
        is_text = isinstance(what, str)
        found = self._pipeline.find_text(what) if isinstance(what, str) else self._pipeline.find(_vector(what))
        entries = {entry.id: entry for entry in self.objects()} if found else {}
        return [
            FoundObject(entries[id], None if is_text else value, value if is_text else None)
            for id, value in found[: max(top, 0)]
            if id in entries
        ]

    def clear_names(self) -> None:
        """Drops all names, e.g. before a loaded map is named with another network."""
        self._pipeline.clear_names()

    @property
    def memory(self) -> Memory:
        """The map. Raises ``ValueError`` if the method has none."""
        if not self._pipeline.has_memory:
            raise ValueError(f"the method {self.settings['method']} has no memory")
        return Memory(self._pipeline)

    @property
    def frames(self) -> int:
        """Number of processed frames."""
        return self._compiled.frames

    @property
    def settings(self) -> dict[str, Any]:
        """All settings, as in ``summary.json``."""
        settings: dict[str, Any] = json.loads(self._compiled.settings)
        return settings

    def save(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Saves the memory as a PLY file, which Gaussian splat viewers can open and :meth:`load` reads.

        Raises ``FileExistsError`` if the file exists, unless ``overwrite``; ``ValueError`` without a memory.
        """
        require_new(path, overwrite)
        self._pipeline.save(path)

    def __repr__(self) -> str:
        return f"<splatseg.{type(self).__name__}: {self.settings['method']}, {self.frames} frames>"

    def _repr_html_(self) -> str:
        from .pictures import objects_table

        return objects_table(self.objects(), f"objects of {repr(self).strip('<>')}")


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
        keep_views: bool = False,
        **settings: Any,
    ) -> None:
        _require_no_method(self, settings)
        super().__init__(None, segmenter, config=config, keep_views=keep_views, **settings)


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
        keep_views: bool = False,
        **settings: Any,
    ) -> None:
        _require_no_method(self, settings)
        super().__init__(None, segmenter, config=config, keep_views=keep_views, tracker_weights=weights, **settings)


def _require_no_method(pipeline: Pipeline, settings: dict[str, Any]) -> None:
    if "method" in settings:
        own = f"{type(pipeline).__name__} is the method {pipeline._method}"
        raise TypeError(f"{own}: use ss.Pipeline({settings['method']!r}) for another one")


def _name(name: Name) -> tuple[str | None, NDArray[np.float32], float | None]:
    """The label, the embedding and the score that a function has returned."""
    nothing = np.empty(0, np.float32)
    if name is None or isinstance(name, str):
        return name, nothing, None
    if isinstance(name, tuple) and len(name) == 2 and (name[0] is None or isinstance(name[0], str)):
        label, other = name
        if other is None:
            return label, nothing, None
        if label is not None and np.ndim(other) == 0 and isinstance(other, (int, float, np.number)):
            if not 0 <= other <= 1:
                raise ValueError(f"the score of the label {label!r} is {other}, expected 0 to 1")
            return label, nothing, float(other)
        return label, _vector(other), None
    return None, _vector(cast(ArrayLike, name)), None


def _copy(image: Any) -> Any:
    """A copy of an array that can be used; what cannot be is told later."""
    return image.copy() if isinstance(image, np.ndarray) and image.flags.c_contiguous else image


def _lens(distortion: tuple[str, Sequence[float]]) -> tuple[str, list[float]]:
    """A checked model of a lens and its coefficients."""
    expected = 'expected a model and its coefficients, e.g. ("plumb_bob", [k1, k2, p1, p2, k3])'
    try:
        model, coefficients = distortion
        numbers = np.asarray(coefficients, np.float64)
    except (TypeError, ValueError):
        raise TypeError(f"distortion is {distortion!r}, {expected}") from None
    if not isinstance(model, str):
        raise TypeError(f"distortion is {distortion!r}, {expected}")
    if numbers.ndim != 1:
        raise ValueError(f"the coefficients of distortion have shape {numbers.shape}, {expected}")
    return model, numbers.tolist()


def _vector(embedding: ArrayLike) -> NDArray[np.float32]:
    try:
        vector = np.asarray(embedding, dtype=np.float32)
    except (TypeError, ValueError):
        raise TypeError(
            f"the embedding is of type {type(embedding).__name__}, expected a vector of numbers, e.g. (512,)"
        ) from None
    if vector.ndim != 1:
        raise ValueError(f"the embedding has shape {vector.shape}, expected a vector, e.g. (512,)")
    return np.ascontiguousarray(vector)
