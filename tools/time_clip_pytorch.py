#!/usr/bin/env python3
"""Times a network of OpenCLIP on the CPU, with random weights, and writes them for the example `clip_time`.

pip install torch torchvision open_clip_torch timm         # in a virtual environment
python tools/time_clip_pytorch.py PE-Core-S-16-384 s16.safetensors --threads 2
"""

import argparse
import time
from pathlib import Path

import open_clip
import torch
from safetensors.torch import save_file


def median_ms(run, repetitions):
    times = []
    for _ in range(repetitions + 1):
        started = time.perf_counter()
        run()
        times.append(1e3 * (time.perf_counter() - started))
    return sorted(times[1:])[repetitions // 2]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("model", help="a configuration of OpenCLIP, e.g. PE-Core-S-16-384")
    parser.add_argument("file", type=Path, help="written if it does not exist")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--compile", action="store_true")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(1)
    model = open_clip.create_model(arguments.model).eval()
    if not arguments.file.exists():
        save_file({name: tensor.contiguous() for name, tensor in model.state_dict().items()}, arguments.file)
    side = model.visual.image_size
    side = side[0] if isinstance(side, tuple) else side
    image = torch.rand(1, 3, side, side)
    tokens = open_clip.get_tokenizer(arguments.model)([f"a photo of a thing number {index}" for index in range(32)])
    encode = torch.compile(model.encode_image) if arguments.compile else model.encode_image
    with torch.inference_mode():
        print(f"image: {median_ms(lambda: encode(image), arguments.repetitions):.1f} ms")
        text = median_ms(lambda: model.encode_text(tokens), arguments.repetitions)
        print(f"text: {text / len(tokens):.2f} ms each, of {len(tokens)}")


if __name__ == "__main__":
    main()
