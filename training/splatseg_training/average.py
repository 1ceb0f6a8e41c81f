"""Averages the weights of two runs: `python -m splatseg_training.average A/weights.pt B/weights.pt --out AB/weights.pt`.

If B started from A's weights, their mean is often better than both (Wortsman et al., *Robust fine-tuning of zero-shot
models*, CVPR 2022), because it retains more of A. Both may also be exported files, `.safetensors`; so is the result then,
with B's threshold.
"""

import argparse
import os

import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", metavar="A")
    parser.add_argument("second", metavar="B")
    parser.add_argument("--share", type=float, default=0.5, help="share of B, 0 to 1")
    parser.add_argument("--out", required=True, metavar="WEIGHTS")
    options = parser.parse_args(arguments)
    if not 0 <= options.share <= 1:
        parser.error(f"--share is {options.share}, expected 0 to 1")
    paths = (options.first, options.second, options.out)
    exported = {path.endswith(".safetensors") for path in paths}
    if len(exported) > 1:
        parser.error("expected either only .safetensors, exported files, or none")
    os.makedirs(os.path.dirname(os.path.abspath(options.out)), exist_ok=True)
    if exported.pop():
        average_exported(*paths, options.share)
        return
    first, second = (torch.load(path, map_location="cpu", weights_only=True) for path in paths[:2])
    torch.save(average(first, second, options.share), options.out)


def average_exported(first, second, out, share):
    """Writes the average of two exported files, half precision."""
    with safe_open(second, "pt") as file:
        metadata = file.metadata()
    tensors = ({name: tensor.float() for name, tensor in load_file(path).items()} for path in (first, second))
    mean = average(*tensors, share)
    save_file({name: tensor.half() for name, tensor in mean.items()}, out, metadata=metadata)


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
