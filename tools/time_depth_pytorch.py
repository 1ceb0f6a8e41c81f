#!/usr/bin/env python3
"""Times Depth Anything V2 Small of Transformers on the CPU, with random weights, and splatseg's beside it, by turns.

pip install torch torchvision transformers        # in a virtual environment
cargo build --release -p splatseg-models --no-default-features --example depth_anything_time
python tools/time_depth_pytorch.py target/release/examples/depth_anything_time --threads 2
"""

import argparse
import os
import re
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

import torch
from transformers import DepthAnythingConfig, DepthAnythingForDepthEstimation


def median_ms(run, repetitions):
    times = []
    for _ in range(repetitions + 1):
        started = time.perf_counter()
        run()
        times.append(1e3 * (time.perf_counter() - started))
    return statistics.median(times[1:])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("program", type=Path, help="the example depth_anything_time")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--sides", type=int, nargs="+", default=[252, 518], help="short sides, pixels")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--repetitions", type=int, default=5)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(1)
    config = DepthAnythingConfig()
    config.backbone_config.set_output_features_output_indices(out_indices=[3, 6, 9, 12], out_features=None)
    model = DepthAnythingForDepthEstimation(config).eval()
    environment = os.environ | {"RAYON_NUM_THREADS": str(arguments.threads)}
    with tempfile.TemporaryDirectory() as folder, torch.inference_mode():
        model.save_pretrained(folder)
        for side in arguments.sides:
            long_side = round(side * 4 / 3 / 14) * 14
            pixels = torch.rand(1, 3, side, long_side)
            ours, theirs = [], []
            for _ in range(arguments.rounds):
                theirs.append(median_ms(lambda pixels=pixels: model(pixels), arguments.repetitions))
                command = [arguments.program, f"{folder}/model.safetensors", str(side), str(arguments.repetitions)]
                text = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout
                ours.append(float(re.search(r": ([0-9.]+) ms", text)[1]))
            ours, theirs = statistics.median(ours), statistics.median(theirs)
            print(
                f"{long_side} x {side}, {arguments.threads} threads: splatseg {ours:.0f} ms, PyTorch {theirs:.0f} ms,"
                f" {ours / theirs:.2f} x"
            )


if __name__ == "__main__":
    main()
