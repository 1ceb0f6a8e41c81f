"""The eight input channels of the affinity network, computed as in `crates/segmenter/src/affinity/inputs.rs`.

Both follow this definition; a golden test compares them (`training/make_test_data.py`).

1. Frames with more than `max_pixels` pixels are reduced by s = sqrt(max_pixels / pixels) to floor(width * s) ×
   floor(height * s) pixels: colour by the area mean (rounded), depth by the pixel nearest to the centre, halfway the left
   or upper one: (floor(((2x + 1) * W - 1) / 2w), floor(((2y + 1) * H - 1) / 2h)).
2. Colour: rgb / 127.5 - 1.
3. Holes in the depth get the depth of the nearest valid pixel, in city-block distance. First within a row, where left
   wins ties. Then, row by row downwards, a pixel takes the value of the pixel above if that is nearer (distance above + 1
   < own distance), and upwards in the same way from the pixel below. Depth beyond 100 m becomes 100 m.
4. Inverse depth: 1 / max(z, 0.3 m) - 0.5.
5. Validity: 1 where depth was measured.
6. Smoothed depth: the mean over the 13 pixels within distance 2, weighted by exp(-dz² / (2 · 0.05²) - r² / (2 · 2²)) with
   dz in metres and r in pixels; beyond the border, the nearest pixel is repeated.
7. Normals: with the points P of the smoothed depth, dx = P(x + 2) - P(x - 2), and dy likewise; within 2 pixels of the
   border, the nearest existing difference. The normal is dx × dy / (|dx × dy| + 1e-9), pointing away from the camera; 0
   if that is not finite or the image has fewer than 5 rows or columns.

A frame without depth has 0 in all five depth channels.
"""

import cv2
import numpy as np

MAX_PIXELS = 76800
CHANNELS = 8
_FARTHEST = np.float32(100.0)
_FAR = np.int32(1 << 20)
_NEIGHBOURS = [(dy, dx) for dy in range(-2, 3) for dx in range(-2, 3) if dy * dy + dx * dx <= 4]


def reduced(rgb, depth_mm, K, max_pixels=MAX_PIXELS):
    """Image, depth and camera matrix of a frame at the network's size.

    `rgb` [H, W, 3] uint8, `depth_mm` [H, W] of the same size, `K` 3×3 (or larger) for integer pixel centres.
    """
    height, width = depth_mm.shape
    if width * height <= max_pixels:
        return rgb, depth_mm, K
    scale = np.sqrt(max_pixels / (width * height))
    w, h = max(1, int(width * scale)), max(1, int(height * scale))
    small = cv2.resize(rgb, (w, h), interpolation=cv2.INTER_AREA)
    depth = nearest(depth_mm, (w, h))
    K = np.array(K, np.float64)
    K[0, 0], K[1, 1] = K[0, 0] * w / width, K[1, 1] * h / height
    K[0, 2], K[1, 2] = (K[0, 2] + 0.5) * w / width - 0.5, (K[1, 2] + 0.5) * h / height - 0.5
    return small, depth, K


def nearest(image, size):
    """`image` [H, W] at `size` (width, height): the pixel nearest to each new one's centre, halfway the left or upper
    one."""
    (height, width), (w, h) = image.shape, size
    rows = ((2 * np.arange(h) + 1) * height - 1) // (2 * h)
    columns = ((2 * np.arange(w) + 1) * width - 1) // (2 * w)
    return image[rows[:, None], columns[None]]


def filled(z):
    """Depth in metres, [H, W], with every hole (0) filled from the nearest pixel; at least one pixel must be valid."""
    height, width = z.shape
    columns = np.arange(width, dtype=np.int32)
    left = np.maximum.accumulate(np.where(z > 0, columns, -_FAR), axis=1)
    right = np.minimum.accumulate(np.where(z > 0, columns, _FAR)[:, ::-1], axis=1)[:, ::-1]
    nearest = np.where(columns - left <= right - columns, left, right)
    distance = np.minimum(columns - left, right - columns)
    z = np.take_along_axis(z, np.clip(nearest, 0, width - 1), axis=1)
    for rows in (range(1, height), range(height - 2, -1, -1)):
        for row in rows:
            nearer = distance[row - rows.step] + 1 < distance[row]
            np.copyto(distance[row], distance[row - rows.step] + 1, where=nearer)
            np.copyto(z[row], z[row - rows.step], where=nearer)
    return z


def smoothed(z):
    """Bilaterally smoothed depth, [H, W] float32 metres."""
    height, width = z.shape
    padded = np.pad(z, 2, mode="edge")
    total, weights = np.zeros_like(z), np.zeros_like(z)
    for dy, dx in _NEIGHBOURS:
        near = padded[2 + dy : 2 + dy + height, 2 + dx : 2 + dx + width]
        step = near - z
        weight = np.exp(step * step * np.float32(-200.0) - np.float32((dy * dy + dx * dx) / 8))
        total += weight * near
        weights += weight
    return total / weights


def normals(z, K):
    """Unit normals, [3, H, W] float32, from depth in metres."""
    height, width = z.shape
    if min(height, width) < 5:
        return np.zeros((3, height, width), np.float32)
    x = ((np.arange(width, dtype=np.float32) - np.float32(K[0, 2])) / np.float32(K[0, 0]))[None]
    y = ((np.arange(height, dtype=np.float32) - np.float32(K[1, 2])) / np.float32(K[1, 1]))[:, None]
    points = np.stack([z * x, z * y, z])
    dx, dy = np.empty_like(points), np.empty_like(points)
    np.subtract(points[:, :, 4:], points[:, :, :-4], out=dx[:, :, 2:-2])
    np.subtract(points[:, 4:], points[:, :-4], out=dy[:, 2:-2])
    dx[:, :, :2], dx[:, :, -2:] = dx[:, :, 2:3], dx[:, :, -3:-2]
    dy[:, :2], dy[:, -2:] = dy[:, 2:3], dy[:, -3:-2]
    with np.errstate(over="ignore", invalid="ignore"):
        product = np.stack([dx[i] * dy[j] - dx[j] * dy[i] for i, j in ((1, 2), (2, 0), (0, 1))])
        result = product / (np.sqrt((product * product).sum(0)) + np.float32(1e-9))
    return np.where(np.isfinite(result).all(0), result, np.float32(0))


def inputs(rgb, depth_mm, K):
    """The network's input, float32 [8, H, W], for a frame of at most `MAX_PIXELS` pixels (see `reduced`).

    `rgb` [H, W, 3] uint8, `depth_mm` [H, W] in millimetres (0 where missing), `K` 3×3 or larger.
    """
    out = np.zeros((CHANNELS, *depth_mm.shape), np.float32)
    out[:3] = rgb.transpose(2, 0, 1).astype(np.float32) / np.float32(127.5) - 1
    z = np.minimum(depth_mm.astype(np.float32) / np.float32(1000), _FARTHEST)
    if not z.any():
        return out
    full = filled(z)
    out[3] = 1 / np.maximum(full, np.float32(0.3)) - np.float32(0.5)
    out[4] = z > 0
    out[5:] = normals(smoothed(full), np.asarray(K))
    return out
