"""Parts: the boxes, cylinders and balls of which everything in a room is made, as tensors."""

from typing import NamedTuple

import torch

BOX, CYLINDER, BALL = 0, 1, 2


class Parts(NamedTuple):
    """Parts with any leading dimensions [..., P]; lengths in metres."""

    shape: torch.Tensor  # [..., P] int64: BOX, CYLINDER (its axis is the third) or BALL
    centre: torch.Tensor  # [..., P, 3]
    half: torch.Tensor  # [..., P, 3] half sizes along the part's axes
    axes: torch.Tensor  # [..., P, 3, 3], columns: the part's axes
    id: torch.Tensor  # [..., P] int64; 0: the part does not exist

    def moved(self, rotation, offset):
        """The parts after a rotation [..., 3, 3] and then a shift [..., 3], both without the dimension P."""
        centre = self.centre @ rotation.mT + offset[..., None, :]
        return self._replace(centre=centre, axes=rotation[..., None, :, :] @ self.axes)

    def extent(self):
        """Half sizes [..., P, 3] of the boxes around the parts, along the axes of the space they are in."""
        return (self.axes.abs() @ self.half[..., None])[..., 0]


def joined(parts):
    """Several `Parts` [B, P] as one."""
    return Parts(*(torch.cat(tensors, 1) for tensors in zip(*parts)))


def yawed(angle):
    """Rotations [..., 3, 3] by angles [...] in radians about the vertical third axis."""
    c, s, zero = angle.cos(), angle.sin(), torch.zeros_like(angle)
    rows = (torch.stack((c, -s, zero), -1), torch.stack((s, c, zero), -1), torch.stack((zero, zero, zero + 1), -1))
    return torch.stack(rows, -2)


def tilted(angle):
    """Rotations [..., 3, 3] by angles [...] in radians about the horizontal first axis."""
    c, s, zero = angle.cos(), angle.sin(), torch.zeros_like(angle)
    rows = (torch.stack((zero + 1, zero, zero), -1), torch.stack((zero, c, -s), -1), torch.stack((zero, s, c), -1))
    return torch.stack(rows, -2)
