"""The loop of a live camera: frames arrive at any time, and only the newest one is used.

    python live_camera.py

`FakeCamera` works like pyrealsense2 and depthai: it takes pictures by itself, and `wait` returns the newest. Depth is
uint16 millimetres. The pose comes from odometry, SLAM or a robot's arm.
"""

import threading
import time

import numpy as np
import splatseg as ss
from numpy.typing import NDArray

Picture = tuple[NDArray[np.uint8], NDArray[np.uint16], NDArray[np.float64], NDArray[np.float64] | None, float]
"""Colour, depth in millimetres, camera matrix, pose, time."""


class FakeCamera:
    """A camera that takes a picture of a synthetic room every `interval` seconds."""

    def __init__(self, scene: str, interval: float) -> None:
        self.scene, self.interval = ss.open_scene(scene), interval
        self.newest: Picture | None = None
        self.ready, self.is_over = threading.Condition(), False
        threading.Thread(target=self._take_pictures, daemon=True).start()

    def _take_pictures(self) -> None:
        for frame in self.scene:
            millimetres = np.round(frame.depth * 1000).astype(np.uint16)
            with self.ready:
                self.newest = (frame.rgb, millimetres, frame.K, frame.camera_to_world, time.time())
                self.ready.notify()
            time.sleep(self.interval)
        with self.ready:
            self.is_over = True
            self.ready.notify()

    def wait(self) -> Picture | None:
        """Waits for the newest picture not returned yet; returns None at the end."""
        with self.ready:
            self.ready.wait_for(lambda: self.newest is not None or self.is_over)
            picture, self.newest = self.newest, None
            return picture


def main(scene: str = "synthetic:frames=30,width=96,height=72,objects=6", interval: float = 0.02) -> ss.Pipeline:
    pipeline = ss.FastSamSplat()
    camera = FakeCamera(scene, interval)
    while (picture := camera.wait()) is not None:
        rgb, depth, K, camera_to_world, taken = picture
        result = pipeline.step(
            rgb, depth, K=K, camera_to_world=camera_to_world, timestamp=taken, depth_scale=1000
        )  # fmt: skip
        print(f"{len(result.objects)} objects, {1000 * (time.time() - taken):.0f} ms after the picture")
    return pipeline


if __name__ == "__main__":
    main()
