"""Random numbers on the device, determined by a seed and a step."""

import math

import numpy as np
import torch


class Draws:
    """Random tensors for one part of one step.

    The tensors come from the device's generator and the few decisions that the host makes (sizes of groups, sensors)
    from `rng`, so that the device never has to be waited for. The same seed, step, part and kind of device give the same
    numbers.
    """

    def __init__(self, seed, step, part=0, device="cpu"):
        self.device = torch.device(device)
        self.rng = np.random.default_rng([seed, step, part])
        self.generator = torch.Generator(self.device).manual_seed(int(self.rng.integers(1 << 62)))

    def uniform(self, low, high, *shape):
        """Uniform numbers of this shape, float32."""
        return torch.rand(shape, generator=self.generator, device=self.device) * (high - low) + low

    def log_uniform(self, low, high, *shape):
        """Numbers whose logarithm is uniform."""
        return torch.exp(self.uniform(math.log(low), math.log(high), *shape))

    def normal(self, *shape):
        """Gaussian numbers of deviation 1."""
        return torch.randn(shape, generator=self.generator, device=self.device)

    def chance(self, probability, *shape):
        """Booleans that are true with this probability (a number or a tensor of this shape)."""
        return torch.rand(shape, generator=self.generator, device=self.device) < probability

    def integers(self, low, high, *shape):
        """Integers from `low` up to and without `high`, int64."""
        return torch.randint(low, high, shape, generator=self.generator, device=self.device)

    def tensor(self, values, dtype=torch.float32):
        """Numbers of the host, as a tensor on the device."""
        return torch.from_numpy(np.asarray(values)).to(self.device, dtype)
