"""YOLOv8-seg with one class, the network of FastSAM (Zhao et al. 2023).

Structure and tensor names match `crates/models/src/fastsam`: a backbone of five stages, a neck that goes up to stride 8
and back down (PANet, Liu et al. 2018), and a head with decoupled branches at strides 8, 16 and 32 for boxes, scores and
mask coefficients, plus mask prototypes at stride 4 (YOLACT, Bolya et al. 2019).
"""

import math
from typing import NamedTuple

import torch
import torch.nn.functional as F
from safetensors.torch import load_file
from torch import nn

STRIDES = (8, 16, 32)
BINS = 16  # bins of the distribution of the distance between an anchor's centre and a side of its box
PROTOTYPE_STRIDE = 4
SIZES = {  # multiples of depth and width, maximum channels before widening
    "n": (1 / 3, 0.25, 1024),
    "s": (1 / 3, 0.5, 1024),
    "m": (2 / 3, 0.75, 768),
    "l": (1.0, 1.0, 512),
    "x": (1.0, 1.25, 512),
}
# The first and the last convolutions, for the optimiser.
OUTER = ("model.0.", *(f"model.22.{branch}.{level}.2" for branch in ("cv2", "cv3", "cv4") for level in range(3)))
SCORE_PRIOR = 0.01  # score of every anchor before training (Lin et al. 2017, section 4.1)


class Config(NamedTuple):
    """The sizes of a YOLOv8-seg network."""

    channels: tuple  # of the backbone's five stages, strides 2 to 32
    repeats: tuple  # bottlenecks of layers 2, 4, 6, 8 of the backbone and 12, 15, 18, 21 of the neck
    prototype_channels: int  # hidden channels of the prototypes' branch
    prototypes: int = 32


class Output(NamedTuple):
    """Raw outputs for the A anchors of N images: level by level, row by row."""

    distances: torch.Tensor  # [N, A, 4, BINS] logits: left, top, right, bottom, in strides
    scores: torch.Tensor  # [N, A] logits
    coefficients: torch.Tensor  # [N, A, P]
    prototypes: torch.Tensor  # [N, P, H / 4, W / 4]


def scaled(depth, width, most=1024):
    """The `Config` for multiples of depth and width, with at most `most` channels before widening."""

    def channels(base):
        return 8 * math.ceil(min(base, most) * width / 8)

    repeats = tuple(max(1, round(base * depth)) for base in (3, 6, 6, 3, 3, 3, 3, 3))
    return Config(tuple(map(channels, (64, 128, 256, 512, 1024))), repeats, channels(256))


class Conv(nn.Module):
    """Convolution, batch norm, SiLU."""

    def __init__(self, inputs, outputs, kernel=1, stride=1):
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
        self.bn = nn.BatchNorm2d(outputs, eps=1e-3)

    def forward(self, x):
        return F.silu(self.bn(self.conv(x)))


class Bottleneck(nn.Module):
    """Two 3×3 convolutions; with a shortcut, their input is added."""

    def __init__(self, channels, shortcut):
        super().__init__()
        self.cv1, self.cv2 = Conv(channels, channels, 3), Conv(channels, channels, 3)
        self.shortcut = shortcut

    def forward(self, x):
        y = self.cv2(self.cv1(x))
        return x + y if self.shortcut else y


class C2f(nn.Module):
    """Splits its channels in two, chains bottlenecks on the second half and joins the outputs of all of them."""

    def __init__(self, inputs, outputs, repeats, shortcut):
        super().__init__()
        hidden = outputs // 2
        self.cv1, self.cv2 = Conv(inputs, 2 * hidden), Conv((2 + repeats) * hidden, outputs)
        self.m = nn.ModuleList(Bottleneck(hidden, shortcut) for _ in range(repeats))

    def forward(self, x):
        parts = list(self.cv1(x).chunk(2, 1))
        for bottleneck in self.m:
            parts.append(bottleneck(parts[-1]))
        return self.cv2(torch.cat(parts, 1))


class Sppf(nn.Module):
    """Maxima over windows of 5, 9 and 13 pixels, as chained 5×5 poolings (spatial pyramid pooling, He et al. 2014)."""

    def __init__(self, channels):
        super().__init__()
        self.cv1, self.cv2 = Conv(channels, channels // 2), Conv(2 * channels, channels)

    def forward(self, x):
        parts = [self.cv1(x)]
        for _ in range(3):
            parts.append(F.max_pool2d(parts[-1], 5, 1, 2))
        return self.cv2(torch.cat(parts, 1))


class Prototypes(nn.Module):
    """Prototypes [N, P, 2h, 2w] from features [N, C, h, w] of stride 8."""

    def __init__(self, inputs, hidden, outputs):
        super().__init__()
        self.cv1, self.cv2, self.cv3 = Conv(inputs, hidden, 3), Conv(hidden, hidden, 3), Conv(hidden, outputs)
        self.upsample = nn.ConvTranspose2d(hidden, hidden, 2, 2)

    def forward(self, x):
        return self.cv3(self.cv2(self.upsample(self.cv1(x))))


class Head(nn.Module):
    """`cv2`, `cv3` and `cv4`: the branches of boxes, scores and mask coefficients, one of each per stride."""

    def __init__(self, inputs, config):
        super().__init__()
        masks = config.prototypes

        def branches(hidden, outputs):
            return nn.ModuleList(
                nn.Sequential(Conv(c, hidden, 3), Conv(hidden, hidden, 3), nn.Conv2d(hidden, outputs, 1))
                for c in inputs
            )

        self.cv2 = branches(max(inputs[0] // 4, 4 * BINS), 4 * BINS)
        self.cv3 = branches(inputs[0], 1)
        self.cv4 = branches(max(inputs[0] // 4, masks), masks)
        self.proto = Prototypes(inputs[0], config.prototype_channels, masks)
        for branch in self.cv3:
            nn.init.constant_(branch[-1].bias, math.log(SCORE_PRIOR / (1 - SCORE_PRIOR)))

    def forward(self, features):
        def joined(branches):
            return torch.cat([branch(x).flatten(2) for branch, x in zip(branches, features)], 2).transpose(1, 2)

        distances = joined(self.cv2)
        return Output(
            distances.unflatten(2, (4, BINS)), joined(self.cv3)[..., 0], joined(self.cv4), self.proto(features[0])
        )


class FastSam(nn.Module):
    """`Output` of images [N, 3, H, W], RGB in [0, 1], whose sides are multiples of 32."""

    def __init__(self, config):
        super().__init__()
        self.config = config
        p1, p2, p3, p4, p5 = config.channels
        r = config.repeats
        layers = {
            0: Conv(3, p1, 3, 2),
            1: Conv(p1, p2, 3, 2),
            2: C2f(p2, p2, r[0], True),
            3: Conv(p2, p3, 3, 2),
            4: C2f(p3, p3, r[1], True),
            5: Conv(p3, p4, 3, 2),
            6: C2f(p4, p4, r[2], True),
            7: Conv(p4, p5, 3, 2),
            8: C2f(p5, p5, r[3], True),
            9: Sppf(p5),
            12: C2f(p5 + p4, p4, r[4], False),
            15: C2f(p4 + p3, p3, r[5], False),
            16: Conv(p3, p3, 3, 2),
            18: C2f(p3 + p4, p4, r[6], False),
            19: Conv(p4, p4, 3, 2),
            21: C2f(p4 + p5, p5, r[7], False),
            22: Head((p3, p4, p5), config),
        }
        # The skipped numbers are upsamplings and concatenations, which have no weights.
        self.model = nn.ModuleDict({str(number): layer for number, layer in layers.items()})

    def forward(self, x):
        def run(x, *numbers):
            for number in numbers:
                x = self.model[str(number)](x)
            return x

        def joined(number, *parts):
            return run(torch.cat(parts, 1), number)

        stride8 = run(x, 0, 1, 2, 3, 4)
        stride16 = run(stride8, 5, 6)
        stride32 = run(stride16, 7, 8, 9)
        middle = joined(12, F.interpolate(stride32, scale_factor=2.0), stride16)
        fine = joined(15, F.interpolate(middle, scale_factor=2.0), stride8)
        middle = joined(18, run(fine, 16), middle)
        coarse = joined(21, run(middle, 19), stride32)
        return self.model["22"]([fine, middle, coarse])


def config_of(state):
    """Derives the `Config` from tensors by name."""

    def outputs(name):
        return state[name].shape[0]

    def bottlenecks(layer):
        return sum(name.startswith(f"model.{layer}.m.") and name.endswith(".cv1.conv.weight") for name in state)

    return Config(
        tuple(outputs(f"model.{layer}.conv.weight") for layer in (0, 1, 3, 5, 7)),
        tuple(bottlenecks(layer) for layer in (2, 4, 6, 8, 12, 15, 18, 21)),
        outputs("model.22.proto.cv1.conv.weight"),
        outputs("model.22.proto.cv3.conv.weight"),
    )


def load(path):
    """Loads the network from weights written by `train` or a `.safetensors` file in the layout of `export`."""
    if str(path).endswith(".safetensors"):
        state = load_file(path)
    else:
        state = torch.load(path, map_location="cpu", weights_only=True)
    net = FastSam(config_of(state))
    names = net.state_dict().keys()
    state = {name: tensor for name, tensor in state.items() if name in names}
    net.load_state_dict({name: t.float() if t.is_floating_point() else t for name, t in state.items()})
    return net.eval()
