"""Labelled RGB-D views, read from folders in ScanNet's exported layout and kept in memory at a network's size.

A folder holds `depth/N.png` (uint16 millimetres, 0 = missing), `intrinsic/intrinsic_depth.txt`, instance ids (uint16, 0
= unlabelled) as `instance-filt/N.png` or in a `*instance-filt.zip`, and `color/N.jpg` or `.png`. A folder without
`color/` only teaches shape: its colours are synthesised (see `colour.paint`).
"""

import glob
import os
import zipfile
from typing import NamedTuple

import cv2
import numpy as np

from .inputs import nearest

SIZE = (320, 240)  # width and height of the affinity network's views


class View(NamedTuple):
    """A labelled view. Pixel centres are at integer coordinates."""

    colour: np.ndarray | None  # [H, W, 3] uint8 RGB
    depth: np.ndarray  # [H, W] uint16 millimetres, 0 = missing
    ids: np.ndarray  # [H, W] uint16, 0 = unlabelled
    camera: np.ndarray  # fx, fy, cx, cy in pixels


def read_folder(folder, every=1, size=SIZE):
    """All views of a folder, by name, at `size` (width, height): a list of (number, View)."""
    camera = np.loadtxt(os.path.join(folder, "intrinsic", "intrinsic_depth.txt"))
    archive = _archive(folder)
    numbers = sorted(int(os.path.basename(p)[:-4]) for p in glob.glob(os.path.join(folder, "depth", "*.png")))
    views = []
    for number in numbers[::every]:
        ids = _ids(folder, archive, number)
        if ids is not None:
            depth = _image(os.path.join(folder, "depth", f"{number}.png"))
            views.append((number, _view(_colour(folder, number), depth, ids, camera, size)))
    if not views:
        raise ValueError(f"{folder}: no labelled views; expected depth/N.png and instance-filt/N.png")
    return views


def read_groups(patterns, size=SIZE):
    """For each pattern, the views of all folders that match it. A repeated pattern is read once."""
    groups = {}
    for pattern in dict.fromkeys(patterns):
        folders = sorted(path for path in glob.glob(pattern) if os.path.isdir(path))
        if not folders:
            raise ValueError(f"no folder matches {pattern}")
        groups[pattern] = [view for folder in folders for _, view in read_folder(folder, size=size)]
        print(f"{pattern}: {len(groups[pattern])} views from {len(folders)} folders", flush=True)
    return [groups[pattern] for pattern in patterns]


def _view(colour, depth, ids, camera, size):
    """Reduces colour by the area mean, depth and ids by the nearest pixel, and adapts the camera to the reduced
    depth."""
    height, width = depth.shape
    sx, sy = size[0] / width, size[1] / height
    fx, fy = camera[0, 0] * sx, camera[1, 1] * sy
    cx, cy = (camera[0, 2] + 0.5) * sx - 0.5, (camera[1, 2] + 0.5) * sy - 0.5
    if colour is not None and colour.shape[1::-1] != size:
        colour = cv2.resize(colour, size, interpolation=cv2.INTER_AREA)
    return View(colour, nearest(depth, size), nearest(ids, size), np.array([fx, fy, cx, cy]))


def _image(path):
    image = cv2.imread(path, cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ValueError(f"{path}: not a readable image")
    return image.astype(np.uint16)


def _colour(folder, number):
    for ending in ("jpg", "png"):
        path = os.path.join(folder, "color", f"{number}.{ending}")
        if os.path.exists(path):
            return np.ascontiguousarray(cv2.imread(path)[:, :, ::-1])
    return None


def _archive(folder):
    paths = glob.glob(os.path.join(folder, "*instance-filt.zip"))
    return zipfile.ZipFile(paths[0]) if paths else None


def _ids(folder, archive, number):
    """Ids of a view, or None if it has no labels."""
    path = os.path.join(folder, "instance-filt", f"{number}.png")
    if os.path.exists(path):
        return _image(path)
    name = f"instance-filt/{number}.png"
    if archive is None or name not in archive.namelist():
        return None
    data = np.frombuffer(archive.read(name), np.uint8)
    return cv2.imdecode(data, cv2.IMREAD_UNCHANGED).astype(np.uint16)
