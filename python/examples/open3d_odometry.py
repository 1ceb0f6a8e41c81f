"""Poses from Open3D's RGB-D odometry, for a camera without poses.

pip install open3d
python open3d_odometry.py [SCENE [FRAMES]]
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import open3d as o3d
import splatseg as ss
from numpy.typing import NDArray

DEMO = Path(__file__).resolve().parents[2] / "crates/splatseg-cli/demo"
"""The clip of `splatseg demo`. Odometry needs small camera motion from frame to frame and a structured scene."""


def rgbd(frame: ss.Frame) -> Any:
    color = o3d.geometry.Image(np.ascontiguousarray(frame.rgb))
    depth = o3d.geometry.Image(frame.depth)
    return o3d.geometry.RGBDImage.create_from_color_and_depth(
        color, depth, depth_scale=1.0, depth_trunc=10.0, convert_rgb_to_intensity=True
    )


def motion(before: ss.Frame, after: ss.Frame) -> NDArray[np.float64]:
    """The transform from camera coordinates in `after` to camera coordinates in `before`."""
    height, width = after.depth.shape
    K = after.K
    camera = o3d.camera.PinholeCameraIntrinsic(width, height, K[0, 0], K[1, 1], K[0, 2], K[1, 2])
    found, transform, _ = o3d.pipelines.odometry.compute_rgbd_odometry(rgbd(after), rgbd(before), camera, np.eye(4))
    if not found:
        raise RuntimeError(f"tracking was lost at frame {after.name}")
    return np.asarray(transform)


def main(scene: str | Path = DEMO, frames: int | str = 10) -> list[NDArray[np.float64]]:
    pipeline = ss.FastSamSplat()
    pose, before = np.eye(4), None
    poses: list[NDArray[np.float64]] = []
    for frame in ss.open_scene(scene, max_frames=int(frames)):
        if before is not None:
            pose = pose @ motion(before, frame)
        pipeline.step(frame.rgb, frame.depth, K=frame.K, camera_to_world=pose)
        before = frame
        poses.append(pose)
    print(pipeline)
    return poses


if __name__ == "__main__":
    main(*sys.argv[1:])
