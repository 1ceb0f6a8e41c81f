"""Converts weights to the file of `--segmenter fastsam`: `python -m splatseg_training.fastsam.export RUN/weights.pt OUT`.

The tensors have the names and shapes of FastSAM's published checkpoints, in half precision; `splatseg` folds the batch
norms on loading.
"""

import argparse

import torch
from safetensors.torch import save_file

from .network import BINS, load


def export(weights, out):
    """Writes the file; returns its number of parameters."""
    net = load(weights)
    tensors = {name: t.half() if t.is_floating_point() else t for name, t in net.state_dict().items()}
    # Published files store the bins' values, used for a distribution's mean, as a convolution.
    tensors["model.22.dfl.conv.weight"] = torch.arange(BINS).half().view(1, BINS, 1, 1)
    if not all(torch.isfinite(tensor).all() for tensor in tensors.values()):
        raise ValueError(f"{weights}: has weights beyond the range of half precision")
    save_file({name: tensor.contiguous() for name, tensor in tensors.items()}, out)
    return sum(parameter.numel() for parameter in net.parameters())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights")
    parser.add_argument("out", metavar="OUT.safetensors")
    options = parser.parse_args()
    print(f"{options.out}: {export(options.weights, options.out)} parameters")


if __name__ == "__main__":
    main()
