"""OAK cameras, with version 3 of the package ``depthai``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import depthai as dai
import numpy as np
from numpy.typing import NDArray

from . import Picture


@contextmanager
def pictures(size: tuple[int, int], rate: int) -> Iterator[Iterator[Picture]]:
    """As :func:`splatseg.camera.open_camera`."""
    size, rate = size if any(size) else (640, 400), rate or 15
    socket = dai.CameraBoardSocket.CAM_A
    with dai.Pipeline() as camera:
        center = camera.create(dai.node.Camera).build(socket)
        color = center.requestOutput(size, dai.ImgFrame.Type.RGB888i, fps=rate, enableUndistortion=True)
        stereo = camera.create(dai.node.StereoDepth).build(autoCreateCameras=True, fps=rate)
        align, pair = camera.create(dai.node.ImageAlign), camera.create(dai.node.Sync)
        stereo.depth.link(align.input)
        color.link(align.inputAlignTo)
        color.link(pair.inputs["color"])
        align.outputAligned.link(pair.inputs["depth"])
        newest = pair.out.createOutputQueue(maxSize=1, blocking=False)
        K = np.array(camera.getDefaultDevice().readCalibration().getCameraIntrinsics(socket, *size))
        camera.start()
        yield _pictures(newest, K)


def _pictures(newest: Any, K: NDArray[np.float64]) -> Iterator[Picture]:
    while True:
        images = newest.get()
        yield Picture(
            rgb=np.ascontiguousarray(images["color"].getFrame()),
            depth=np.ascontiguousarray(images["depth"].getFrame()),
            K=K,
            depth_scale=1000,
            timestamp=images["color"].getTimestamp().total_seconds(),
        )
