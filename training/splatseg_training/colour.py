"""Colours of training samples. Images are [H, W, 3] uint8.

A network overfits to the colours of a few rendered rooms and then fails on real ones. Therefore objects get new colours
and textures, patterns are painted across object borders, and light and camera vary far beyond natural ranges.
"""

import cv2
import numpy as np

from .sensors.fields import smooth_noise, white_noise


def recolour(rgb, ids, rng):
    """Multiplies objects by random colours and textures; shading and the image's own texture stay."""
    count = int(ids.max()) + 1
    changed = rng.random((count, 1)) < rng.uniform(0.2, 1.0)
    brightness = np.exp(rng.uniform(-0.9, 0.9, (count, 1)))
    tint = np.exp(rng.uniform(-1, 1, (count, 3)) * rng.uniform(0, 0.9))
    gains = np.where(changed, brightness * tint, 1).astype(np.float32)[ids]
    return _bytes(_textured(gains, ids, rng.uniform(0, 0.8) * _calm(rng), rng) * rgb)


def paint(z, ids, camera, rng):
    """Colours for a view without colour: one colour per object, textures, and shading from the depth."""
    count = int(ids.max()) + 1
    tint = 1 + rng.uniform(0, 0.9) * rng.uniform(-1, 1, (count, 3))
    albedo = np.clip(rng.uniform(12, 240, (count, 1)) * tint, 5, 255).astype(np.float32)[ids]
    return _bytes(_textured(albedo, ids, rng.uniform(0.2, 1.0) * _calm(rng), rng) * _shading(z, camera, rng)[..., None])


def shaded(z, albedo, camera, rng):
    """A view [H, W, 3] without colour in these colours [H, W, 3], with shading from the depth."""
    return _bytes(albedo * _shading(z, camera, rng)[..., None])


def photograph(rgb, rng, shift=0.6):
    """Patterns and shadows that belong to no object, then light, camera and noise.

    `shift` is the probability that the image is shifted relative to depth and ids.
    """
    if rng.random() < 0.3:
        rgb = _scribbled(rgb, rng)
    if rng.random() < 0.8:
        rgb = _saturated(rgb, rng)
    rgb = _toned(rgb, rng)
    rgb = _blurred_and_shifted(rgb, rng, shift).astype(np.float32)
    if rng.random() < 0.5:
        light = smooth_noise(rng, rgb.shape[:2], int(rng.integers(30, 120))) * np.float32(rng.uniform(0, 0.5))
        rgb *= np.exp(light)[..., None]
    return _bytes(rgb + white_noise(rng, rgb.shape) * np.float32(rng.uniform(0, 12)))


def _calm(rng):
    """1, or less in half of the views, in which most things have one colour and colour is reliable."""
    return 1.0 if rng.random() < 0.5 else 0.2


def _bytes(image):
    return np.clip(image, 0, 255).astype(np.uint8)


def _textured(rgb, ids, share, rng):
    """Multiplies a share of the objects by textures that change brightness and hue, like prints on packages."""
    count = int(ids.max()) + 1
    exponent = np.zeros(rgb.shape, np.float32)
    for _ in range(2):
        strength = np.where(rng.random(count) < share, rng.uniform(-1, 1, count), 0).astype(np.float32)
        tint = rng.uniform(-0.4, 1.2, 3).astype(np.float32)
        exponent += (_pattern(rng, ids.shape) * strength[ids])[..., None] * tint
    return rgb * np.exp(exponent)


def _pattern(rng, shape):
    """A texture [H, W] in about -1..1: stripes, checks, or noise that is smooth or has sharp edges."""
    kind = rng.integers(4)
    if kind == 0:
        return np.clip(smooth_noise(rng, shape, int(rng.integers(2, 20))), -1, 1)
    if kind == 1:
        return np.sign(smooth_noise(rng, shape, int(rng.integers(4, 40))))
    rows, columns = np.arange(shape[0], dtype=np.float32)[:, None], np.arange(shape[1], dtype=np.float32)[None]
    angle, period = rng.uniform(0, np.pi), rng.uniform(3, 30)
    along = (rows * np.float32(np.sin(angle)) + columns * np.float32(np.cos(angle))) % np.float32(period) > period / 2
    if kind == 3:
        across = rows * np.float32(np.cos(angle)) - columns * np.float32(np.sin(angle))
        along ^= across % np.float32(period) > period / 2
    return along * np.float32(2) - 1


def _shading(z, camera, rng):
    """Lambertian shading [H, W] by one random light, from the depth's gradient."""
    near = np.maximum(z, np.float32(0.1))
    dx = cv2.Sobel(z, cv2.CV_32F, 1, 0, ksize=3) * np.float32(camera[0] / 8) / near
    dy = cv2.Sobel(z, cv2.CV_32F, 0, 1, ksize=3) * np.float32(camera[1] / 8) / near
    light = rng.standard_normal(3)
    light = (light / np.linalg.norm(light)).astype(np.float32)
    cosine = (light[0] * dx + light[1] * dy + light[2]) / np.sqrt(dx * dx + dy * dy + 1)
    ambient = np.float32(rng.uniform(0.4, 1.0))
    return ambient + (1 - ambient) * (np.float32(0.5) + np.float32(0.5) * cosine)


def _scribbled(rgb, rng):
    """Draws a few patches and lines, like prints, stains and shadows."""
    out = rgb.copy()
    height, width = rgb.shape[:2]
    for _ in range(rng.integers(1, 9)):
        layer = out.copy()
        centre, size = rng.uniform(0, 1, 2) * (width, height), np.exp(rng.uniform(1.0, 4.0))
        points = (centre + rng.uniform(-1, 1, (int(rng.integers(3, 6)), 2)) * size).astype(np.int32)
        ink = tuple(map(float, rng.uniform(0, 255, 3)))
        if rng.random() < 0.5:
            cv2.fillPoly(layer, [points], ink)
        else:
            cv2.polylines(layer, [points], False, ink, int(rng.integers(1, 4)))
        opacity = rng.uniform(0.2, 1.0)
        out = cv2.addWeighted(layer, opacity, out, 1 - opacity, 0)
    return out


def _saturated(rgb, rng):
    """Changes saturation and white balance."""
    saturation = rng.uniform(0, 1.8)
    mix = saturation * np.eye(3) + (1 - saturation) / 3
    return cv2.transform(rgb, mix * rng.uniform(0.75, 1.25, (3, 1)))


def _toned(rgb, rng):
    """Changes gamma, contrast and brightness with one lookup table."""
    tones = (np.arange(256) / 255) ** np.exp(rng.uniform(-0.6, 0.6))
    middle = tones[int(rgb.mean())]
    tones = (tones - middle) * rng.uniform(0.5, 1.5) + middle + rng.uniform(-0.2, 0.2)
    return cv2.LUT(rgb, _bytes(tones * 255))


def _blurred_and_shifted(rgb, rng, probability):
    """Blurs and, with `probability`, shifts by up to 2 pixels relative to the depth."""
    if rng.random() < 0.4:
        rgb = cv2.GaussianBlur(rgb, (0, 0), rng.uniform(0.4, 1.3))
    if rng.random() < probability:
        shift = np.float32([[1, 0, rng.uniform(-2, 2)], [0, 1, rng.uniform(-1.5, 1.5)]])
        rgb = cv2.warpAffine(rgb, shift, rgb.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
    return rgb
