"""``splatseg-view``: the results of ``splatseg run`` in the Rerun viewer."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from . import objects
from .scene import Scene, open_scene


def main() -> None:
    """The command ``splatseg-view``."""
    parser = argparse.ArgumentParser(prog="splatseg-view", description=__doc__.partition(": ")[2].capitalize())
    parser.add_argument("out", type=Path, help="the output folder of splatseg run")
    parser.add_argument("--save", type=Path, metavar="FILE.rrd", help="write a recording instead of opening the viewer")
    arguments = parser.parse_args()
    try:
        view(arguments.out, arguments.save)
    except ImportError:
        sys.exit("error: splatseg-view needs Rerun: pip install rerun-sdk")
    except (OSError, ValueError, KeyError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def view(out: Path, save: Path | None = None) -> None:
    """Shows the results in a folder: overlays, the scene's camera and its path, and the objects' boxes.

    Raises ``ValueError`` if the folder has no results, or its scene cannot be read any more.
    """
    import rerun as rr

    if not (out / "summary.json").is_file():
        raise ValueError(f"{out}: has no summary.json, expected the folder of a splatseg run")
    summary = json.loads((out / "summary.json").read_bytes())
    scene = open_scene(_scene_path(out, summary), **summary["settings"]["dataset"])
    with rr.RecordingStream(f"splatseg {scene.name}") as recording:
        if save is None:
            recording.spawn()
        else:
            recording.save(save)
        _log_frames(out, scene)
        _log_boxes(out)
        recording.flush()


def _scene_path(out: Path, summary: dict[str, Any]) -> str:
    """The scene of a run: its path is relative to the folder of the run, if the summary says so."""
    beside = out / summary["scene"].partition(":")[0]
    return str(out / summary["scene"]) if "paths" in summary and beside.exists() else str(summary["scene"])


def _log_frames(out: Path, scene: Scene) -> None:
    import rerun as rr

    rr.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    path = []
    for number, frame in enumerate(scene):
        overlay, pose = _overlay(out, frame.name), frame.camera_to_world
        if overlay is None or pose is None:
            continue
        rr.set_time("frame", sequence=number)
        path.append(pose[:3, 3])
        height, width = frame.depth.shape
        rr.log("world/camera", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]))
        pinhole = rr.Pinhole(image_from_camera=frame.K, width=width, height=height, camera_xyz=rr.ViewCoordinates.RDF)
        rr.log("world/camera/image", pinhole)
        rr.log("world/camera/image/overlay", rr.EncodedImage(path=overlay))
        rr.log("world/path", rr.LineStrips3D([path]))


def _log_boxes(out: Path) -> None:
    import rerun as rr

    entries = json.loads((out / "objects.json").read_bytes())["objects"]
    shown = [(entry.id, entry.shape) for entry in map(objects.parse, entries) if entry.shape is not None]
    boxes = rr.Boxes3D(
        centers=[shape.center for _, shape in shown],
        sizes=[shape.size for _, shape in shown],
        quaternions=[rr.Quaternion(xyzw=shape.rotation) for _, shape in shown],
        labels=[str(id) for id, _ in shown],
    )
    rr.log("world/boxes", boxes, static=True)


def _overlay(out: Path, name: str) -> Path | None:
    """The overlay of a frame; numeric names have leading zeros in file names."""
    for file in (name, name.zfill(6)):
        path = out / "overlay" / f"{file}.jpg"
        if path.is_file():
            return path
    return None
