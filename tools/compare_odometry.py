#!/usr/bin/env python3
"""Compares camera trackers on the same frames in one run: Open3D, OpenCV, small_gicp and splatseg.

    pip install evo==1.38.1 open3d==0.20.0 opencv-python-headless==5.0.0.93 small_gicp==1.0.1    # Open3D needs libusb
    cargo build --profile dist
    python tools/compare_odometry.py ../shared/data/redkitchen_dense --splatseg target/dist/splatseg --out odometry

SCENE is a 7-Scenes folder with registered depth and camera-intrinsics.txt. Its pose files are the truth. Prints one
Markdown table and writes the trajectories to OUT/<size>/<tracker>.txt (TUM's format; a stamp is the frame's number / 30).

- ATE (after alignment without scale) and RPE (over --rpe-frames frames, all pairs) are root mean squares, computed by
  `evo`.
- The residual needs no truth: each tenth frame's depth is warped into the frame 10 before it; the median over all pixels
  of the absolute difference in depth.
- ms per frame: mean and, as other work on the machine disturbs it less, median, without reading and resizing the images.
  splatseg's is the stage named by --stage in its summary.json.

The other trackers align each frame with the one before it. Open3D: `compute_rgbd_odometry` with the hybrid term and the
previous motion as the start. OpenCV: `cv2.Odometry`, colour and depth. small_gicp: GICP on points 2 cm apart, with the
previous motion as the start. A frame that they cannot align repeats the previous motion, and is counted as failed.

All trackers get the same images, resized as splatseg does it: colour by a triangle filter, depth by taking the valid
measurement nearest to the new pixel's centre.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy
from evo.core import sync
from evo.core.metrics import PoseRelation, StatisticsType, Unit
from evo.core.trajectory import PoseTrajectory3D
from evo.main_ape import ape
from evo.main_rpe import rpe
from evo.tools import file_interface
from scipy.spatial.transform import Rotation

RATE = 30
# Frames between the two frames of a residual.
RESIDUAL_FRAMES = 10
# Depth that Kinect drivers write for missing measurements.
NO_MEASUREMENT = 65535
MAX_DEPTH_M = 4.0


def filter_weights(source, target):
    """The triangle filter that resizes an axis, [target, source]."""
    scale = source / target
    centers = (numpy.arange(target) + 0.5) * scale - 0.5
    apart = numpy.abs(numpy.arange(source)[None, :] - centers[:, None])
    weights = numpy.maximum(1 - apart / max(scale, 1.0), 0)
    return (weights / weights.sum(axis=1, keepdims=True)).astype(numpy.float32)


def resized_color(color, size):
    """The image at `size` (width, height), as splatseg resizes it."""
    if color.shape[1::-1] == size:
        return color
    columns, rows = filter_weights(color.shape[1], size[0]), filter_weights(color.shape[0], size[1])
    resized = numpy.einsum("ry,yxc,wx->rwc", rows, color.astype(numpy.float32), columns, optimize=True)
    return numpy.floor(resized + 0.5).clip(0, 255).astype(numpy.uint8)


def resized_depth(depth, size):
    """The depth at `size` (width, height), a whole fraction of its size, as splatseg resizes it."""
    if depth.shape[::-1] == size:
        return depth
    factor = depth.shape[1] // size[0]
    if (size[0] * factor, size[1] * factor) != depth.shape[::-1]:
        sys.exit(f"{size[0]}x{size[1]}: expected a whole fraction of {depth.shape[1]}x{depth.shape[0]}")
    blocks = depth.reshape(size[1], factor, size[0], factor).transpose(0, 2, 1, 3).reshape(size[1], size[0], -1)
    apart = numpy.arange(factor) - (factor - 1) / 2
    distance = (apart[:, None] ** 2 + apart[None, :] ** 2).ravel()
    # Of equally near measurements the first is taken.
    nearest = numpy.argmin(numpy.where(blocks > 0, distance, numpy.inf), axis=2)
    return numpy.take_along_axis(blocks, nearest[..., None], axis=2)[..., 0]


class Scene:
    """The frames of a 7-Scenes folder at one size."""

    def __init__(self, folder, size, count):
        paths = sorted(folder.glob("frame-*.color.*"))[:count]
        names = [path.name.split(".")[0] for path in paths]
        self.truth = [numpy.loadtxt(folder / f"{name}.pose.txt") for name in names]
        self.size, self.colors, self.depths = size, [], []
        for name, path in zip(names, paths, strict=True):
            color = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2RGB)
            depth = cv2.imread(str(folder / f"{name}.depth.png"), cv2.IMREAD_UNCHANGED)
            depth[depth == NO_MEASUREMENT] = 0
            self.colors.append(numpy.ascontiguousarray(resized_color(color, size)))
            self.depths.append(numpy.ascontiguousarray(resized_depth(depth.astype(numpy.float32) / 1000, size)))
        matrix = numpy.loadtxt(folder / "camera-intrinsics.txt")
        scale = numpy.array([size[0] / color.shape[1], size[1] / color.shape[0]])
        self.focal = matrix[[0, 1], [0, 1]] * scale
        # Pixel centres have integer coordinates.
        self.center = (matrix[:2, 2] + 0.5) * scale - 0.5

    def matrix(self):
        """The camera matrix."""
        return numpy.array([[self.focal[0], 0, self.center[0]], [0, self.focal[1], self.center[1]], [0, 0, 1]])

    def points(self, index):
        """The measured points of a frame in its camera's coordinates, [count, 3], metres."""
        rows, columns = numpy.nonzero(self.depths[index])
        depth = self.depths[index][rows, columns].astype(numpy.float64)
        rays = (numpy.stack([columns, rows], axis=1) - self.center) / self.focal
        return numpy.column_stack([rays * depth[:, None], depth])

    def differences(self, index, earlier, poses):
        """Absolute differences, metres, between the depth of a frame, warped into an earlier one, and the depth there."""
        move = numpy.linalg.inv(poses[earlier]) @ poses[index]
        points = self.points(index) @ move[:3, :3].T + move[:3, 3]
        points = points[points[:, 2] > 0]
        pixels = numpy.round(points[:, :2] / points[:, 2:] * self.focal + self.center).astype(int)
        inside = numpy.all((pixels >= 0) & (pixels < self.size), axis=1)
        points, pixels = points[inside], pixels[inside]
        there = self.depths[earlier][pixels[:, 1], pixels[:, 0]]
        return numpy.abs(points[:, 2] - there)[there > 0]


def open3d_aligner(scene):
    """Open3D's RGB-D odometry with the hybrid Jacobian."""
    import open3d

    camera = open3d.camera.PinholeCameraIntrinsic(*scene.size, *scene.focal, *scene.center)
    pipeline = open3d.pipelines.odometry
    method, options = pipeline.RGBDOdometryJacobianFromHybridTerm(), pipeline.OdometryOption(depth_max=MAX_DEPTH_M)

    def prepare(index):
        images = open3d.geometry.Image(scene.colors[index]), open3d.geometry.Image(scene.depths[index])
        return open3d.geometry.RGBDImage.create_from_color_and_depth(
            *images, depth_scale=1.0, depth_trunc=MAX_DEPTH_M, convert_rgb_to_intensity=True
        )

    def align(image, before, start):
        done, motion, _ = pipeline.compute_rgbd_odometry(image, before, camera, start, method, options)
        return motion if done else None

    return prepare, align


def opencv_aligner(scene):
    """OpenCV's odometry on colour and depth. It has no start."""
    settings = cv2.OdometrySettings()
    settings.setCameraMatrix(scene.matrix().astype(numpy.float32))
    odometry = cv2.Odometry(cv2.OdometryType_RGB_DEPTH, settings, cv2.OdometryAlgoType_COMMON)

    def prepare(index):
        depth = numpy.where(scene.depths[index] > 0, scene.depths[index], numpy.float32(numpy.nan))
        frame = cv2.OdometryFrame(depth, scene.colors[index])
        odometry.prepareFrame(frame)
        return frame

    def align(frame, before, _):
        done, motion = odometry.compute(frame, before)
        return motion if done else None

    return prepare, align


def small_gicp_aligner(scene, threads):
    """small_gicp's GICP on points 2 cm apart."""
    import small_gicp

    def prepare(index):
        points = scene.points(index)
        near = points[points[:, 2] < MAX_DEPTH_M]
        return small_gicp.preprocess_points(near, downsampling_resolution=0.02, num_neighbors=10, num_threads=threads)

    def align(image, before, start):
        (source, _), (target, tree) = image, before
        found = small_gicp.align(
            target, source, tree, start, max_correspondence_distance=0.1, num_threads=threads, max_iterations=30
        )
        return found.T_target_source if found.converged else None

    return prepare, align


def track(scene, aligner):
    """Poses by frame, seconds per frame, and the number of frames that failed."""
    prepare, align = aligner
    motion, before = numpy.eye(4), prepare(0)
    poses, seconds, failed = {0: numpy.eye(4)}, [], 0
    for index in range(1, len(scene.truth)):
        started = time.perf_counter()
        image = prepare(index)
        found = align(image, before, motion)
        seconds.append(time.perf_counter() - started)
        failed += found is None
        motion = motion if found is None else numpy.asarray(found, dtype=numpy.float64)
        poses[index], before = poses[index - 1] @ motion, image
    return poses, seconds, failed


def run_splatseg(arguments, scene, out):
    """Poses by frame, milliseconds per frame if they are known, and the number of frames without a pose."""
    size, count = f"{scene.size[0]}x{scene.size[1]}", str(len(scene.truth))
    command = [arguments.splatseg, "run", arguments.scene, "--resize", size, "--max-frames", count, "--no-page"]
    command += ["--out", out, "--overwrite", *arguments.splatseg_args.split()]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    summary = json.loads((out / "summary.json").read_text())
    stage = summary.get("stage_ms", {}).get(arguments.stage)
    trajectory = file_interface.read_tum_trajectory_file(str(out / "poses.txt"))
    indices = numpy.round(trajectory.timestamps * RATE).astype(int)
    poses = dict(zip(indices.tolist(), trajectory.poses_se3, strict=True))
    return poses, stage, len(scene.truth) - len(poses)


def trajectory_of(poses):
    """The poses as a trajectory of `evo`."""
    indices = sorted(poses)
    matrices = numpy.array([poses[index] for index in indices])
    turns = Rotation.from_matrix(matrices[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]]
    return PoseTrajectory3D(matrices[:, :3, 3], turns, numpy.array(indices) / RATE)


def errors(truth, estimate, frames):
    """ATE in cm, RPE in cm and in degrees."""
    pair = sync.associate_trajectories(truth, estimate)
    relative = {"delta": frames, "delta_unit": Unit.frames, "all_pairs": True, "support_loop": True}
    found = [
        ape(*pair, PoseRelation.translation_part, align=True),
        rpe(*pair, PoseRelation.translation_part, **relative),
        rpe(*pair, PoseRelation.rotation_angle_deg, **relative),
    ]
    ate, shift, turn = [result.stats[StatisticsType.rmse.value] for result in found]
    return 100 * ate, 100 * shift, turn


def residual_mm(scene, poses):
    """The median residual of every tenth frame, millimetres."""
    indices = range(RESIDUAL_FRAMES, len(scene.truth), RESIDUAL_FRAMES)
    pairs = [(index, index - RESIDUAL_FRAMES) for index in indices if {index, index - RESIDUAL_FRAMES} <= poses.keys()]
    found = [scene.differences(*pair, poses) for pair in pairs]
    return 1000 * float(numpy.median(numpy.concatenate(found))) if found else float("nan")


def times_text(seconds):
    """Mean and median in milliseconds."""
    return f"{1000 * numpy.mean(seconds):.1f} / {1000 * numpy.median(seconds):.1f}"


def rows_of(arguments, size):
    """The rows of the table for one size."""
    scene = Scene(arguments.scene, size, arguments.frames)
    truth, label = dict(enumerate(scene.truth)), f"{size[0]}x{size[1]}"
    out = arguments.out / label
    out.mkdir(parents=True, exist_ok=True)
    file_interface.write_tum_trajectory_file(str(out / "truth.txt"), trajectory_of(truth))
    yield f"| {label} | truth | - | - | - | - | {residual_mm(scene, truth):.2f} | - |"
    aligners = {
        "open3d": lambda: open3d_aligner(scene),
        "opencv": lambda: opencv_aligner(scene),
        "small_gicp": lambda: small_gicp_aligner(scene, arguments.threads),
    }
    for name in arguments.trackers + ["splatseg"] * (arguments.splatseg is not None):
        if name == "splatseg":
            poses, stage, failed = run_splatseg(arguments, scene, out / "splatseg")
            milliseconds = "-" if stage is None else f"{stage:.1f}"
        else:
            poses, seconds, failed = track(scene, aligners[name]())
            milliseconds = times_text(seconds)
        estimate = trajectory_of(poses)
        file_interface.write_tum_trajectory_file(str(out / f"{name}.txt"), estimate)
        ate, shift, turn = errors(trajectory_of(truth), estimate, arguments.rpe_frames)
        scores = f"{ate:.2f} | {shift:.2f} | {turn:.2f} | {milliseconds} | {residual_mm(scene, poses):.2f} | {failed}"
        yield f"| {label} | {name} | {scores} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--sizes", nargs="+", default=["320x240", "640x480"])
    parser.add_argument("--trackers", nargs="*", default=["open3d", "opencv", "small_gicp"])
    parser.add_argument("--frames", type=int, help="use only the first frames")
    parser.add_argument("--rpe-frames", type=int, default=30)
    parser.add_argument("--threads", type=int, default=2, help="threads of small_gicp")
    parser.add_argument("--splatseg", type=Path, help="the program, to compare it too")
    parser.add_argument("--splatseg-args", default="--poses track", help="further options of its run")
    parser.add_argument("--stage", default="pose", help="the stage of splatseg that tracks")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    relative = f"RPE {arguments.rpe_frames}"
    print(f"| size | tracker | ATE, cm | {relative}, cm | {relative}, ° | ms per frame | residual, mm | failed |")
    print("| --- | --- | --: | --: | --: | --: | --: | --: |", flush=True)
    for size in arguments.sizes:
        for row in rows_of(arguments, tuple(int(side) for side in size.split("x"))):
            print(row, flush=True)


if __name__ == "__main__":
    main()
