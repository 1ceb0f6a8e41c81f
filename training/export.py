"""Converts weights of the affinity network to what `--segmenter affinity --weights FILE` reads.

    python training/export.py WEIGHTS.pt OUT.safetensors [--threshold -1.5]

Batch norms are folded into their convolutions, and numbers become half precision. Names: `stem`; `e1.0`, `e1.1.a`,
`e1.1.b`, ... for the stages down; `pool`; `l4`, `d3.0`, ... for the path up; `head`; each with `.weight` `[outputs,
inputs, kernel, kernel]` and `.bias`. Metadata: `offsets` (JSON list of (row, column)) and `threshold`. Needs torch and
safetensors.
"""

import argparse
import json
import re

import torch
from safetensors.torch import save_file

OFFSETS = [
    (0, 1), (1, 0), (0, 3), (3, 0), (0, 9), (9, 0), (9, 9), (9, -9), (0, 27), (27, 0), (18, 18), (18, -18),
]  # fmt: skip
EPSILON = 1e-5


def folded(state):
    """Convolutions with their batch norms folded in, by name."""
    out = {}
    for key in state:
        if not key.endswith("weight") or state[key].dim() != 4:
            continue
        name, weight = key.removesuffix(".weight"), state[key].double()
        norm = re.sub(r"0$", "1", name)
        if name + ".bias" in state:
            bias = state[name + ".bias"].double()
        else:
            mean, variance = state[norm + ".running_mean"].double(), state[norm + ".running_var"].double()
            scale = state[norm + ".weight"].double() / torch.sqrt(variance + EPSILON)
            weight, bias = weight * scale[:, None, None, None], state[norm + ".bias"].double() - mean * scale
            name = name.removesuffix(".0")
        if re.fullmatch(r"d\d+", name):
            name += ".0"
        out[name + ".weight"], out[name + ".bias"] = weight.half().contiguous(), bias.half().contiguous()
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights")
    parser.add_argument("out")
    parser.add_argument("--threshold", type=float, default=-1.5, help="mean log-odds down to which regions are merged")
    arguments = parser.parse_args()
    tensors = folded(torch.load(arguments.weights, map_location="cpu", weights_only=True))
    metadata = {"offsets": json.dumps(OFFSETS), "threshold": str(arguments.threshold)}
    save_file(tensors, arguments.out, metadata)
    count = sum(tensor.numel() for tensor in tensors.values())
    print(f"{arguments.out}: {len(tensors)} tensors, {count} numbers")


if __name__ == "__main__":
    main()
