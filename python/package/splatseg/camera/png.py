"""PNG images without loss, fast rather than small."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

_GREY, _RGB = 0, 2
_UP = 2
"""The filter that stores differences to the row above."""


def encode(image: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """Encodes uint8 ``(height, width, 3)`` as RGB, and uint16 ``(height, width)`` as grey with 16 bits."""
    height, width = image.shape[:2]
    kind, bits = (_RGB, 8) if image.ndim == 3 else (_GREY, 16)
    rows = np.ascontiguousarray(image.astype(image.dtype.newbyteorder(">"))).view(np.uint8).reshape(height, -1)
    filtered = np.empty((height, rows.shape[1] + 1), np.uint8)
    filtered[:, 0] = _UP
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])
    header = struct.pack(">IIBBBBB", width, height, bits, kind, 0, 0, 0)
    data = zlib.compress(filtered.tobytes(), 1)
    chunks = [_chunk(b"IHDR", header), _chunk(b"IDAT", data), _chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def encode_ids(ids: NDArray[np.uint32]) -> bytes:
    """Encodes an image of ids as ``splatseg run`` does: 16-bit grey, or RGB if an id is above 65535."""
    if ids.max(initial=0) <= 0xFFFF:
        return encode(ids.astype(np.uint16))
    return encode(np.stack([ids & 0xFF, ids >> 8 & 0xFF, ids >> 16], axis=-1).astype(np.uint8))


def _chunk(name: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
