"""Depth sensors for batches of tensors: the models of `splatseg_training.sensors`, with the same parameters.

The parameters of each sample's camera are drawn on the host by `splatseg_training.sensors.cameras`, so that the ranges
are the same, and samples with the same kind of camera are measured together.
"""

from ...sensors import cameras
from . import lidar, losses, noise, registration, stereo, structured_light, time_of_flight
from .view import Views, some

MODELS = {
    "structured light": structured_light,
    "stereo": stereo,
    "lidar": lidar,
    "time of flight": time_of_flight,
    "noise": noise,
}


def measure(views, draws, probability=1.0):
    """The depth [B, H, W] metres, 0 = missing, that random cameras measure; exact except with this probability."""
    rng = draws.rng
    drawn = [cameras.draw(rng) if rng.random() < probability else None for _ in range(len(views.z))]
    return measure_with(drawn, views, draws)


def measure_with(drawn, views, draws):
    """The depth [B, H, W] that these cameras measure, B of `cameras.Camera` or None."""
    out = views.z.clone()
    for kind in MODELS:
        if chosen := some(draws, [camera is not None and camera.kind == kind for camera in drawn]):
            out[chosen[1]] = _measured(kind, views.take(chosen[1]), [drawn[number] for number in chosen[0]], draws)
    return out


def _measured(kind, views, drawn, draws):
    errors = [camera.registration for camera in drawn]
    views = registration.seen_late(views, errors, draws)
    z = MODELS[kind].measure(views, [camera.model for camera in drawn], draws)
    z = registration.apply(z, views, errors, draws)
    lost = losses.out_of_range(z, 0.0, draws.tensor([camera.farthest for camera in drawn])[:, None, None])
    # Where the view is farther away than the camera reaches, nothing could be learned from it.
    lost &= (4 * lost.sum((1, 2)) <= 3 * (z > 0).sum((1, 2)))[:, None, None]
    if chosen := some(draws, [camera.holes > 0 for camera in drawn]):
        picked = [drawn[number] for number in chosen[0]]
        shape = (len(picked), *z.shape[1:])
        lost[chosen[1]] |= losses.holes(shape, [c.holes for c in picked], [c.hole_size for c in picked], draws)
    step = draws.tensor([camera.step for camera in drawn])[:, None, None]
    return ((z / step).round() * step).where(step > 0.001, z).masked_fill(lost, 0)


__all__ = ["Views", "measure", "measure_with"]
