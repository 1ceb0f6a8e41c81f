"""Orbbec cameras, with the package ``pyorbbecsdk2`` (version 2 of the SDK)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pyorbbecsdk as ob

from . import Picture, camera_matrix


@contextmanager
def pictures(size: tuple[int, int], rate: int) -> Iterator[Iterator[Picture]]:
    """As :func:`splatseg.camera.open_camera`."""
    # Cameras have 640 x 480 or 640 x 360.
    (width, height), rate = size if any(size) else (640, 0), rate or 30
    camera, config = ob.Pipeline(), ob.Config()
    colors = camera.get_stream_profile_list(ob.OBSensorType.COLOR_SENSOR)
    depths = camera.get_stream_profile_list(ob.OBSensorType.DEPTH_SENSOR)
    config.enable_stream(colors.get_video_stream_profile(width, height, ob.OBFormat.RGB, rate))
    config.enable_stream(depths.get_default_video_stream_profile())
    config.set_frame_aggregate_output_mode(ob.OBFrameAggregateOutputMode.FULL_FRAME_REQUIRE)
    camera.enable_frame_sync()
    camera.start(config)
    try:
        yield _pictures(camera, ob.AlignFilter(align_to_stream=ob.OBStreamType.COLOR_STREAM))
    finally:
        camera.stop()


def _pictures(camera: Any, align: Any) -> Iterator[Picture]:
    while True:
        pair = camera.wait_for_frames(100)  # milliseconds
        pair = pair and align.process(pair)
        pair = pair and pair.as_frame_set()
        if not pair or not (color := pair.get_color_frame()) or not (depth := pair.get_depth_frame()):
            continue
        size = (color.get_height(), color.get_width())
        profile = color.get_stream_profile().as_video_stream_profile()
        lens = profile.get_intrinsic()
        yield Picture(
            # The SDK uses the memory again.
            rgb=np.frombuffer(color.get_data(), np.uint8).reshape(*size, 3).copy(),
            depth=np.frombuffer(depth.get_data(), np.uint16).reshape(size).copy(),
            K=camera_matrix(lens.fx, lens.fy, lens.cx, lens.cy),
            # The SDK's scale is millimetres per unit.
            depth_scale=1000 / depth.get_depth_scale(),
            timestamp=color.get_timestamp_us() / 1e6,
            distortion=_distortion(profile.get_distortion()),
        )


def _distortion(lens: Any) -> tuple[str, list[float]] | None:
    """The distortion of colour, to which the SDK's filter also bends depth."""
    fisheye = [lens.k1, lens.k2, lens.k3, lens.k4]
    coefficients = [lens.k1, lens.k2, lens.p1, lens.p2, lens.k3, lens.k4, lens.k5, lens.k6]
    if lens.model == ob.OBCameraDistortionModel.NONE or not any(coefficients):
        return None
    if lens.model == ob.OBCameraDistortionModel.KANNALA_BRANDT4:
        return "equidistant", fisheye
    return "rational_polynomial", coefficients
