#!/usr/bin/env python3
"""Measures peak memory on small files that claim large contents, and on ordinary frames of several sizes.

    cargo build --profile dist
    tools/measure_memory.py --splatseg target/dist/splatseg

Makes the files in a temporary folder, runs `splatseg run` on each, and prints one line per input: size of the files,
peak memory, seconds, exit code and the last line of the program's output. Needs only Python's standard library and
Linux.
"""

import argparse
import json
import resource
import struct
import subprocess
import tempfile
import time
import zlib
from pathlib import Path

IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width, height, bits, color_type, row, extra=b""):
    """A PNG with identical rows. `extra` goes before the pixels."""
    packer = zlib.compressobj(9)
    data = b"".join(packer.compress(b"\0" + row) for _ in range(height)) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, bits, color_type, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + extra + chunk(b"IDAT", data) + chunk(b"IEND", b"")


def write_sevenscenes(folder, width, height, frames=1, extra=b""):
    folder.mkdir(parents=True)
    depth = png(width, height, 16, 0, struct.pack(">H", 2000) * width)
    color = png(width, height, 8, 2, bytes(3 * width), extra)
    for index in range(frames):
        (folder / f"frame-{index:06}.depth.png").write_bytes(depth)
        (folder / f"frame-{index:06}.color.png").write_bytes(color)
        (folder / f"frame-{index:06}.pose.txt").write_text(f"1 0 0 {0.01 * index}\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    focal = 0.9 * width
    (folder / "camera-intrinsics.txt").write_text(f"{focal} 0 {width / 2}\n0 {focal} {height / 2}\n0 0 1\n")
    return folder


def write_sens(folder, width, height):
    """A recording of one frame with a depth image much larger than the colour image."""
    folder.mkdir(parents=True)

    def camera(width, height):
        return [0.9 * width, 0, width / 2, 0, 0, 0.9 * width, height / 2, 0, 0, 0, 1, 0, 0, 0, 0, 1]

    data = struct.pack("<IQ", 4, 1) + b"x"
    for matrix in (camera(640, 480), IDENTITY, camera(width, height), IDENTITY):
        data += struct.pack("<16f", *matrix)
    data += struct.pack("<iiIIIIfQ", 1, 1, 640, 480, width, height, 1000.0, 1)
    color = png(640, 480, 8, 2, bytes(3 * 640))
    packer = zlib.compressobj(9)
    depth = b"".join(packer.compress(struct.pack("<H", 2000) * width) for _ in range(height)) + packer.flush()
    data += struct.pack("<16f", *IDENTITY) + struct.pack("<QQQQ", 1, 1, len(color), len(depth)) + color + depth
    (folder / "scene.sens").write_bytes(data)
    return folder / "scene.sens"


def annotation(width, height, counts):
    return json.dumps({"segmentation": {"size": [height, width], "counts": counts}}, separators=(",", ":"))


def half(width, height):
    """A mask of the middle half of the image."""
    quarter = width * height // 4
    return annotation(width, height, [quarter, 2 * quarter, width * height - 3 * quarter])


def spot(width, height, index, side=20):
    """A small square at a position that depends on `index`."""
    start = (index * 37) % (width - side) * height + (index * 53) % (height - side)
    counts = [start] + [side, height - side] * side
    counts[-1] = width * height - sum(counts[:-1])
    return annotation(width, height, counts)


def write_masks(folder, annotations):
    folder.mkdir(parents=True)
    (folder / "frame-000000.json").write_text("[" + ",".join(annotations) + "]")
    return folder


def bytes_of(path):
    files = [path] if path.is_file() else [file for file in path.rglob("*") if file.is_file()]
    return sum(file.stat().st_size for file in files)


def run(splatseg, scene, out, options):
    started = time.monotonic()
    with tempfile.TemporaryFile() as output:
        command = [splatseg, "run", str(scene), "--out", str(out), *map(str, options)]
        process = subprocess.Popen(command, stdout=output, stderr=output)
        peak = 0.0
        while process.poll() is None:
            peak = max(peak, peak_mb(process.pid))
            time.sleep(0.005)
        output.seek(0)
        lines = output.read().decode(errors="replace").strip().splitlines()
    said = next((line for line in lines if line.startswith("error")), lines[0] if lines else "")
    return peak, time.monotonic() - started, process.returncode, said


def peak_mb(pid):
    """Peak memory of a process, from /proc; the value of `wait4` would include this program's memory at the fork."""
    try:
        status = Path(f"/proc/{pid}/status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return 0.0
    line = next((line for line in status.splitlines() if line.startswith("VmHWM:")), "VmHWM: 0 kB")
    return int(line.split()[1]) / 1000


def cases(folder):
    """Yields name, scene, file or folder of the reported size, and options."""
    huge = write_sevenscenes(folder / "huge", 8192, 8192)
    sens = write_sens(folder / "sens", 8192, 8192)
    profile = chunk(b"iCCP", b"x\0\0" + zlib.compress(bytes(500 << 20), 9))
    colors = write_sevenscenes(folder / "profile", 64, 48, extra=profile)
    tablet = write_sevenscenes(folder / "tablet", 3840, 2880, frames=3)
    plain = write_sevenscenes(folder / "plain", 640, 480)
    masks = {
        "3,000 masks of 8192x8192": [half(8192, 8192)] * 3000,
        "60,000 masks of 20x20": [spot(640, 480, index) for index in range(60_000)],
        "60,000 masks of half the frame": [half(640, 480)] * 60_000,
        "70,000 masks": [spot(640, 480, index) for index in range(70_000)],
    }
    yield "one frame of 8192x8192", huge, huge, []
    yield "the same, --memory-limit 512MB", huge, huge, ["--memory-limit", "512MB"]
    yield ".sens, depth of 8192x8192", sens, sens, []
    yield "colour profile of 500 MB", colors, colors, []
    yield "3 frames of 3840x2880", tablet, tablet, []
    for index, (name, annotations) in enumerate(masks.items()):
        stored = write_masks(folder / f"masks-{index}", annotations)
        yield name, plain, stored, ["--segmenter", "masks", "--masks", stored]
    for size in ("320x240", "640x480", "1280x960", "1920x1080"):
        width, height = size.split("x")
        scene = f"synthetic:frames=20,seed=0,width={width},height={height},noise=kinect"
        yield f"20 frames of {size}", scene, None, []


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--splatseg", default="target/dist/splatseg", help="the program")
    arguments = parser.parse_args()
    # Protects the machine: exceeding this is a bug of the program.
    resource.setrlimit(resource.RLIMIT_AS, (16 << 30, 16 << 30))
    with tempfile.TemporaryDirectory(prefix="splatseg-memory-") as folder:
        print(f"{'input':32} {'kB':>8} {'peak MB':>8} {'s':>6} exit  what it said first, or its error")
        for index, (name, scene, shown, options) in enumerate(cases(Path(folder))):
            peak, seconds, code, said = run(arguments.splatseg, scene, Path(folder) / f"out-{index}", options)
            size = "" if shown is None else f"{bytes_of(shown) / 1000:.0f}"
            said = said.replace(folder + "/", "")[:110]
            print(f"{name:32} {size:>8} {peak:8.0f} {seconds:6.1f} {code:4}  {said}", flush=True)


if __name__ == "__main__":
    main()
