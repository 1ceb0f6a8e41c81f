#!/usr/bin/env python3
"""Makes small JPEG files of all kinds that the crate `jpeg` decodes, with libjpeg-turbo's pixels.

Needs `pip install pillow numpy` and libjpeg-turbo's `cjpeg` (Debian: libjpeg-turbo-progs):
    python tools/make_jpeg_test_data.py [--folder crates/jpeg/tests/data]

Writes NAME.jpg, made by cjpeg, and NAME.png, decoded by Pillow, and two files of kinds that the crate does not decode
(arithmetic.jpg, cmyk.jpg), without pixels. `--random COUNT` instead writes that many files of random kinds and sizes,
for checks beyond the committed files.
"""

import argparse
import io
import random
import subprocess
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image, features

SEPARATE_SCANS = "0;\n1;\n2;\n"
# Ends with the last refinements, so that the decoder smooths nothing.
UNUSUAL_PROGRESSION = """0,1,2: 0-0, 0, 2;
0: 1-3, 0, 1; 2: 1-63, 0, 0; 1: 1-20, 0, 3; 0: 4-63, 0, 0;
0,1,2: 0-0, 2, 1; 1: 21-63, 0, 0; 0: 1-3, 1, 0;
1: 1-20, 3, 2; 1: 1-20, 2, 1; 0,1,2: 0-0, 1, 0; 1: 1-20, 1, 0;
"""

# By name: seed, width, height, options of cjpeg, script of scans.
KINDS = {
    "444": (0, 43, 29, "-sample 1x1", None),
    "422": (1, 43, 29, "-sample 2x1", None),
    "420": (2, 43, 29, "-sample 2x2", None),
    "440": (3, 43, 29, "-sample 1x2", None),
    "411": (4, 43, 29, "-sample 4x1", None),
    "third": (5, 37, 29, "-sample 3x1", None),
    "mixed": (6, 37, 29, "-sample 2x2,1x2,2x1", None),
    "410": (7, 37, 29, "-sample 4x2,1x1,1x1", None),
    "worst": (9, 37, 29, "-sample 2x2 -quality 3", None),
    "grey": (10, 43, 29, "-grayscale", None),
    "rgb": (11, 37, 29, "-rgb", None),
    "progressive": (13, 43, 29, "-sample 2x2 -progressive", None),
    "progressive_unusual": (15, 37, 29, "-sample 2x1 -restart 3B", UNUSUAL_PROGRESSION),
    "separate_scans": (16, 37, 29, "-sample 2x2", SEPARATE_SCANS),
    "restarts": (17, 43, 29, "-sample 2x2 -restart 1B", None),
    "two_columns": (20, 3, 21, "-sample 2x2", None),
    "two_columns_422": (21, 4, 9, "-sample 2x1", None),
    "column_440": (23, 1, 19, "-sample 1x2", None),
}


def picture(width: int, height: int, seed: int) -> np.ndarray:
    """Waves, a sharp edge and saturated noise, `[height, width, 3]`."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:height, 0:width].astype(float)
    phase = rng.uniform(0, 6, 3)
    image = 128 + 100 * np.sin(np.stack([x / 5 + y / 9, x / 7 - y / 4, y / 6], axis=-1) + phase)
    image[(x + 2 * y > width)] *= [0.3, 1.0, 1.4]
    noisy = (y > 0.7 * height)[..., None] & (rng.random((height, width, 1)) < 0.5)
    image = np.where(noisy, rng.choice([0, 255], (height, width, 3)), image)
    return np.clip(image, 0, 255).astype(np.uint8)


def encode(image: np.ndarray, options: str, scans: str | None) -> bytes:
    """A JPEG by cjpeg."""
    with tempfile.TemporaryDirectory() as folder:
        ppm, script = Path(folder) / "in.ppm", Path(folder) / "scans"
        Image.fromarray(image).save(ppm)
        command = ["cjpeg", *options.split()]
        if scans:
            script.write_text(scans)
            command += ["-scans", str(script)]
        return subprocess.run([*command, str(ppm)], check=True, capture_output=True).stdout


def write(folder: Path, name: str, jpeg: bytes) -> None:
    """The JPEG and its pixels."""
    (folder / f"{name}.jpg").write_bytes(jpeg)
    Image.open(io.BytesIO(jpeg)).convert("RGB").save(folder / f"{name}.png", optimize=True)


def write_random(folder: Path, count: int) -> None:
    """Files of random kinds and sizes."""
    chosen = random.Random(1)
    samplings = ["1x1", "2x1", "2x2", "1x2", "4x1", "1x4", "2x4", "4x2", "3x1", "3x2,1x1,1x1"]
    samplings += ["2x2,1x2,2x1", "2x2,2x1,1x1"]
    for number in range(count):
        size = (chosen.randint(1, 90), chosen.randint(1, 90))
        kind = chosen.choice([f"-sample {sampling}" for sampling in samplings] + ["-grayscale", "-rgb"])
        restarts = ["-restart 2B", "-restart 1", "-progressive -restart 5B"]
        extra = chosen.choice(["", "-progressive", "-optimize", *restarts])
        options = f"{kind} {extra} -quality {chosen.randint(1, 100)}"
        write(folder, f"{number:04}", encode(picture(*size, number), options, None))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path("crates/jpeg/tests/data"))
    parser.add_argument("--random", type=int, default=0, metavar="COUNT")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    print(f"decoded by libjpeg-turbo {features.version('libjpeg_turbo')}")
    if options.random:
        write_random(options.folder, options.random)
        return
    for name, (seed, width, height, encoding, scans) in KINDS.items():
        write(options.folder, name, encode(picture(width, height, seed), encoding, scans))
    (options.folder / "arithmetic.jpg").write_bytes(encode(picture(16, 16, 0), "-arithmetic", None))
    Image.fromarray(picture(16, 24, 0)).convert("CMYK").save(options.folder / "cmyk.jpg")


if __name__ == "__main__":
    main()
