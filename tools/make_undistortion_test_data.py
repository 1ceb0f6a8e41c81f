#!/usr/bin/env python3
"""Writes OpenCV's undistorted images, to compare `splatseg_dataset::Undistortion` with.

Needs `pip install opencv-python-headless numpy`:
    python tools/make_undistortion_test_data.py [--folder crates/dataset/tests/data/undistort]

Writes the distorted color.png and depth.png, lenses.json with each lens's coefficients and OpenCV's source positions of
some pixels, and for each lens the undistorted LENS_color.png and LENS_depth.png.
"""

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

WIDTH, HEIGHT = 64, 48
# Off-centre, with non-square pixels.
K = np.array([[52.0, 0, 30.7], [0, 51.0, 24.9], [0, 0, 1]])
GRID_STEP = 7

# Coefficients as large as in calibrations of real cameras.
LENSES = {
    "plumb_bob": ("plumb_bob", [-0.28, 0.09, 0.0011, -0.0008, -0.012]),
    # Pincushion: sources lie inside the image.
    "pincushion": ("plumb_bob", [0.16, 0.02, -0.002, 0.003]),
    "rational_polynomial": ("rational_polynomial", [0.45, -2.6, 0.0006, -0.0003, 1.5, 0.33, -2.4, 1.44]),
    "thin_prism": (
        "rational_polynomial",
        [0.45, -2.6, 0.0006, -0.0003, 1.5, 0.33, -2.4, 1.44, 0.004, -0.001, -0.003, 0.002],
    ),
    "equidistant": ("equidistant", [-0.012, 0.004, -0.006, 0.0015]),
}


def undistortion_map(model, coefficients):
    d = np.array(coefficients)
    if model == "equidistant":
        return cv2.fisheye.initUndistortRectifyMap(K, d, np.eye(3), K, (WIDTH, HEIGHT), cv2.CV_32FC1)
    return cv2.initUndistortRectifyMap(K, d, None, K, (WIDTH, HEIGHT), cv2.CV_32FC1)


def color_picture():
    """Smooth, so that OpenCV's steps of 1/32 pixel do not show."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH].astype(float)
    waves = np.stack([x / 8 + y / 11, x / 13 - y / 7, x / 9], axis=-1)
    return np.round(128 + 100 * np.sin(waves)).astype(np.uint8)


def depth_picture():
    """Millimetres. All pixels differ, so that a wrong one is noticed; one in eight is missing."""
    depth = np.random.default_rng(5).permutation(WIDTH * HEIGHT).reshape(HEIGHT, WIDTH) + 500
    depth[np.random.default_rng(6).random((HEIGHT, WIDTH)) < 0.125] = 0
    return depth.astype(np.uint16)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path("crates/dataset/tests/data/undistort"))
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    color, depth = color_picture(), depth_picture()
    cv2.imwrite(str(folder / "color.png"), color[..., ::-1])
    cv2.imwrite(str(folder / "depth.png"), depth)
    lenses = []
    for name, (model, coefficients) in LENSES.items():
        map_x, map_y = undistortion_map(model, coefficients)
        undistorted = cv2.remap(color, map_x, map_y, cv2.INTER_LINEAR)
        cv2.imwrite(str(folder / f"{name}_color.png"), undistorted[..., ::-1])
        cv2.imwrite(str(folder / f"{name}_depth.png"), cv2.remap(depth, map_x, map_y, cv2.INTER_NEAREST))
        grid = [
            [column, row, round(float(map_x[row, column]), 4), round(float(map_y[row, column]), 4)]
            for row in range(0, HEIGHT, GRID_STEP)
            for column in range(0, WIDTH, GRID_STEP)
        ]
        lenses.append({"name": name, "model": model, "coefficients": coefficients, "sources": grid})
    camera = {"fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2], "width": WIDTH, "height": HEIGHT}
    # One line for each lens.
    lines = ",\n  ".join(json.dumps(lens) for lens in lenses)
    head = f'"opencv": "{cv2.__version__}", "camera": {json.dumps(camera)}'
    (folder / "lenses.json").write_text(f'{{{head}, "lenses": [\n  {lines}\n]}}\n')


if __name__ == "__main__":
    main()
