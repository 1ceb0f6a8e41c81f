"""Random fields: white, smooth and with a given correlation length. They come from a table, which is fast."""

from functools import lru_cache

import cv2
import numpy as np

_NOISE = np.random.default_rng(0).standard_normal(1 << 21, dtype=np.float32)
_FINEST = 1.5  # pixels of the coarse grid: the least correlation length that survives bilinear enlargement


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


def correlated_noise(rng, shape, length):
    """Gaussian noise [H, W] of deviation 1, smoothed by a Gaussian with a deviation of `length` pixels.

    Its correlation falls to 1/e at twice this distance. With a length of 0, the noise is white. Long ones are made on a
    coarser grid and enlarged.
    """
    if length <= 0:
        return white_noise(rng, shape)
    height, width = shape
    cell = max(1, int(length / _FINEST))
    kernel, gain = _kernel(round(length / cell, 2))
    pad = len(kernel) // 2
    rows, columns = height // cell + 2, width // cell + 2
    noise = white_noise(rng, (rows + 2 * pad, columns + 2 * pad))
    noise = cv2.sepFilter2D(noise, -1, kernel, kernel)[pad : pad + rows, pad : pad + columns] * gain
    if cell == 1:
        return noise[:height, :width]
    large = cv2.resize(noise, (columns * cell, rows * cell), interpolation=cv2.INTER_LINEAR)
    return large[cell // 2 : cell // 2 + height, cell // 2 : cell // 2 + width]


@lru_cache(maxsize=1024)
def _kernel(length):
    """A Gaussian kernel, and the factor that gives smoothed white noise a deviation of 1."""
    kernel = cv2.getGaussianKernel(2 * int(np.ceil(3 * length)) + 1, length, cv2.CV_32F)
    return kernel, np.float32(1 / (kernel**2).sum())
