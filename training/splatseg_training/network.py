"""The affinity network: a U-Net of plain 3×3 convolutions with output at half the input's size."""

import re

import torch
import torch.nn.functional as F
from safetensors.torch import load_file
from torch import nn

from .affinities import OFFSETS
from .inputs import CHANNELS

WIDTHS = (16, 32, 48, 64, 96)
TRAINED_SIZE = 2.0  # typical size of trained kernels: RMS × square root of the number of inputs of an output


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
    """From input [N, 8, H, W] to log-odds [N, 12, H/2, W/2] that a pixel and its neighbour at each offset belong to one
    object.

    Each level looks at every second row and column of the level before, here from the first one on. The program counts
    from the centre instead, so that cropping a frame changes nothing else. Training cuts at random places.

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
    """`small`, enlarged by exactly 2 and cropped to the size of `like`.

    Layers of stride 2 halve sizes and round up. With `size=like.shape[2:]`, odd sizes would be stretched.
    """
    height, width = like.shape[2:]
    doubled = F.interpolate(small, scale_factor=2, mode="bilinear", align_corners=False)
    return doubled[:, :, :height, :width]


def load(path):
    """Loads the network from a file written by `train` or `export`; derives its widths from the weights."""
    if str(path).endswith(".safetensors"):
        return _unfolded(load_file(path)).eval()
    state = torch.load(path, map_location="cpu", weights_only=True)
    net = AffinityNet(_widths(state, "stem.0.weight", "e{}.0.0.weight"))
    net.load_state_dict(state)
    return net.eval()


def _widths(tensors, stem, stage):
    return [tensors[stem].shape[0]] + [tensors[stage.format(i)].shape[0] for i in range(1, 5)]


@torch.no_grad()
def _unfolded(tensors):
    """The network of an exported file. The statistics of its batch norms are lost: train with frozen or restored norms.

    Folding makes the kernels small, so that the usual step sizes would be too large for them. They are scaled to the
    size of trained kernels, and the norms undo the scaling.
    """
    net = AffinityNet(_widths(tensors, "stem.weight", "e{}.0.weight"))
    for name, module in exported(net):
        weight, bias = tensors[name + ".weight"].float(), tensors[name + ".bias"]
        if isinstance(module, ConvBlock):
            scale = TRAINED_SIZE / (weight[0].numel() * weight.square().mean()).sqrt().clamp(min=1e-3)
            module[0].weight.copy_(weight * scale)
            module[1].running_var.fill_(scale**2 - module[1].eps)
            module[1].bias.copy_(bias)
        else:
            module.weight.copy_(weight)
            module.bias.copy_(bias)
    return net


@torch.no_grad()
def restore_norms(net, inputs):
    """Gives the batch norms of an exported file statistics again, those of `inputs` [N, 8, H, W]; changes no output.

    A norm's scale and shift take up the difference, so that it can be trained like one that was never folded.
    """
    statistics, hooks = {}, []

    def keep(module, values):
        statistics[module] = (values[0].mean((0, 2, 3)), values[0].var((0, 2, 3)))

    for module in net.modules():
        if isinstance(module, nn.BatchNorm2d):
            hooks.append(module.register_forward_pre_hook(keep))
    net.eval()(inputs)
    for hook in hooks:
        hook.remove()
    for module, (mean, variance) in statistics.items():
        before, after = ((value + module.eps).sqrt() for value in (module.running_var, variance))
        module.bias += module.weight * (mean - module.running_mean) / before
        module.weight *= after / before
        module.running_mean.copy_(mean)
        module.running_var.copy_(variance)


def exported(net):
    """The convolutions in the order and with the names of `export`: (name, ConvBlock or Conv2d)."""
    for name, module in net.named_modules():
        if isinstance(module, ConvBlock):
            yield (name + ".0" if re.fullmatch(r"d\d", name) else name), module
        elif isinstance(module, nn.Conv2d) and module.bias is not None:
            yield name, module
