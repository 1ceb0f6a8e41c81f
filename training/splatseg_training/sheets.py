"""Papers, posters and books on the flat surfaces of a view: objects visible in colour but hardly or not in depth."""

from typing import NamedTuple

import cv2
import numpy as np

PATCH = 5  # pixels to each side for estimating a surface's plane
LEAST = 24  # minimum visible pixels of a sheet
LEAST_SURFACE = 1500  # minimum pixels of the surface below: a print on a package is part of the package
MOST = 0.35  # maximum share of the surface's pixels


class Sheet(NamedTuple):
    """A flat rectangle or ellipse in the view."""

    id: int
    corners: np.ndarray  # [4, 2] float32, pixels (column, row), clockwise in the sheet's own frame
    mask: np.ndarray  # [H, W] bool, its visible pixels


def lay(z, ids, camera, rng, most=9):
    """Lays up to `most` sheets on flat surfaces; returns depth and ids with them, and the sheets, lowest first.

    `z` [H, W] metres, `ids` [H, W], `camera` fx, fy, cx, cy. Sheets lie in groups and overlap. Half have no thickness,
    the others up to 3 cm.
    """
    surfaces, plain = ids, z
    z, ids, sheets, at = z.copy(), ids.copy(), [], None
    candidates = np.argwhere((surfaces > 0) & (plain > 0))
    for _ in range(int(rng.integers(1, most + 1)) if len(candidates) else 0):
        if at is None or rng.random() < 0.5:
            at = candidates[rng.integers(len(candidates))]
        else:
            at = np.clip(at + rng.normal(0, 25, 2).astype(int), 0, np.array(z.shape) - 1)
        plane = _plane(plain, surfaces, at, camera)
        if plane is None:
            continue
        normal, distance = plane
        corners = _corners(at, normal, distance, camera, rng)
        if corners is None:
            continue
        surface = surfaces == surfaces[tuple(at)]
        mask = _outline(corners, z.shape, rng) & surface
        flat = _depth(normal, distance, z.shape, camera)
        mask &= np.abs(plain - flat) < 0.005 + 0.01 * plain
        if surface.sum() < LEAST_SURFACE or not LEAST <= mask.sum() <= MOST * surface.sum():
            continue
        thickness = 0.0 if rng.random() < 0.5 else np.exp(rng.uniform(np.log(0.002), np.log(0.03)))
        z[mask] = plain[mask] * np.float32(max(distance - thickness, 0.1) / max(distance, 0.1))
        sheets = [sheet._replace(mask=sheet.mask & ~mask) for sheet in sheets]
        sheets.append(Sheet(int(ids.max()) + 1, corners, mask))
        ids[mask] = sheets[-1].id
    return z, ids, sheets


def printed(rgb, sheets, rng):
    """Paints the sheets, [H, W, 3] uint8: plain, or with lines of text and pictures."""
    out = rgb.copy()
    for sheet in sheets:
        beneath = rgb[sheet.mask].mean(0) if sheet.mask.any() else 128
        page = _page(beneath, rng)
        height, width = page.shape[:2]
        source = np.float32([[0, 0], [width, 0], [width, height], [0, height]])
        transform = cv2.getPerspectiveTransform(source, sheet.corners)
        image = cv2.warpPerspective(page, transform, rgb.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
        out[sheet.mask] = image[sheet.mask]
    return out


def _plane(z, ids, at, camera):
    """Unit normal and distance of the plane around a pixel (normal · X = distance > 0), or None if it is not flat."""
    rows = slice(max(at[0] - PATCH, 0), at[0] + PATCH + 1)
    columns = slice(max(at[1] - PATCH, 0), at[1] + PATCH + 1)
    patch = z[rows, columns]
    if (ids[rows, columns] != ids[tuple(at)]).any() or (patch <= 0).any():
        return None
    fx, fy, cx, cy = camera
    v, u = np.mgrid[rows, columns]
    rays = np.stack([(u - cx) / fx, (v - cy) / fy, np.ones(u.shape)], -1).reshape(-1, 3)[: patch.size]
    scaled, *_ = np.linalg.lstsq(rays, 1 / patch.astype(float).ravel(), rcond=None)
    if np.abs(rays @ scaled * patch.ravel() - 1).max() > 0.004:
        return None
    length = np.linalg.norm(scaled)
    return scaled / length, 1 / length


def _depth(normal, distance, shape, camera):
    """Depth [H, W] of a plane."""
    fx, fy, cx, cy = camera
    u = (np.arange(shape[1]) - cx) / fx
    v = (np.arange(shape[0]) - cy) / fy
    along = normal[0] * u[None] + normal[1] * v[:, None] + normal[2]
    return (distance / np.maximum(along, 1e-3)).astype(np.float32)


def _corners(at, normal, distance, camera, rng):
    """Image corners of a random rectangle in the plane around a pixel, or None if one is behind the camera."""
    fx, fy, cx, cy = camera
    ray = np.array([(at[1] - cx) / fx, (at[0] - cy) / fy, 1])
    centre = ray * distance / (ray @ normal)
    across = np.cross((0.0, 1.0, 0.0), normal)
    if np.linalg.norm(across) < 0.2:
        across = np.array([1.0, 0, 0]) - normal * normal[0]
    across /= np.linalg.norm(across)
    turn = rng.normal(0, 0.05) if rng.random() < 0.5 else rng.uniform(0, 2 * np.pi)
    down = np.cross(normal, across)
    across, down = np.cos(turn) * across + np.sin(turn) * down, np.cos(turn) * down - np.sin(turn) * across
    half = np.exp(rng.uniform(np.log(0.04), np.log(0.3)))
    sides = np.array([half, half * rng.uniform(1.0, 1.6)])[rng.permutation(2)]
    points = centre + np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * sides @ np.stack([across, down])
    if points[:, 2].min() < 0.1:
        return None
    return (points[:, :2] / points[:, 2:] * (fx, fy) + (cx, cy)).astype(np.float32)


def _outline(corners, shape, rng):
    """The pixels [H, W] of a rectangle, sometimes of its inscribed ellipse."""
    mask = np.zeros(shape, np.uint8)
    if rng.random() < 0.12:
        angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        middle = corners.mean(0)
        a, b = (corners[1] + corners[2]) / 2 - middle, (corners[2] + corners[3]) / 2 - middle
        corners = middle + np.cos(angles)[:, None] * a + np.sin(angles)[:, None] * b
    cv2.fillConvexPoly(mask, np.rint(np.clip(corners, -4000, 4000)).astype(np.int32), 1)
    return mask > 0


def _page(beneath, rng):
    """A printed page, [64, 48, 3] uint8; its background differs from the colour beneath."""
    for _ in range(4):
        ground = rng.uniform(0, 255, 3) if rng.random() < 0.5 else rng.uniform(170, 255) + rng.uniform(-15, 15, 3)
        if np.abs(ground - beneath).mean() > 30:
            break
    page = np.empty((64, 48, 3), np.float32)
    page[:] = ground
    if rng.random() < 0.75:
        for _ in range(int(rng.integers(1, 4))):
            _block(page, rng)
        _text(page, ground, rng)
    light = np.linspace(*rng.uniform(0.8, 1.1, 2), 64, dtype=np.float32)[:, None, None]
    return np.clip(page * light, 0, 255).astype(np.uint8)


def _block(page, rng):
    """A picture or a heading of one colour."""
    y, x = rng.integers(0, 48), rng.integers(0, 32)
    h, w = rng.integers(3, 36), rng.integers(8, 48)
    page[y : y + h, x : x + w] = rng.uniform(0, 255, 3) if rng.random() < 0.7 else rng.uniform(0, 90)


def _text(page, ground, rng):
    """Lines of text over a part of the page."""
    ink = np.where(ground.mean() > 110, rng.uniform(0, 110), rng.uniform(150, 255))
    top, bottom = sorted(rng.integers(2, 62, 2))
    left, right = rng.integers(2, 10), rng.integers(30, 46)
    for row in range(top, bottom, int(rng.integers(2, 5))):
        end = right if rng.random() < 0.7 else rng.integers(left + 1, right + 1)
        page[row, left:end] += (ink - page[row, left:end]) * rng.uniform(0.3, 0.9)
