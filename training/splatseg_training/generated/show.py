"""Draws generated samples: `python -m splatseg_training.generated.show --out FOLDER --count 24 [--real FOLDER...]`.

Each image of FOLDER has rows of colour, measured depth, normals and ids, and of real frames for comparison.
"""

import argparse
import os

import cv2
import numpy as np

from .. import augment
from ..dataset import read_folder
from ..inputs import inputs
from .batches import groups

ACROSS = 6  # samples beside each other
SIZE = (256, 192)


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True)
    parser.add_argument("--count", type=int, default=24)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--real", nargs="*", default=[], metavar="FOLDER", help="labelled folders of a real camera")
    options = parser.parse_args(arguments)
    os.makedirs(options.out, exist_ok=True)
    write(options.out, "generated", generated(options.count, options.seed))
    for folder in options.real:
        write(options.out, os.path.basename(os.path.normpath(folder)), real(folder, options.count))


def write(folder, name, columns):
    """Writes columns of images, `ACROSS` beside each other, to numbered files."""
    for number in range(0, len(columns), ACROSS):
        image = np.concatenate([np.concatenate(column) for column in columns[number : number + ACROSS]], 1)
        cv2.imwrite(os.path.join(folder, f"{name}-{number // ACROSS}.png"), image[:, :, ::-1])


def generated(count, seed):
    """Columns of samples that were not turned, all with colour."""
    settings = augment.Settings(height=SIZE[1], width=SIZE[0], no_colour=0.0, no_depth=0.0, turn=0.0)
    columns = []
    for group, _ in groups(seed, 0, count, settings):
        for rgb, z, ids, camera in zip(group.rgb, group.z, group.ids, group.intrinsics):
            rgb = rgb.permute(1, 2, 0).numpy().astype(np.uint8)
            columns.append(_column(rgb, z.numpy(), ids.numpy(), camera.numpy()))
    return columns


def real(folder, count):
    """Columns of frames spread over a folder."""
    views = [view for _, view in read_folder(folder, size=SIZE)]
    views = views[:: max(1, len(views) // count)][:count]
    return [_column(view.colour, view.depth / np.float32(1000), view.ids, view.camera) for view in views]


def _column(rgb, z, ids, camera):
    """Images of a view [192, 256, 3]: colour, depth, normals, ids."""
    x = inputs(rgb, np.rint(z * 1000).astype(np.uint16), augment.matrix(camera))
    depth = cv2.applyColorMap(np.clip(z * 51, 0, 255).astype(np.uint8), cv2.COLORMAP_TURBO)[:, :, ::-1]
    depth = np.where(z[..., None] > 0, depth, 0)
    normals = (x[5:].transpose(1, 2, 0) * 127 + 128).astype(np.uint8)
    colours = np.random.default_rng(1).integers(40, 255, (int(ids.max()) + 1, 3)).astype(np.uint8)
    colours[0] = 0
    return [rgb, depth.astype(np.uint8), normals, colours[ids.astype(int)]]


if __name__ == "__main__":
    main()
