"""Builds rooms and writes them as labelled folders in ScanNet's exported layout."""

import json
import os
import shutil
import time
from typing import NamedTuple

import numpy as np
from PIL import Image

from . import views
from .cast import Camera, sensor_noise
from .furnish import furnish
from .render import Quality, Renderer, empty_scene
from .room import Room
from .shell import build

MESH = "surfaces.ply"


class Settings(NamedTuple):
    """Settings for writing a room; `rate` in Hz applies to the views "path"."""

    frames: int = 80
    views: str = "path"
    rate: float | None = None
    camera: Camera = Camera(320, 240)
    colour: bool = True
    quick: bool = False  # colours by `quick.py`
    sensor_noise: bool = False
    mesh: bool = False
    quality: Quality = Quality(6, 1)


def build_room(seed, library=None):
    """Builds a finished Room in Blender's otherwise empty scene."""
    empty_scene()
    room = Room(seed, library)
    build(room)
    furnish(room)
    room.finish()
    return room


def poses_of(room, settings):
    """The room's camera poses. This draws random numbers, so call it only once."""
    if settings.views == "path":
        return views.walk(room, settings.frames, settings.camera, settings.rate)
    return views.scattered(room, settings.frames, settings.camera)


def write_room(folder, seed, settings, library=None):
    """Builds and writes the room for a seed, unless the folder exists. Returns a line of status.

    An interrupted room leaves a hidden folder beside it, .NAME.tmp, which the next call replaces.
    """
    if os.path.exists(folder):
        return f"{folder}: exists, kept"
    start = time.time()
    room = build_room(seed, library)
    built = time.time()
    poses = poses_of(room, settings)
    parent, name = os.path.split(os.path.abspath(folder))
    staged = os.path.join(parent, f".{name}.tmp")  # hidden: patterns for --data do not match it
    shutil.rmtree(staged, ignore_errors=True)
    os.makedirs(staged)
    if settings.mesh:
        write_mesh(os.path.join(staged, MESH), np.concatenate(room.triangles), np.concatenate(room.ids))
    largest = _write_frames(staged, room, poses, seed, settings)
    names = {number + 1: name for number, name in enumerate(room.names)}
    with open(os.path.join(staged, "objects.json"), "w") as file:
        size = [room.width, room.depth, room.height]
        content = {"seed": seed, "kind": room.kind, "size": size, "instances": names, "largest_view_px": largest}
        json.dump(content, file)
    os.rename(staged, folder)
    each = (time.time() - built) / max(len(poses), 1)
    imported = f", {room.imported} of them imported" if library else ""
    return (
        f"{folder}: {room.kind} {room.width:.1f}x{room.depth:.1f} m, {len(names)} instances{imported}, "
        f"{len(poses)} frames, room {built - start:.1f} s, {each:.2f} s/frame"
    )


def write_mesh(path, triangles, ids):
    """Writes triangles [F, 3, 3] with ids [F] as a PLY file like those of `splatseg export --as mesh`: metres, the poses'
    world, and `segment_id` of each vertex. Triangles share no vertices."""
    corners = len(triangles) * 3
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment exact surfaces\n"
        f"element vertex {corners}\nproperty float x\nproperty float y\nproperty float z\nproperty int segment_id\n"
        f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    vertices = np.zeros(corners, [("place", "<f4", 3), ("segment_id", "<i4")])
    vertices["place"], vertices["segment_id"] = triangles.reshape(-1, 3), np.repeat(ids, 3)
    faces = np.zeros(len(triangles), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, np.arange(corners).reshape(-1, 3)
    with open(path, "wb") as file:
        file.write(header.encode() + vertices.tobytes() + faces.tobytes())


def _renderer(room, settings, rng):
    if not settings.quick:
        return Renderer(room, settings.camera, settings.quality)
    from .quick import QuickRenderer  # which needs embreex

    return QuickRenderer(room, settings.camera, rng)


def _write_frames(folder, room, poses, seed, settings):
    """Writes cameras and frames; returns the largest area of each id in any frame, pixels."""
    kinds = ["color", "depth"] if settings.colour else ["depth"]
    for name in [*kinds, "pose", "intrinsic", "instance-filt"]:
        os.makedirs(os.path.join(folder, name), exist_ok=True)
    for kind in kinds:
        path = os.path.join(folder, "intrinsic")
        np.savetxt(os.path.join(path, f"intrinsic_{kind}.txt"), settings.camera.matrix, "%.6f")
        np.savetxt(os.path.join(path, f"extrinsic_{kind}.txt"), np.eye(4), "%.6f")
    rng, largest = np.random.default_rng([seed, 7]), {}
    renderer = _renderer(room, settings, rng) if settings.colour else None
    if renderer:
        renderer.expose(poses[:: max(1, len(poses) // 6)])
    for number, pose in enumerate(poses):
        if renderer:
            image = Image.fromarray(renderer.colours(pose, rng))
            image.save(os.path.join(folder, "color", f"{number}.jpg"), quality=92)
        view = renderer.view(pose) if settings.quick else room.caster.cast(pose, settings.camera)
        z = view.depth
        if settings.sensor_noise:
            z = sensor_noise(view, room.caster, pose, settings.camera, rng)
        z = np.where((z > 0) & (z <= 10), np.rint(z * 1000), 0).astype(np.uint16)
        Image.fromarray(z).save(os.path.join(folder, "depth", f"{number}.png"))
        Image.fromarray(view.ids.astype(np.uint16)).save(os.path.join(folder, "instance-filt", f"{number}.png"))
        np.savetxt(os.path.join(folder, "pose", f"{number}.txt"), pose, "%.8f")
        for id, area in zip(*np.unique(view.ids, return_counts=True)):
            largest[int(id)] = max(largest.get(int(id), 0), int(area))
    return largest
