#!/usr/bin/env python3
"""Writes one depth image in every kind of file that is read, by the programs that usually write them.

Needs `pip install numpy opencv-python-headless tifffile OpenEXR`:
    python tools/make_depth_test_data.py [--folder crates/dataset/tests/data/depth_files]

Integers are millimetres, numbers with fractions metres. `depth.json` has the millimetres, row by row, 0 where there is no
depth: in integers that is 0 or 65535, in other numbers 0, NaN, infinity or a negative number.
"""

import argparse
import json
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import tifffile

WIDTH, HEIGHT = 11, 19


def write_npy(path, array, version):
    with open(path, "wb") as file:
        np.lib.format.write_array(file, array, version=version)


def write_exr(path, channels, compression):
    header = {"compression": compression, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path("crates/dataset/tests/data/depth_files"))
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)

    # Multiples of 1/128 m are exact in half precision below 8 m, and whole in the file of micrometres.
    steps = np.random.default_rng(7).integers(64, 1000, (HEIGHT, WIDTH))
    missing = np.random.default_rng(8).random((HEIGHT, WIDTH)) < 0.2
    steps[missing] = 0
    millimetres = np.round(steps / 128 * 1000).astype(np.uint16)
    metres = (steps / 128).astype(np.float32)
    integers = millimetres.copy()
    integers[0, 0] = 65535
    floats = metres.copy()
    floats[0, :4] = [np.nan, np.inf, -np.inf, -1.5]
    millimetres[0, :4] = [0] * 4
    integers[0, 1:4] = 0

    cv2.imwrite(str(folder / "integers.png"), integers)
    cv2.imwrite(str(folder / "integers_opencv.tiff"), integers)
    cv2.imwrite(str(folder / "floats_opencv.tiff"), floats)
    tifffile.imwrite(folder / "integers_plain.tiff", integers)
    tifffile.imwrite(folder / "floats_plain.tiff", floats)
    tifffile.imwrite(folder / "floats_big_endian.tiff", floats, byteorder=">")
    tifffile.imwrite(folder / "integers_deflate.tiff", integers, compression="zlib", predictor=True)
    tifffile.imwrite(folder / "doubles_tiles.tiff", floats.astype(np.float64), tile=(16, 16))
    write_npy(folder / "integers.npy", integers, (1, 0))
    write_npy(folder / "halves.npy", floats.astype(np.float16), (1, 0))
    write_npy(folder / "floats.npy", floats, (2, 0))
    write_npy(folder / "doubles.npy", floats.astype(np.float64)[:, :, None], (3, 0))
    cv2.imwrite(str(folder / "floats_opencv.pfm"), floats)
    write_exr(folder / "halves_rle.exr", {"Y": floats.astype(np.float16)}, OpenEXR.RLE_COMPRESSION)
    write_exr(folder / "floats_zip.exr", {"Z": floats}, OpenEXR.ZIP_COMPRESSION)
    write_exr(folder / "floats_none.exr", {"Z": floats}, OpenEXR.NO_COMPRESSION)
    write_exr(folder / "floats_zips.exr", {"Z": floats}, OpenEXR.ZIPS_COMPRESSION)
    rgb = np.zeros((HEIGHT, WIDTH, 3), np.float16)
    write_exr(folder / "layers_zip.exr", {"RGB": rgb, "view.Depth": floats}, OpenEXR.ZIP_COMPRESSION)
    # What is told, not read.
    write_exr(folder / "refused_piz.exr", {"Z": floats}, OpenEXR.PIZ_COMPRESSION)
    write_exr(folder / "refused_colour.exr", {"RGB": rgb}, OpenEXR.ZIP_COMPRESSION)
    tifffile.imwrite(folder / "refused_colour.tiff", np.zeros((HEIGHT, WIDTH, 3), np.uint8))
    write_npy(folder / "refused_big_endian.npy", integers.astype(">u2"), (1, 0))

    text = json.dumps({"width": WIDTH, "height": HEIGHT, "millimetres": millimetres.flatten().tolist()})
    (folder / "depth.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
