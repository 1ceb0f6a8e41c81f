"""The affinity network: a U-Net of plain 3×3 convolutions that predicts at half the input's size."""

import torch
import torch.nn.functional as F
from torch import nn

from .affinities import OFFSETS
from .inputs import CHANNELS

WIDTHS = (16, 32, 48, 64, 96)


class ConvBlock(nn.Sequential):
    """Convolution, batch norm, SiLU."""

    def __init__(self, inputs, outputs, kernel=3, stride=1):
        convolution = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
        super().__init__(convolution, nn.BatchNorm2d(outputs), nn.SiLU())


class Residual(nn.Module):
    """Two convolutions whose result is added to the input."""

    def __init__(self, channels):
        super().__init__()
        self.a, self.b = ConvBlock(channels, channels), ConvBlock(channels, channels)

    def forward(self, x):
        return x + self.b(self.a(x))


class AffinityNet(nn.Module):
    """Input [N, 8, H, W]; log-odds [N, 12, H/2, W/2] that a pixel and its neighbour at each offset are one object.

    `widths` are the channels at 1/2, 1/4, 1/8, 1/16 and 1/32 of the input's size.
    """

    def __init__(self, widths=WIDTHS, channels=CHANNELS):
        super().__init__()
        w = widths
        self.stem = ConvBlock(channels, w[0], stride=2)
        self.e1 = nn.Sequential(ConvBlock(w[0], w[1], stride=2), Residual(w[1]))
        self.e2 = nn.Sequential(ConvBlock(w[1], w[2], stride=2), Residual(w[2]), Residual(w[2]))
        self.e3 = nn.Sequential(ConvBlock(w[2], w[3], stride=2), Residual(w[3]), Residual(w[3]))
        self.e4 = nn.Sequential(ConvBlock(w[3], w[4], stride=2), Residual(w[4]), Residual(w[4]))
        self.pool = ConvBlock(w[4], w[4], kernel=1)
        self.l4, self.d3 = nn.Conv2d(w[4], w[3], 1), ConvBlock(w[3], w[3])
        self.l3, self.d2 = nn.Conv2d(w[3], w[2], 1), ConvBlock(w[2], w[2])
        self.l2, self.d1 = nn.Conv2d(w[2], w[1], 1), nn.Sequential(ConvBlock(w[1], w[1]), ConvBlock(w[1], w[1]))
        self.l1, self.d0 = nn.Conv2d(w[1], w[0], 1), nn.Sequential(ConvBlock(w[0], w[0]), ConvBlock(w[0], w[0]))
        self.head = nn.Conv2d(w[0], len(OFFSETS), 1)

    def forward(self, x):
        x0 = self.stem(x)
        x1 = self.e1(x0)
        x2 = self.e2(x1)
        x3 = self.e3(x2)
        x4 = self.e4(x3)
        x4 = x4 + self.pool(x4.mean((2, 3), keepdim=True))
        y = self.d3(x3 + _resized(self.l4(x4), x3))
        y = self.d2(x2 + _resized(self.l3(y), x2))
        y = self.d1(x1 + _resized(self.l2(y), x1))
        y = self.d0(x0 + _resized(self.l1(y), x0))
        return self.head(y)


def _resized(small, like):
    return F.interpolate(small, size=like.shape[2:], mode="bilinear", align_corners=False)


def load(path):
    """The network with the weights of a file that `train` wrote; its widths follow from the weights."""
    state = torch.load(path, map_location="cpu", weights_only=True)
    widths = [state["stem.0.weight"].shape[0]] + [state[f"e{i}.0.0.weight"].shape[0] for i in range(1, 5)]
    net = AffinityNet(widths)
    net.load_state_dict(state)
    return net.eval()
