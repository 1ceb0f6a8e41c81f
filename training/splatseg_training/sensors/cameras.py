"""Draws a camera per sample and measures a view with it."""

from typing import NamedTuple

import numpy as np

from . import lidar, losses, noise, registration, stereo, structured_light, time_of_flight
from .scene import Scene

UNTOUCHED = 0.07  # share of the samples with exact depth
NOISY = 0.5  # least strength of noisy cameras: 0.7 cm at 2 m
NOISY_SHARES = {"stereo": 0.55, "noise": 0.4, "time of flight": 0.05}  # of the noisy cameras
MILD = 0.4  # strengths up to this are mild, those above it harsh
SHARES = {  # of the samples: mild, harsh; with the untouched ones, half of the samples are at most mild
    "structured light": (0.25, 0.04),
    "stereo": (0.05, 0.15),
    "lidar": (0.05, 0.09),
    "time of flight": (0.04, 0.1),
    "noise": (0.04, 0.12),
}


class Camera(NamedTuple):
    """A depth camera of one kind."""

    kind: str  # a key of `SHARES`
    strength: float  # 0..1
    model: tuple  # its parameters, of the kind's module
    registration: registration.Registration
    farthest: float  # metres
    step: float  # metres, to which depth is rounded
    holes: float  # share of additional holes
    hole_size: float  # pixels


def draw(rng):
    """A random camera, or None for exact depth."""
    choice = rng.random() - UNTOUCHED
    if choice < 0:
        return None
    for kind, shares in SHARES.items():
        for harsh, share in enumerate(shares):
            if choice < share:
                return draw_camera(kind, _strength(harsh, rng), rng)
            choice -= share
    return draw_camera("noise", _strength(True, rng), rng)  # the shares' rounding errors


def draw_noisy(rng):
    """A random camera with much noise."""
    kind = str(rng.choice(list(NOISY_SHARES), p=list(NOISY_SHARES.values())))
    return draw_camera(kind, rng.uniform(NOISY, 1), rng)


def _strength(harsh, rng):
    """A strength; harsh ones are rather strong, as the network has most to learn there."""
    return MILD + (1 - MILD) * np.sqrt(rng.random()) if harsh else rng.uniform(0, MILD)


def draw_camera(kind, strength, rng):
    """A camera of this kind and strength."""
    harsh = strength > MILD
    if kind == "structured light":
        # All strengths of a Kinect are mild.
        model = structured_light.draw(rng, 1.0 if harsh else rng.uniform(0.1, 1.0))
    else:
        model = MODELS[kind].draw(rng, strength)
    warped = {"time of flight": 0.6, "structured light": 0.1 * harsh, "noise": 0.15 * harsh}.get(kind, 0.0)
    big = harsh and rng.random() < 0.12
    return Camera(
        kind=kind,
        strength=strength,
        model=model,
        registration=registration.draw(rng, strength, warped),
        farthest=np.exp(rng.uniform(np.log(2.0 if harsh else 4.0), np.log(10.0))) if rng.random() < 0.2 else 10.0,
        step=rng.uniform(0.001, 0.005) if rng.random() < 0.3 else 0.001,
        holes=rng.uniform(0.3, 0.6) if big else 0.0,
        hole_size=rng.uniform(2, 15),
    )


def measure(z, colour, ids, camera, rng, noisy=0.0):
    """The depth a random camera measures, in metres [H, W] float32, 0 = missing.

    `z` [H, W] metres (0 = missing), `colour` [H, W, 3] uint8 or None, `ids` [H, W], `camera` fx, fy, cx, cy. `noisy` is
    the probability of a camera with much noise.
    """
    drawn = draw_noisy(rng) if noisy > 0 and rng.random() < noisy else draw(rng)
    return z if drawn is None else measure_with(drawn, Scene(z, colour, ids, camera), rng)


def measure_with(camera, scene, rng):
    """The depth [H, W] that this camera measures."""
    scene = registration.seen_late(scene, camera.registration)
    z = MODELS[camera.kind].measure(scene, camera.model, rng)
    z = registration.apply(z, scene.camera, camera.registration, rng)
    lost = losses.out_of_range(z, 0.0, camera.farthest)
    if 4 * np.count_nonzero(lost) > 3 * np.count_nonzero(z):
        lost[:] = False  # the view is farther away than the camera reaches: nothing could be learned from it
    if camera.holes > 0:
        lost |= losses.holes(z.shape, camera.holes, camera.hole_size, rng)
    z = np.where(lost, 0, z)
    if camera.step > 0.001:
        z = np.rint(z / np.float32(camera.step)) * np.float32(camera.step)
    return z.astype(np.float32, copy=False)


MODELS = {
    "structured light": structured_light,
    "stereo": stereo,
    "lidar": lidar,
    "time of flight": time_of_flight,
    "noise": noise,
}
