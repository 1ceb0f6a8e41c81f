"""Converts weights to the file of `--segmenter affinity`: `python -m splatseg_training.export RUN/weights.pt OUT`.

Batch norms are folded into their convolutions, and numbers become half precision. Names: `stem`; `e1.0`, `e1.1.a`,
`e1.1.b`, ... for the stages down; `pool`; `l4`, `d3.0`, ... for the path up; `head`; each with `.weight` `[outputs,
inputs, kernel, kernel]` and `.bias`. Metadata: `offsets` (JSON list of (row, column)) and `threshold`.
"""

import argparse
import json

import torch
from safetensors.torch import save_file
from torch.nn.utils.fusion import fuse_conv_bn_eval

from .affinities import OFFSETS
from .network import ConvBlock, exported, load


def folded(net):
    """Tensors by name, float64: weight and bias of each convolution, with its batch norm folded in."""
    net = net.double().eval()
    tensors = {}
    for name, module in exported(net):
        convolution = fuse_conv_bn_eval(module[0], module[1]) if isinstance(module, ConvBlock) else module
        tensors[name + ".weight"] = convolution.weight.detach()
        tensors[name + ".bias"] = convolution.bias.detach()
    return tensors


def export(weights, out, threshold):
    """Writes the file; returns its number of values."""
    tensors = {name: tensor.half().contiguous() for name, tensor in folded(load(weights)).items()}
    if not all(torch.isfinite(tensor).all() for tensor in tensors.values()):
        raise ValueError(f"{weights}: has weights beyond the range of half precision")
    save_file(tensors, out, {"offsets": json.dumps(OFFSETS), "threshold": str(threshold)})
    return sum(tensor.numel() for tensor in tensors.values())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights")
    parser.add_argument("out", metavar="OUT.safetensors")
    parser.add_argument("--threshold", type=float, default=-1.0, help="mean log-odds down to which regions are merged")
    options = parser.parse_args()
    print(f"{options.out}: {export(options.weights, options.out, options.threshold)} numbers")


if __name__ == "__main__":
    main()
