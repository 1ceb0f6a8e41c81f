"""Depth that does not lie on the colours: shifted, late, or warped with gaps. Labels stay with the colours.

- A wrong extrinsic calibration shifts and scales depth by a few pixels (Herrera et al. 2012).
- Unsynchronised cameras, or a late depth frame, show depth from where the camera was before: at 30 Hz, hands and robots
  turn by up to about 1° and move by 2 cm.
- Depth that is warped point by point into a denser colour image leaves rows, columns and single pixels empty.
"""

from typing import NamedTuple

import cv2
import numpy as np

from . import losses
from .scene import FAR, is_jump, nearest_and_farthest, rays

SEARCHED = 9  # pixels, more than the motion between two frames


class Registration(NamedTuple):
    """Errors of the depth's place in the colour image."""

    shift: tuple  # pixels, to the right and down
    scale: float  # about the centre
    rotation: tuple  # radians about x, y, z since the depth was measured
    translation: tuple  # metres since the depth was measured
    random: float  # share of single pixels without depth
    pitch: tuple  # pixels between the warped points, across and down; at most 1 leaves no gaps
    tilt: float  # radians, of the rows of warped points
    baseline: float  # metres between the two cameras: a warp leaves shadows beside near things
    border: losses.Border | None


NONE = Registration((0.0, 0.0), 1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, (1.0, 1.0), 0.0, 0.0, None)


def draw(rng, strength, warped):
    """Errors for a strength of 0 to 1; `warped` is the probability of gaps and shadows from a warp."""
    out = NONE._replace(border=losses.draw_border(rng) if rng.random() < max(0.2, 0.6 * warped) else None)
    if rng.random() < 0.3 + 0.2 * strength:
        away = rng.uniform(-1, 1, 2) * (0.5 + 2.5 * strength)
        out = out._replace(shift=tuple(away), scale=1 + rng.uniform(-1, 1) * 0.01 * strength)
    if rng.random() < 0.4 * (strength - 0.4):  # a late frame is not mild
        rotation, translation = rng.standard_normal((2, 3)) * np.array([[0.006], [0.008]]) * rng.random()
        out = out._replace(
            rotation=tuple(rotation.clip(-0.0175, 0.0175)), translation=tuple(translation.clip(-0.02, 0.02))
        )
    if rng.random() < warped:
        out = out._replace(baseline=rng.uniform(-0.06, 0.06) * (rng.random() < 0.6))
        gaps = rng.uniform(0, 0.4) * min(1, 0.2 + strength)
        if rng.random() < 0.5:
            out = out._replace(random=gaps)
        else:
            across = rng.random()  # a pitch of p leaves gaps in 1 - 1 / p of the columns
            out = out._replace(
                pitch=((1 - gaps) ** -across, (1 - gaps) ** (across - 1)),
                tilt=rng.uniform(-0.15, 0.15),
                random=rng.uniform(0, 0.05),
            )
    return out


def apply(z, camera, registration, rng):
    """Measured depth [H, W] as registered to the colours; 0 where nothing came. See `seen_late` for late frames."""
    if any(registration.shift) or registration.scale != 1:
        z = shifted(z, registration.shift, registration.scale)
    gaps = losses.shadow(z, camera, registration.baseline)
    if max(registration.pitch) > 1:
        gaps |= unfilled(z, registration, camera)
    if registration.random > 0:
        gaps |= rng.random(z.shape, dtype=np.float32) < registration.random
    if registration.border:
        gaps |= losses.outside(z.shape, registration.border, rng)
    return np.where(gaps, 0, z)


def seen_late(scene, registration):
    """The scene with the depth from where the depth camera was."""
    if any(registration.rotation) or any(registration.translation):
        return scene._replace(z=late(scene.z, scene.camera, registration.rotation, registration.translation))
    return scene


def shifted(z, shift, scale):
    """Depth moved by `shift` (right, down) pixels and scaled about the centre, by the nearest pixel."""
    height, width = z.shape
    x, y = (width - 1) / 2 * (1 - scale) + shift[0], (height - 1) / 2 * (1 - scale) + shift[1]
    return cv2.warpAffine(z, np.array([[scale, 0, x], [0, scale, y]]), (width, height), flags=cv2.INTER_NEAREST)


def late(z, camera, rotation, translation):
    """The depth that an earlier camera sees; `rotation` and `translation` take points to its coordinates.

    `z` is exact. Each pixel searches the point that moves to it: from the motion of its own surface, in two steps, or
    else among the nearest surface around it, which hides others. Where a surface comes into view, it goes on from the
    parts that were visible.
    """
    motion = _Motion(z.shape, camera, rotation, translation)
    depth = z
    for _ in range(2):
        found = motion.source(z, depth)
        depth = np.where(is_jump(found, depth), depth, found)
    near, _ = nearest_and_farthest(z, SEARCHED)
    found = motion.source(z, near)
    hiding = (found > 0) & ~is_jump(near, found) & is_jump(found, np.where(depth > 0, depth, FAR))
    depth = np.where(hiding, found, depth)
    return np.where(depth > 0, np.maximum(motion.moved(depth)[2], np.float32(0.05)), 0)


class _Motion:
    """The motion of a camera between two frames: `rotation` and `translation` take points to the later coordinates."""

    def __init__(self, shape, camera, rotation, translation):
        self.fx, self.fy, self.cx, self.cy = camera.astype(np.float32)
        self.u, self.v = rays(shape, camera)
        x, y = self.u / self.fx, self.v / self.fy
        self.directions = [row[0] * x + row[1] * y + row[2] for row in np.float32(cv2.Rodrigues(np.array(rotation))[0])]
        self.translation = np.float32(translation)

    def moved(self, depth):
        """The points' coordinates after the motion."""
        return [depth * direction + step for direction, step in zip(self.directions, self.translation)]

    def source(self, z, depth):
        """The depth in `z` from where a surface at `depth` moves to each pixel; 0 outside."""
        x, y, forward = self.moved(depth)
        scale = 1 / np.maximum(forward, np.float32(0.05))
        across = 2 * self.u + self.cx - self.fx * x * scale
        down = 2 * self.v + self.cy - self.fy * y * scale
        return cv2.remap(z, across, down, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)


def unfilled(z, registration, camera):
    """The pixels [H, W] that no point hits, if a grid of points is warped.

    Rows of points are tilted and bent a little, like those of a camera with a lens, and move by parallax.
    """
    u, v = rays(z.shape, camera)
    across, down = (np.float32(1 / pitch) for pitch in registration.pitch)
    tilt, bend = np.float32(registration.tilt), np.float32(registration.tilt / 400)
    columns = u + np.float32(camera[0] * registration.baseline) / np.maximum(z, np.float32(0.2)) + tilt * v
    rows = v - tilt * u + bend * u * u
    return (columns * across % 1 >= across) | (rows * down % 1 >= down)
