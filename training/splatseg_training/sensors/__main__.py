"""Pictures of the sensor models: `python -m splatseg_training.sensors FOLDER --out DIR --real KITCHEN HOLOLENS`.

Writes a PNG per view of the labelled FOLDER. Its first column has colour, exact depth and normals; the others have the
depth and normals that mild and harsh cameras of each kind measure. With --real, views of real cameras are written in
the same way, to compare. Depth is coloured from red at 0.5 m to blue at 5 m, on a logarithmic scale; missing depth is
black.
"""

import argparse
import os

import cv2
import numpy as np

from ..augment import matrix
from ..dataset import read_folder
from ..inputs import inputs
from .cameras import MILD, SHARES, draw_camera, measure_with
from .scene import Scene

STRENGTHS = {"mild": MILD / 2, "harsh": (1 + MILD) / 2}
NEAREST, FARTHEST = 0.5, 5.0  # metres, ends of the colour scale


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", help="labelled folder with exact depth")
    parser.add_argument("--out", required=True)
    parser.add_argument("--real", nargs="*", default=[], metavar="FOLDER", help="labelled folders of real cameras")
    parser.add_argument("--views", type=int, default=4, help="pictures of each folder")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args(arguments)
    os.makedirs(options.out, exist_ok=True)
    for number, view in _some(options.folder, options.views):
        _write(os.path.join(options.out, f"models-{number}.png"), modelled(view, [options.seed, number]))
    for folder in options.real:
        name = os.path.basename(os.path.normpath(folder))
        for number, view in _some(folder, options.views):
            z = view.depth.astype(np.float32) / 1000
            column = [_colour(view), depth_picture(z), normals_picture(z, view.camera)]
            _write(os.path.join(options.out, f"{name}-{number}.png"), np.hstack(column))


def modelled(view, seed):
    """A picture of a view as all kinds of cameras measure it."""
    z = view.depth.astype(np.float32) / 1000
    scene = Scene(z, view.colour, view.ids, view.camera)
    columns = [[_colour(view), depth_picture(z), normals_picture(z, view.camera), np.zeros((*z.shape, 3), np.uint8)]]
    for kind in SHARES:
        column = []
        for grade, strength in STRENGTHS.items():
            rng = np.random.default_rng([*seed, len(columns)])
            measured = measure_with(draw_camera(kind, strength, rng), scene, rng)
            pictures = depth_picture(measured), normals_picture(measured, view.camera)
            column += [_titled(picture, f"{kind}, {grade}") for picture in pictures]
        columns.append(column)
    return np.hstack([np.vstack(column) for column in columns])


def depth_picture(z):
    """Colours [H, W, 3] uint8 RGB of a depth in metres."""
    near = np.log(FARTHEST / np.maximum(z, 0.01)) / np.log(FARTHEST / NEAREST)
    picture = cv2.applyColorMap(np.clip(near * 255, 0, 255).astype(np.uint8), cv2.COLORMAP_TURBO)[:, :, ::-1]
    return picture * (z > 0)[..., None].astype(np.uint8)


def normals_picture(z, camera):
    """The normals [H, W, 3] uint8 that the network gets; black where depth is missing."""
    depth_mm = np.rint(z * 1000).clip(0, 65535).astype(np.uint16)
    normals = inputs(np.zeros((*z.shape, 3), np.uint8), depth_mm, matrix(camera))[5:]
    return ((normals.transpose(1, 2, 0) * 0.5 + 0.5) * 255 * (z > 0)[..., None]).astype(np.uint8)


def _some(folder, count):
    """Evenly spread views of a folder."""
    views = read_folder(folder)
    return views[:: max(1, len(views) // count)][:count]


def _colour(view):
    """The colours, or else a colour per object."""
    if view.colour is not None:
        return view.colour
    palette = np.random.default_rng(0).integers(40, 255, (int(view.ids.max()) + 1, 3))
    return palette.astype(np.uint8)[view.ids]


def _titled(picture, title):
    return cv2.putText(picture.copy(), title, (6, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)


def _write(path, picture):
    if not cv2.imwrite(path, np.ascontiguousarray(picture[:, :, ::-1])):
        raise OSError(f"{path}: cannot be written")


if __name__ == "__main__":
    main()
