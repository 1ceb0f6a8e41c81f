"""The optimiser: Muon for the convolutions between the first and the last, AdamW for everything else.

Muon (Jordan et al. 2024) replaces the momentum of a weight matrix by the nearest orthogonal matrix, so that all its
directions learn at the same speed. A kernel is treated as a matrix [outputs, inputs × height × width].
"""

import torch

NEWTON_SCHULZ = (3.4445, -4.7750, 2.0315)


def optimisers(net, outer=("stem", "head"), weight_decay=0.02):
    """The two optimisers. The learning rate of a parameter group is the run's rate times the group's `scale`.

    The names of the first and last convolutions begin with one of `outer`.
    """
    kernels, others = [], []
    for name, parameter in net.named_parameters():
        inner = parameter.dim() == 4 and not name.startswith(outer)
        (kernels if inner else others).append(parameter)
    return Muon(kernels, weight_decay), torch.optim.AdamW([{"params": others, "scale": 1.0}], weight_decay=weight_decay)


class Muon(torch.optim.Optimizer):
    """Nesterov momentum with orthogonalised steps."""

    def __init__(self, parameters, weight_decay, momentum=0.95, scale=10.0):
        super().__init__(parameters, {"lr": 0.0, "weight_decay": weight_decay, "momentum": momentum, "scale": scale})

    @torch.no_grad()
    def step(self):
        for group in self.param_groups:
            for weight in group["params"]:
                state = self.state[weight]
                mean = state.setdefault("mean", torch.zeros_like(weight))
                mean.lerp_(weight.grad, 1 - group["momentum"])
                update = orthogonal(weight.grad.lerp(mean, group["momentum"]).flatten(1)).view_as(weight)
                weight.mul_(1 - group["lr"] * group["weight_decay"])
                weight.add_(update, alpha=-group["lr"])


def orthogonal(matrix, iterations=5):
    """Approximates the nearest matrix with orthonormal rows or columns by a quintic Newton-Schulz iteration."""
    a, b, c = NEWTON_SCHULZ
    tall = matrix.shape[0] > matrix.shape[1]
    x = matrix.T if tall else matrix
    x = x / (x.norm() + 1e-7)
    for _ in range(iterations):
        square = x @ x.T
        x = a * x + (b * square + c * square @ square) @ x
    return x.T if tall else x
