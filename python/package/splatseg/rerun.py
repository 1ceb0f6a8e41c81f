"""Results in the Rerun viewer. Needs ``pip install rerun-sdk``.

::

    import rerun as rr, splatseg as ss

    rr.init("kitchen", spawn=True)
    for f in ss.open_scene("kitchen"):
        r = seg.step(f.rgb, f.depth, K=f.K, camera_to_world=f.camera_to_world, timestamp=f.timestamp)
        ss.rerun.log(r, seg)

With a live camera, log on another thread, so that a slow viewer delays no frame::

    with ss.rerun.Logger() as logger:
        ...
        logger.log(r, seg)
"""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _splatseg
from .optional import require

if TYPE_CHECKING:
    import rerun
    from typing_extensions import Self

    from .objects import Shape
    from .pipeline import Pipeline
    from .result import StepResult

_MAP_EVERY = 10
"""Interval, in frames, at which the map and the boxes are logged: they are large and change little."""


def log(
    result: StepResult, pipeline: Pipeline | None = None, *, recording: rerun.RecordingStream | None = None
) -> None:
    """Logs a frame with its result (picture, depth, ids, camera and boxes) and, every 10 frames, the map and the
    objects' 3D boxes of ``pipeline``.

    Logs to ``recording``, by default Rerun's current recording. Ids have the same colours as in overlays.
    """
    frame = pipeline.frames - 1 if pipeline is not None else None
    _log_frame(result, frame, recording)
    if pipeline is not None and frame is not None and frame % _MAP_EVERY == 0:
        log_map(pipeline, recording=recording)


def _rerun() -> Any:
    return require("rerun", "rerun-sdk", "ss.rerun")


def _log_frame(result: StepResult, frame: int | None, recording: rerun.RecordingStream | None) -> None:
    rr = _rerun()
    if frame is not None:
        rr.set_time("frame", sequence=frame, recording=recording)
    if result.timestamp is not None:
        rr.set_time("time", duration=result.timestamp, recording=recording)
    height, width = result.ids.shape
    pose = result.camera_to_world
    rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, recording=recording)
    rr.log("world/camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), recording=recording)
    rr.log(
        "world/camera/image",
        rr.Pinhole(image_from_camera=result.K, width=width, height=height, camera_xyz=rr.ViewCoordinates.RDF),
        recording=recording,
    )
    rr.log("world/camera/image/rgb", rr.Image(result.rgb).compress(jpeg_quality=85), recording=recording)
    depth = np.nan_to_num(result.depth.astype(np.float32))
    depth_image = rr.DepthImage(depth, meter=result._depth_scale or 1.0)
    rr.log("world/camera/image/depth", depth_image, recording=recording)
    annotation = [(sighting.id, str(sighting.id), sighting.color) for sighting in result.objects]
    rr.log("world/camera/image", rr.AnnotationContext(annotation), recording=recording)
    rr.log("world/camera/image/ids", rr.SegmentationImage(result.ids), recording=recording)
    boxes = np.array([sighting.bounding_box for sighting in result.objects], dtype=np.float32).reshape(-1, 4)
    rr.log(
        "world/camera/image/boxes",
        rr.Boxes2D(
            array=boxes, array_format=rr.Box2DFormat.XYWH, class_ids=[sighting.id for sighting in result.objects]
        ),
        recording=recording,
    )


def log_map(pipeline: Pipeline, *, recording: rerun.RecordingStream | None = None) -> None:
    """Logs the map as points in their objects' colours, and a box with id and label for each object."""
    if shown := _Map.of(pipeline):
        shown.log(recording)


@dataclass(frozen=True)
class _Map:
    """What is shown of a map."""

    means: NDArray[np.float32]
    radii: NDArray[np.float32]
    ids: NDArray[np.uint32]
    shapes: list[tuple[int, Shape]]
    labels: list[str]

    @classmethod
    def of(cls, pipeline: Pipeline) -> _Map | None:
        if not pipeline._pipeline.has_memory:
            return None
        memory = pipeline.memory
        entries = [entry for entry in pipeline.objects() if entry.state == "remembered" and entry.shape is not None]
        shapes = [(entry.id, entry.shape) for entry in entries if entry.shape is not None]
        labels = [f"{entry.id} {entry.label or ''}".rstrip() for entry in entries]
        shown = memory.has_place
        means = memory.means[shown].astype(np.float32)
        return cls(means, memory.radii[shown], memory.segment_ids[shown], shapes, labels)

    def log(self, recording: rerun.RecordingStream | None) -> None:
        rr = _rerun()
        shown_ids, of_point = np.unique(self.ids, return_inverse=True)
        palette = [_splatseg.segment_color(int(id)) if id else (128, 128, 128) for id in shown_ids]
        colors = np.array(palette, dtype=np.uint8).reshape(-1, 3)[of_point]
        rr.log("world/map", rr.Points3D(self.means, colors=colors, radii=self.radii), recording=recording)
        boxes = rr.Boxes3D(
            centers=[shape.center for _, shape in self.shapes],
            sizes=[shape.size for _, shape in self.shapes],
            quaternions=[rr.Quaternion(xyzw=shape.rotation) for _, shape in self.shapes],
            colors=[_splatseg.segment_color(id) for id, _ in self.shapes],
            labels=self.labels,
            show_labels=False,
        )
        rr.log("world/boxes", boxes, recording=recording)


class Logger:
    """Logs frames like :func:`log`, on a thread of its own. The newest frame replaces one that was not logged yet.

    The map is logged every ``map_interval`` seconds, while the viewer keeps up. ``recording`` is by default Rerun's current
    recording. ``dropped`` counts the frames that were replaced. After an exception of
    Rerun nothing is logged any more: every further :meth:`log` raises it, or :meth:`close` if there is none.
    """

    def __init__(self, recording: rerun.RecordingStream | None = None, *, map_interval: float = 2.0) -> None:
        rr = _rerun()
        self.dropped = 0
        self._recording = recording or rr.get_data_recording()
        self._map_interval, self._map_logged = map_interval, -float("inf")
        self._news = threading.Condition()
        self._frame: tuple[StepResult, int | None] | None = None
        self._map: _Map | None = None
        self._is_busy = self._is_over = False
        self._error: Exception | None = None
        self._is_error_raised = False
        self._thread = threading.Thread(target=self._run, name="rerun", daemon=True)
        self._thread.start()

    def log(self, result: StepResult, pipeline: Pipeline | None = None) -> None:
        """Passes a frame on, and at times the map of ``pipeline``, and returns at once."""
        self._raise_error(again=True)
        now = time.monotonic()
        shown = None
        if pipeline is not None and not self._is_busy and now - self._map_logged >= self._map_interval:
            self._map_logged, shown = now, _Map.of(pipeline)
        with self._news:
            self.dropped += self._frame is not None
            self._frame = (result, pipeline.frames - 1 if pipeline is not None else None)
            self._map = shown or self._map
            self._news.notify()

    def close(self) -> None:
        """Logs what is left, and ends the thread."""
        with self._news:
            self._is_over = True
            self._news.notify()
        self._thread.join()
        self._raise_error(again=False)

    def _raise_error(self, *, again: bool) -> None:
        """Raises what has ended the thread, if anything has."""
        if self._error is not None and (again or not self._is_error_raised):
            self._is_error_raised = True
            raise self._error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _run(self) -> None:
        try:
            self._log_all()
        except Exception as error:  # noqa: BLE001 - the caller of `log` gets it
            self._error = error

    def _log_all(self) -> None:
        while True:
            with self._news:
                self._is_busy = False
                self._news.wait_for(lambda: self._frame is not None or self._is_over)
                frame, self._frame = self._frame, None
                shown, self._map = self._map, None
                self._is_busy = True
            if frame is None:
                return
            _log_frame(*frame, self._recording)
            if shown is not None:
                shown.log(self._recording)
