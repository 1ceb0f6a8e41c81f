"""Pictures of a camera in a folder, in splatseg's format ``folder``."""

from __future__ import annotations

import json
import os
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from . import Picture, png

if TYPE_CHECKING:
    from typing_extensions import Self

_WAITING = 16
"""Number of pictures that wait to be written, at most: then :meth:`Recorder.add` waits, and the camera drops pictures."""


class Recorder:
    """Writes pictures on threads of its own: ``color/TIME.png``, ``depth/TIME.png`` and ``camera.json``.

    ``count`` is their number. Raises ``FileExistsError`` if the folder exists and is not empty.
    """

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder, self.count = Path(folder), 0
        if self.folder.exists() and (not self.folder.is_dir() or any(self.folder.iterdir())):
            raise FileExistsError(f"{self.folder}: exists: choose another folder for the recording")
        for name in ("color", "depth"):
            (self.folder / name).mkdir(parents=True, exist_ok=True)
        self._latest = -float("inf")
        # Compression does not hold the GIL.
        self._threads = ThreadPoolExecutor(min(4, os.cpu_count() or 1))
        self._waiting: deque[Future[None]] = deque()

    def add(self, picture: Picture) -> None:
        """Takes in the next picture, unless it is the same again. Raises ``OSError`` if an earlier one cannot be written."""
        if picture.timestamp <= self._latest:
            return
        if self.count == 0:
            self._write(Path("camera.json"), json.dumps(_camera(picture), indent=2).encode())
        self._latest = picture.timestamp
        self.count += 1
        while len(self._waiting) >= _WAITING:
            self._waiting.popleft().result()
        self._waiting.append(self._threads.submit(self._save, picture))

    def close(self) -> None:
        """Waits until all pictures are written. Raises ``OSError`` if one cannot be."""
        self._threads.shutdown()
        while self._waiting:
            self._waiting.popleft().result()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _save(self, picture: Picture) -> None:
        # Seconds with a decimal point: by such names the format has times.
        name = f"{picture.timestamp:.6f}.png"
        self._write(Path("depth") / name, png.encode(picture.depth))
        self._write(Path("color") / name, png.encode(picture.rgb))

    def _write(self, name: Path, data: bytes) -> None:
        write(self.folder / name, data)


def write(path: Path, data: bytes) -> None:
    """Writes a file that appears complete or not at all."""
    # Names that start with a dot are no frames.
    temporary = path.with_name(f".writing-{path.name}.part")
    temporary.write_bytes(data)
    temporary.replace(path)


def _camera(picture: Picture) -> dict[str, object]:
    """The content of ``camera.json``."""
    height, width = picture.depth.shape
    K = picture.K
    camera = {"width": width, "height": height, "fx": K[0, 0], "fy": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
    camera["depth_scale"] = picture.depth_scale
    if picture.distortion is None:
        return camera
    model, coefficients = picture.distortion
    return {**camera, "distortion_model": model, "distortion_coefficients": coefficients}
