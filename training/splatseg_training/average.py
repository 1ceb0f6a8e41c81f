"""Averages the weights of two runs: `python -m splatseg_training.average A/weights.pt B/weights.pt --out AB/weights.pt`.

If B started from A's weights, their mean is often better than both (Wortsman et al., *Robust fine-tuning of zero-shot
models*, CVPR 2022), because it retains more of A.
"""

import argparse
import os

import torch


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", metavar="A")
    parser.add_argument("second", metavar="B")
    parser.add_argument("--share", type=float, default=0.5, help="share of B, 0 to 1")
    parser.add_argument("--out", required=True, metavar="WEIGHTS")
    options = parser.parse_args(arguments)
    if not 0 <= options.share <= 1:
        parser.error(f"--share is {options.share}, expected 0 to 1")
    first, second = (
        torch.load(path, map_location="cpu", weights_only=True) for path in (options.first, options.second)
    )
    os.makedirs(os.path.dirname(os.path.abspath(options.out)), exist_ok=True)
    torch.save(average(first, second, options.share), options.out)


def average(first, second, share):
    """The tensors by name, each (1 - share) times the first plus `share` times the second; integers are the
    second's."""
    shapes = [{name: tuple(tensor.shape) for name, tensor in tensors.items()} for tensors in (first, second)]
    if shapes[0] != shapes[1]:
        raise ValueError("the two files are not of the same network")
    return {
        name: torch.lerp(first[name], tensor, share) if tensor.is_floating_point() else tensor
        for name, tensor in second.items()
    }


if __name__ == "__main__":
    main()
