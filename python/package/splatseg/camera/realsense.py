"""RealSense cameras, with the package ``pyrealsense2``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyrealsense2 as rs

from . import Picture, camera_matrix


@contextmanager
def pictures(size: tuple[int, int], rate: int) -> Iterator[Iterator[Picture]]:
    """As :func:`splatseg.camera.open_camera`."""
    (width, height), rate = size if any(size) else (640, 480), rate or 30
    camera, config = rs.pipeline(), rs.config()
    config.enable_stream(rs.stream.color, width, height, rs.format.rgb8, rate)
    config.enable_stream(rs.stream.depth, width, height, rs.format.z16, rate)
    profile = camera.start(config)
    try:
        # Units per metre, e.g. 1000.0000474974513.
        scale = round(1 / profile.get_device().first_depth_sensor().get_depth_scale(), 2)
        yield _pictures(camera, rs.align(rs.stream.color), scale, rate)
    finally:
        camera.stop()


def _pictures(camera: Any, align: Any, scale: float, rate: int) -> Iterator[Picture]:
    while True:
        # The SDK keeps only the newest pair.
        pair = align.process(camera.wait_for_frames())
        color, depth = pair.get_color_frame(), pair.get_depth_frame()
        if not (color and depth) or _milliseconds_between(color, depth) > 750 / rate:
            continue
        lens = color.profile.as_video_stream_profile().intrinsics
        yield Picture(
            # The SDK uses the memory again.
            rgb=np.array(color.get_data()),
            depth=np.array(depth.get_data()),
            K=camera_matrix(lens.fx, lens.fy, lens.ppx, lens.ppy),
            depth_scale=scale,
            timestamp=color.get_timestamp() / 1000,
            distortion=_distortion(lens),
        )


def _milliseconds_between(color: Any, depth: Any) -> float:
    """How far apart they were taken: while the SDK finds out what belongs together, it also pairs neighbours."""
    if color.get_frame_timestamp_domain() != depth.get_frame_timestamp_domain():
        return 0.0
    return abs(float(color.get_timestamp() - depth.get_timestamp()))


def _distortion(lens: Any) -> tuple[str, list[float]] | None:
    models = rs.distortion
    if lens.model not in (models.brown_conrady, models.modified_brown_conrady, models.inverse_brown_conrady):
        return None
    # The SDK projects the inverse model forwards, too, and its ROS driver calls all of them plumb_bob.
    return ("plumb_bob", list(lens.coeffs)) if any(lens.coeffs) else None
