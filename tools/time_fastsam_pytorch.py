#!/usr/bin/env python3
"""Times FastSAM's network in PyTorch, eager and compiled, on a device; `measure_gpu.sh` compares it with ours.

    pip install torch ultralytics
    python tools/time_fastsam_pytorch.py weights.pt --size 1024 --device cuda

If the file does not exist, a network --model with random weights is written to it (a network's speed does not depend on
them). Prints one line of JSON.
"""

import argparse
import json
import time
from pathlib import Path

from compare_onnxruntime import random_checkpoint


def milliseconds(network, image, passes, wait):
    import torch

    times = []
    with torch.inference_mode():
        for _ in range(3):
            network(image)
        wait()
        for _ in range(passes):
            started = time.perf_counter()
            network(image)
            wait()
            times.append(1e3 * (time.perf_counter() - started))
    return times


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkpoint", type=Path)
    parser.add_argument("--model", default="yolov8x-seg", help="model of a new file: yolov8{n,s,m,l,x}-seg")
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--passes", type=int, default=50)
    parser.add_argument("--device", default="cuda")
    arguments = parser.parse_args()
    if not arguments.checkpoint.exists():
        random_checkpoint(arguments.checkpoint, arguments.model, arguments.size)
    import torch
    from ultralytics import YOLO

    network = YOLO(arguments.checkpoint).model.float().to(arguments.device).eval()
    image = torch.rand(1, 3, arguments.size, arguments.size, device=arguments.device)
    on_gpu = arguments.device.startswith("cuda")
    wait = torch.cuda.synchronize if on_gpu else lambda: None
    result = {"eager_milliseconds": milliseconds(network, image, arguments.passes, wait)}
    result["compiled_milliseconds"] = milliseconds(torch.compile(network), image, arguments.passes, wait)
    if on_gpu:
        result["peak_device_memory_mib"] = torch.cuda.max_memory_allocated() // 2**20
    print(json.dumps(result))


if __name__ == "__main__":
    main()
