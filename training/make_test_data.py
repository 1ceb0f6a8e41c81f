"""Makes the golden data of the affinity segmenter: inputs and log-odds of four small images.

    python training/make_test_data.py WEIGHTS.safetensors crates/segmenter/tests/data/affinity.safetensors

WEIGHTS are the built-in weights. The images are synthetic: slanted surfaces with noise, steps and holes. For each size,
the file has `rgb` [H, W, 3], `depth` [H, W] in millimetres, `camera` (fx, fy, cx, cy), `inputs` [8, H, W] of
`splatseg_training.inputs`, and `log_odds` [12, H/2, W/2], computed from them by PyTorch, with the levels' grids
counted from the centre as in the program. Needs torch and safetensors.
"""

import sys

import numpy as np
import torch
import torch.nn.functional as F
from safetensors.torch import load_file, save_file
from splatseg_training.inputs import inputs

SIZES = [(48, 64), (50, 70), (33, 65), (3, 5)]  # 33 × 65: odd at every level


def forward(weights, x, anchor):
    """Runs the network with folded weights: log-odds [1, 12, H/2, W/2] of an input [1, 8, H, W].

    `anchor` is the pixel (row, column) on the grid of every level. Level by level, it lies on an even or an odd row and
    column, and the layer of stride 2 starts there.
    """

    def layer(name, x, stride=1, activation=F.silu):
        weight = weights[f"{name}.weight"].float()
        return activation(F.conv2d(x, weight, weights[f"{name}.bias"].float(), stride, weight.shape[2] // 2))

    def starts(level, x):
        return [place >> level & 1 if size > 1 else 0 for place, size in zip(anchor, x.shape[2:])]

    def halved(name, level, x):
        top, left = starts(level, x)
        # With zeros before it, the first row or column has an output, too: it is cut off.
        return layer(name, F.pad(x, (left, 0, top, 0)), 2)[:, :, top:, left:]

    def doubled(level, x, like):
        top, left = starts(level, like)
        # Exactly twice the size: an odd size is cropped, not stretched.
        x = F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)
        return F.pad(x, (left, 0, top, 0), mode="replicate")[:, :, : like.shape[2], : like.shape[3]]

    def count(name):
        return next(number for number in range(100) if name.format(number) + ".weight" not in weights)

    def identity(x):
        return x

    stages = [halved("stem", 0, x)]
    while f"e{len(stages)}.0.weight" in weights:
        name = f"e{len(stages)}"
        x = halved(f"{name}.0", len(stages), stages[-1])
        block = 1
        while f"{name}.{block}.a.weight" in weights:
            x = x + layer(f"{name}.{block}.b", layer(f"{name}.{block}.a", x))
            block += 1
        stages.append(x)
    x = stages.pop()
    x = x + layer("pool", x.mean((2, 3), keepdim=True))
    while stages:
        skip = stages.pop()
        level = len(stages)
        lateral = layer(f"l{level + 1}", x, activation=identity)
        x = skip + doubled(level + 1, lateral, skip)
        for index in range(count(f"d{level}.{{}}")):
            x = layer(f"d{level}.{index}", x)
    return layer("head", x, activation=identity)


def scene(height, width, seed):
    """A made-up frame: colour, depth in millimetres with holes and noise, camera matrix."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width] / max(height, width)
    depth = 1200 + 900 * x + 500 * y
    for _ in range(6):
        top, left = random.random(2) * 0.8
        inside = (y >= top) & (y < top + 0.3) & (x >= left) & (x < left + 0.25)
        depth = np.where(inside, random.uniform(500, 2500) + 800 * random.normal() * x, depth)
    depth = np.clip(depth, 250, None) + random.normal(0, 4, depth.shape)
    depth[(random.random(depth.shape) < 0.05) | ((y > 0.5) & (x < 0.2))] = 0
    rgb = 128 + 90 * np.stack([np.sin(9 * x + 3 * y), np.sin(14 * y), np.cos(11 * x * y)], -1)
    rgb = np.clip(rgb + random.normal(0, 10, rgb.shape), 0, 255).astype(np.uint8)
    K = np.array([[0.9 * width, 0, (width - 1) / 2], [0, 0.92 * width, (height - 1) / 2 + 0.7], [0, 0, 1]])
    return rgb, depth.astype(np.uint16), K


def main():
    weights = load_file(sys.argv[1])
    tensors = {}
    for seed, (height, width) in enumerate(SIZES):
        rgb, depth, K = scene(height, width, seed)
        x = torch.from_numpy(inputs(rgb, depth, K))
        name = f"{width}x{height}"
        tensors[f"{name}.rgb"] = torch.from_numpy(rgb)
        tensors[f"{name}.depth"] = torch.from_numpy(depth.astype(np.int32))
        tensors[f"{name}.camera"] = torch.tensor([K[0, 0], K[1, 1], K[0, 2], K[1, 2]], dtype=torch.float32)
        tensors[f"{name}.inputs"] = x
        anchor = (height - 230) // 2, (width - 310) // 2
        with torch.no_grad():
            tensors[f"{name}.log_odds"] = forward(weights, x[None], anchor)[0].contiguous()
    save_file(tensors, sys.argv[2])


if __name__ == "__main__":
    main()
