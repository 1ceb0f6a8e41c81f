"""A depth sensor model: adds the errors of a Kinect or stereo camera to the exact depth of a rendered view.

All strengths are random per sample, from none to beyond a Kinect's, so that the weights suit good and bad sensors.
"""

import cv2
import numpy as np

FOCAL_BASELINE = 43.5  # pixels × metres: a Kinect's 580 px at 640 × 480 and 75 mm
STEPS_PER_PIXEL = 8  # of its disparity

_NOISE = np.random.default_rng(0).standard_normal(1 << 21, dtype=np.float32)


def white_noise(rng, shape):
    """Gaussian noise of this shape: a random part of a table, which is much faster than new random numbers."""
    count = int(np.prod(shape))
    start = rng.integers(len(_NOISE) - count)
    return _NOISE[start : start + count].reshape(shape)


def smooth_noise(rng, shape, cell):
    """Smooth Gaussian noise [H, W] with a scale of about `cell` pixels."""
    height, width = shape
    coarse = white_noise(rng, (height // cell + 2, width // cell + 2))
    return cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)


def measure(z, colour, ids, camera, rng):
    """Noisy depth in metres [H, W] float32, 0 = missing.

    `z` [H, W] metres (0 = missing), `colour` [H, W, 3] uint8 or None, `ids` [H, W], `camera` fx, fy, cx, cy.
    """
    if rng.random() < 0.05:
        return z
    strength = rng.uniform(0.1, 1.2)
    missing = _shadow(z, camera, rng) | _edges(z, rng) | _grazing(z, camera, rng) | _materials(colour, ids, rng)
    missing |= _blobs(z.shape, rng) | _border(z.shape, rng) | _out_of_range(z, rng)
    out = _disparity_noise(_jitter(z, strength, rng), strength, rng)
    out[missing | (z <= 0)] = 0
    return out


def _jitter(z, strength, rng):
    """Samples depth at points about half a pixel from each pixel's centre."""
    height, width = z.shape
    shift = np.rint(white_noise(rng, (2, height, width)) * 0.55 * strength).astype(np.int32)
    rows = np.clip(np.arange(height)[:, None] + shift[0], 0, height - 1)
    columns = np.clip(np.arange(width)[None] + shift[1], 0, width - 1)
    return z[rows, columns]


def _disparity_noise(z, strength, rng):
    """Adds white and smooth errors to the disparity, then rounds it to steps."""
    disparity = FOCAL_BASELINE * STEPS_PER_PIXEL * rng.uniform(0.7, 1.3) / np.maximum(z, 0.05)
    disparity = disparity.astype(np.float32)
    exact = disparity * z
    disparity += white_noise(rng, z.shape) * np.float32(rng.uniform(0.1, 0.7) * strength)
    for cell, size in ((3, 0.6), (12, 0.6), (50, 1.0)):
        disparity += smooth_noise(rng, z.shape, cell) * np.float32(rng.uniform(0, size) * strength)
    if rng.random() < 0.8:
        disparity = np.rint(disparity)
    return np.where((z > 0) & (disparity >= 1), exact / np.maximum(disparity, 1), 0).astype(np.float32)


def _shadow(z, camera, rng):
    """Pixels in the shadow of the projector (or second camera), which is one baseline beside the camera."""
    side = rng.choice(["left", "right", "none"], p=[0.6, 0.2, 0.2])
    if side == "none":
        return np.zeros(z.shape, bool)
    baseline = rng.uniform(0.03, 0.09)
    if side == "right":
        z = z[:, ::-1]
    seen = np.arange(z.shape[1]) - np.where(z > 0, camera[0] * baseline / np.maximum(z, 0.05), 0)
    nearest = np.minimum.accumulate(seen[:, ::-1], axis=1)[:, ::-1]
    shadow = seen > nearest + 0.5
    return shadow[:, ::-1] if side == "right" else shadow


def _edges(z, rng):
    """Random losses where the depth jumps."""
    kernel = np.ones((3, 3), np.uint8)
    jump = cv2.dilate(z, kernel) - cv2.erode(z, kernel) > 0.03 + 0.04 * z
    return jump & (rng.random(z.shape, dtype=np.float32) < rng.uniform(0, 0.7))


def _grazing(z, camera, rng):
    """Losses where the surface is nearly parallel to the ray; the cosine is z / (|normal| |ray|)."""
    fx, fy, cx, cy = camera.astype(np.float32)
    dx = cv2.Sobel(z, cv2.CV_32F, 1, 0, ksize=3) / 8
    dy = cv2.Sobel(z, cv2.CV_32F, 0, 1, ksize=3) / 8
    u = (np.arange(z.shape[1], dtype=np.float32) - cx)[None]
    v = (np.arange(z.shape[0], dtype=np.float32) - cy)[:, None]
    normal = np.sqrt((fx * dx) ** 2 + (fy * dy) ** 2 + (z + u * dx + v * dy) ** 2)
    cosine = z / (normal * np.sqrt((u / fx) ** 2 + (v / fy) ** 2 + 1) + 1e-6)
    limit = rng.uniform(0.02, 0.25)
    return rng.random(z.shape, dtype=np.float32) * 0.1 < limit - cosine


def _materials(colour, ids, rng):
    """Dark surfaces, and a few whole objects, like glass, screens and metal, lose depth in patches."""
    missing = np.zeros(ids.shape, bool)
    patchy = smooth_noise(rng, ids.shape, int(rng.integers(3, 14)))
    if colour is not None and rng.random() < 0.5:
        missing |= colour[..., 1] + 15 * patchy < rng.uniform(0, 50)
    if rng.random() < 0.5:
        difficult = rng.random(int(ids.max()) + 1) < rng.uniform(0.01, 0.12)
        missing |= difficult[ids] & (patchy > rng.uniform(-2.0, 1.0))
    return missing


def _blobs(shape, rng):
    """Random holes."""
    if rng.random() < 0.6:
        return np.zeros(shape, bool)
    return smooth_noise(rng, shape, int(rng.integers(3, 24))) > rng.uniform(1.2, 2.5)


def _border(shape, rng):
    """A border without depth, as after registration to a wider colour camera."""
    missing = np.zeros(shape, bool)
    if rng.random() < 0.5:
        top, bottom, left, right = rng.integers(0, rng.integers(1, 26), 4)
        wave = np.rint(smooth_noise(rng, shape, 16)).astype(np.int32) if rng.random() < 0.5 else 0
        rows, columns = np.arange(shape[0])[:, None], np.arange(shape[1])[None]
        missing |= (rows + wave < top) | (rows + wave >= shape[0] - bottom)
        missing |= (columns + wave < left) | (columns + wave >= shape[1] - right)
    return missing


def _out_of_range(z, rng):
    farthest = rng.uniform(2.0, 6.0) if rng.random() < 0.3 else 9.0
    return (z > farthest) | (z < rng.uniform(0.2, 0.5))
