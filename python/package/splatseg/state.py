"""What is saved with a map besides its Gaussians, as arrays."""

from __future__ import annotations

import json
import os
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np

# Version of the form that this package reads.
_VERSION = 1
_TYPES = {
    "U8": "u1",
    "I8": "i1",
    "U16": "<u2",
    "I16": "<i2",
    "U32": "<u4",
    "I32": "<i4",
    "U64": "<u8",
    "I64": "<i8",
    "F32": "<f4",
    "F64": "<f8",
}


def read_state(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read what a saved map contains besides its Gaussians: keyframes, names and the state of the memory.

    Returns arrays by name. Entries whose name ends in ``.json`` are what the JSON says, and ``writer`` is the program
    that wrote the file. Arrays cannot be changed; copy them for that. Also reads the ``.safetensors``
    files in ``.splatseg-resume``.

    Row ``k`` of ``keyframes.id`` and ``keyframes.world_from_camera`` belongs to keyframe ``k``, and so do the bytes of
    ``keyframes.color`` from ``keyframes.color_offsets[k]`` to ``keyframes.color_offsets[k + 1]``: a small JPEG file.
    ``keyframes.size`` (width and height) and ``keyframes.intrinsics`` (fx, fy, cx, cy, pixels) are those of
    ``keyframes.grey`` and ``keyframes.depth``. The JPEG may be larger, up to 320 pixels wide or high: scale them to it::

        state = splatseg.read_state("map.ply")
        start, end = state["keyframes.color_offsets"][:2]
        image = PIL.Image.open(io.BytesIO(state["keyframes.color"][start:end]))
        (fx, fy, cx, cy), (width, height) = state["keyframes.intrinsics"][0], state["keyframes.size"][0]
        x, y = image.width / width, image.height / height
        K = [[fx * x, 0, (cx + 0.5) * x - 0.5], [0, fy * y, (cy + 0.5) * y - 0.5], [0, 0, 1]]

    All arrays are described in docs/SAVED_STATE.md. Raises ``ValueError`` for a file that is damaged or of another
    version, and ``OSError`` if it cannot be read.
    """
    data = Path(path).read_bytes()
    try:
        if data.startswith(b"ply\n"):
            data = _behind_gaussians(data)
        return _arrays(data) if data else {}
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise ValueError(f"{os.fspath(path)}: {error}") from None


def _behind_gaussians(data: bytes) -> bytes:
    """The bytes of the state in a saved map."""
    header = data[: data.find(b"end_header\n")]
    found = re.search(rb"^comment splatseg memory (\d+) .*?(?:state (\d+))?$", header, re.MULTILINE)
    if not found:
        raise ValueError("not a splatseg memory")
    if found[1] != b"5" or not found[2]:
        version = found[1].decode()
        raise ValueError(f"version {version} of the splatseg memory format, expected 5: load it and save it again")
    length = int(found[2])
    if length + 4 > len(data) - len(header):
        raise ValueError("cut off or damaged")
    if zlib.crc32(memoryview(data)[:-4]) != int.from_bytes(data[-4:], "little"):
        raise ValueError("damaged: the checksum is wrong")
    return data[len(data) - 4 - length : -4]


def _arrays(data: bytes) -> dict[str, Any]:
    """The arrays of a safetensors file."""
    start = 8 + int.from_bytes(data[:8], "little")
    if not 8 < start <= len(data):
        raise ValueError("not a saved state")
    header = json.loads(data[8:start])
    version = int(header.pop("__metadata__")["splatseg_state"])
    if version > _VERSION:
        raise ValueError(f"version {version} of the saved state, expected {_VERSION}: update splatseg")
    state: dict[str, Any] = {}
    for name, entry in header.items():
        begin, end = entry["data_offsets"]
        array = np.frombuffer(data[start + begin : start + end], _TYPES[entry["dtype"]])
        state[name] = array.reshape(entry["shape"])
        if name.endswith(".json"):
            state[name] = json.loads(array.tobytes())
    if "writer" in state:
        state["writer"] = state["writer"].tobytes().decode()
    return state
