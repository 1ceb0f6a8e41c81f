"""Time-of-flight cameras; as `splatseg_training.sensors.time_of_flight`, whose parameters they have."""

import torch
import torch.nn.functional as F

from ..fields import below_share, blurred, noise_of_objects, smooth_noise
from . import losses
from .view import column, cosine, is_jump, nearest_and_farthest, smeared, some


def measure(views, models, draws):
    """Depth [B, H, W] metres, 0 = missing, for B of `TimeOfFlight`."""
    amplitude = _amplitude(views, column(draws, models, "albedo_spread"), draws)
    dim = below_share(amplitude, [model.dropout for model in models])
    median = amplitude[:, ::3, ::3].flatten(1).median(1).values[:, None, None]
    spread = (median / amplitude.clamp(min=1e-6)).clamp(0.5, 6.0)
    lost = losses.out_of_range(views.z, column(draws, models, "nearest"), column(draws, models, "farthest")) | dim
    z = multipath(views.z, models, draws)
    z, mixed = flying_pixels(z, models, draws)
    z = z * (1 + column(draws, models, "noise") * spread * draws.normal(*z.shape))
    if chosen := some(draws, [model.smear > 0 for model in models]):
        deviation = [models[number].smear for number in chosen[0]]
        z[chosen[1]] = smeared(z[chosen[1]], draws.tensor(deviation), max(deviation))
    return z.clamp(min=0.05).masked_fill(lost | mixed | (views.z <= 0), 0)


def _amplitude(views, spread, draws):
    """Light that returns [B, H, W]: reflectance × cosine / z², with patchy noise; 0 where there is no surface."""
    albedo = torch.exp(spread * noise_of_objects(draws, views.ids, views.count))
    albedo = albedo * torch.where(views.coloured[:, None, None], views.brightness / 128 + 0.15, 1)
    patchy = 1 + 0.2 * smooth_noise(draws, views.z.shape, [3.0] * len(views.z))
    return albedo * patchy * cosine(views) / views.z.clamp(min=0.1).square()


def multipath(z, models, draws):
    """Depth with concave corners cut off and everything near them moved away; small edges are not corners."""
    small = F.avg_pool2d(z[:, None], 4)[:, 0]
    corner = [model.corner for model in models]
    depth = small - blurred(small, draws.tensor(corner) / 4, max(corner) / 4)
    depth = torch.minimum(depth.clamp(min=0), 0.02 * small)  # beside a jump, the far surface is not a corner
    around = blurred(depth, draws.tensor(corner) / 2, max(corner) / 2)
    change = column(draws, models, "multipath") * around - column(draws, models, "rounding") * depth
    away = (1 + smooth_noise(draws, small.shape, [12.0] * len(z))).clamp(0, 2) / 2
    change = change + column(draws, models, "bias") * small * away
    return z + F.interpolate(change[:, None], z.shape[1:], mode="bilinear")[:, 0]


def flying_pixels(z, models, draws):
    """Depth with mixtures of foreground and background at jumps, and the mask of those that the camera left out."""
    near, far = nearest_and_farthest(z, 1)
    reach = column(draws, models, "reach")
    for radius in range(2, max(model.reach for model in models) + 1):
        wider = nearest_and_farthest(z, radius)
        near, far = (torch.where(reach >= radius, new, old) for new, old in zip(wider, (near, far)))
    jump = is_jump(near, far)
    chance = draws.uniform(0, 1, 2, *z.shape)
    between = near + (far - near) * chance[1]
    left_out = jump & ((chance[0] + chance[1]) % 1 < column(draws, models, "filtered"))
    return between.where(jump & (chance[0] < column(draws, models, "flying")), z), left_out
