"""Results in the Rerun viewer. Needs ``pip install splatseg[rerun]``.

::

    import rerun as rr, splatseg as ss

    rr.init("kitchen", spawn=True)
    for f in ss.open_scene("kitchen"):
        r = seg.step(f.rgb, f.depth, K=f.K, camera_to_world=f.camera_to_world, timestamp=f.timestamp)
        ss.rerun.log(r, seg)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from . import _splatseg

if TYPE_CHECKING:
    import rerun

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
    import rerun as rr

    frame = pipeline.frames - 1 if pipeline is not None else None
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
    if np.issubdtype(result.depth.dtype, np.floating):
        depth = np.nan_to_num(result.depth.astype(np.float32))
        rr.log("world/camera/image/depth", rr.DepthImage(depth, meter=1.0), recording=recording)
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
    if pipeline is not None and frame is not None and frame % _MAP_EVERY == 0:
        log_map(pipeline, recording=recording)


def log_map(pipeline: Pipeline, *, recording: rerun.RecordingStream | None = None) -> None:
    """Logs the map as points in their objects' colours, and a box with its id for each object."""
    import rerun as rr

    if not pipeline._pipeline.has_memory:
        return
    memory = pipeline.memory
    ids = memory.segment_ids
    shown_ids, of_point = np.unique(ids, return_inverse=True)
    palette = [_splatseg.segment_color(int(id)) if id else (128, 128, 128) for id in shown_ids]
    colors = np.array(palette, dtype=np.uint8).reshape(-1, 3)[of_point]
    points = rr.Points3D(memory.means, colors=colors, radii=memory.radii)
    rr.log("world/map", points, recording=recording)
    entries = [entry for entry in pipeline.objects() if entry.state == "remembered"]
    shown = [(entry.id, entry.shape) for entry in entries if entry.shape is not None]
    boxes = rr.Boxes3D(
        centers=[shape.center for _, shape in shown],
        sizes=[shape.size for _, shape in shown],
        quaternions=[rr.Quaternion(xyzw=shape.rotation) for _, shape in shown],
        colors=[_splatseg.segment_color(id) for id, _ in shown],
        labels=[str(id) for id, _ in shown],
        show_labels=False,
    )
    rr.log("world/boxes", boxes, recording=recording)
