"""``python -m splatseg.camera``: a camera, live or recorded."""

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from .. import FastSamSplat
from . import PACKAGES, Picture, open_camera, png
from .recorder import Recorder, write

if TYPE_CHECKING:
    from ..pipeline import Pipeline

EXAMPLES = """examples:
  python -m splatseg.camera realsense --record desk      then: splatseg run desk --out out
  python -m splatseg.camera orbbec --map home.ply        Ctrl-C saves the map; started again, it goes on
  python -m splatseg.camera oak --view"""


def main(arguments: list[str] | None = None) -> int:
    """Runs the command, and returns its exit code: 0 done, 1 failed, 2 bad usage."""
    options = _parse(arguments)
    try:
        with ExitStack() as stack:
            pictures = stack.enter_context(open_camera(options.camera, options.size, options.rate))
            pictures = islice(pictures, options.frames)
            if options.record is not None:
                return _record(pictures, options.record)
            return _live(pictures, options, stack)
    except ImportError as error:
        packages = dict([PACKAGES[options.camera], ("rerun", "rerun-sdk")])
        if error.name in packages:
            return _failed(2, f"the package {error.name} is missing: pip install {packages[error.name]}")
        return _failed(2, str(error))
    except (ValueError, FileExistsError) as error:
        return _failed(2, str(error))
    except Exception as error:  # noqa: BLE001 (each vendor has errors of its own)
        return _failed(1, f"{options.camera}: {error}")


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m splatseg.camera",
        description="Takes in a camera through its vendor's package: gives its objects ids, or records it.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("camera", choices=PACKAGES)
    parser.add_argument("--record", type=Path, metavar="FOLDER", help="record for `splatseg run`, in the format folder")
    parser.add_argument("--map", type=Path, metavar="MAP.ply", help="go on with this map, if it exists, and save it")
    parser.add_argument("--ids", type=Path, metavar="FOLDER", help="write an id image of each frame")
    parser.add_argument("--view", action="store_true", help="show frames and map in Rerun (pip install rerun-sdk)")
    parser.add_argument("--config", type=Path, metavar="FILE", help="settings: TOML, or a run's summary.json")
    parser.add_argument("--size", type=_size, default=(0, 0), metavar="WxH", help="pixels of the pictures")
    parser.add_argument("--rate", type=_count, default=0, metavar="N", help="pictures per second")
    parser.add_argument("--frames", type=_count, metavar="N", help="stop after N frames; otherwise, after Ctrl-C")
    options = parser.parse_args(arguments)
    if options.record is not None and (options.map or options.ids or options.view or options.config):
        parser.error("--record only records: leave out --map, --ids, --view and --config")
    if options.map is not None and not options.map.parent.is_dir():
        parser.error(f"--map {options.map}: its folder does not exist")
    return options


def _size(text: str) -> tuple[int, int]:
    if not (match := re.fullmatch(r"([1-9]\d*)x([1-9]\d*)", text)):
        raise argparse.ArgumentTypeError(f"{text!r}, expected WIDTHxHEIGHT, e.g. 640x480")
    return int(match[1]), int(match[2])


def _count(text: str) -> int:
    if not re.fullmatch(r"[1-9]\d*", text):
        raise argparse.ArgumentTypeError(f"{text!r}, expected a whole number above 0")
    return int(text)


def _record(pictures: Iterator[Picture], folder: Path) -> int:
    with Recorder(folder) as recorder:
        try:
            for picture in pictures:
                recorder.add(picture)
                _status(f"{recorder.count} frames")
        except KeyboardInterrupt:
            pass
    print(f"{folder}: {recorder.count} frames: splatseg run {folder} --out out")
    return 0


def _live(pictures: Iterator[Picture], options: argparse.Namespace, stack: ExitStack) -> int:
    segmenter = _pipeline(options)
    logger = None
    if options.view:
        import rerun as rr

        from ..rerun import Logger

        rr.init("splatseg", spawn=True)
        logger = stack.enter_context(Logger())
    if options.ids is not None:
        options.ids.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    try:
        for number, p in enumerate(pictures):
            result = segmenter.step(
                p.rgb, p.depth, K=p.K, depth_scale=p.depth_scale, timestamp=p.timestamp, distortion=p.distortion
            )
            if options.ids is not None:
                write(options.ids / f"{number:06}.png", png.encode_ids(result.ids))
            if logger is not None:
                logger.log(result, segmenter)
            rate = (number + 1) / max(time.monotonic() - started, 1e-3)
            _status(f"{len(result.objects)} objects, camera {result.pose_state}, {rate:.1f} frames per second")
    except KeyboardInterrupt:
        pass
    finally:
        # Also if the camera was unplugged.
        if options.map is not None and segmenter.frames > 0:
            segmenter.save(options.map, overwrite=True)
    print(f"{segmenter.frames} frames, {len(segmenter.objects())} objects")
    return 0


def _pipeline(options: argparse.Namespace) -> Pipeline:
    if options.map is not None and options.map.exists():
        return FastSamSplat.load(options.map, config=options.config)
    return FastSamSplat(config=options.config)


def _status(text: str) -> None:
    """Shows a line in place of the one before, where somebody can see it."""
    if sys.stderr.isatty():
        print(f"\r{text:78}", end="", file=sys.stderr)


def _failed(code: int, text: str) -> int:
    print(f"error: {text}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(main())
