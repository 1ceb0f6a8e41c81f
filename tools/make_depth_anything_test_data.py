#!/usr/bin/env python3
"""Writes what Depth Anything V2 computes with weights given by a formula, for `crates/models/tests/it/depth_anything.rs`.

    pip install torch torchvision transformers                          # in a virtual environment
    git clone https://github.com/DepthAnything/Depth-Anything-V2
    python tools/make_depth_anything_test_data.py Depth-Anything-V2 crates/models/tests/data/depth_anything

Weights, names and shapes: as in `make_clip_test_data.py`. Each network is a miniature with the structure of the published
ones, of the authors' code or of Hugging Face's Transformers. A file has its parameters' names and shapes, its configuration
if there is one, and every third row and column of its depth of two images: one whose patches have a position each, and one
of another shape, for which the positions are interpolated.

The files `full_…` are the same with the sizes of Small and one image, of which they have every tenth row and column.
"""

import json
import math
import sys
import types
from dataclasses import dataclass, replace
from pathlib import Path

import numpy
import torch
from transformers import DepthAnythingConfig, DepthAnythingForDepthEstimation, Dinov2Config

PATCH = 14
MEAN, DEVIATION = [0.485, 0.456, 0.406], [0.229, 0.224, 0.225]


@dataclass
class Sizes:
    width: int
    blocks: int
    heads: int
    grid: int
    stages: list
    features: int
    # Of images, and of the steps at which their depth is written.
    images: list
    step: int

    def taps(self):
        return [quarter * self.blocks // 4 for quarter in (1, 2, 3, 4)]


# The authors' networks have heads of 64 channels.
MINIATURE = Sizes(128, 4, 2, 5, [8, 12, 16, 24], 16, [(70, 70), (98, 56)], 3)
FULL = Sizes(384, 12, 6, 37, [48, 96, 192, 384], 64, [(350, 252)], 10)


def hash_of(name):
    value = 0xCBF29CE484222325
    for byte in name.encode():
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def uniform(name, count):
    """Numbers of the sequence `name`, in [-1, 1): SplitMix64 of its FNV-1a hash plus the index."""
    z = numpy.uint64((hash_of(name) + 0x9E3779B97F4A7C15) % 2**64) + numpy.arange(count, dtype=numpy.uint64)
    z = (z ^ (z >> numpy.uint64(30))) * numpy.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> numpy.uint64(27))) * numpy.uint64(0x94D049BB133111EB)
    z = z ^ (z >> numpy.uint64(31))
    return (z >> numpy.uint64(11)).astype(numpy.float64) / 2**53 * 2 - 1


def formula(name, shape):
    """A parameter, float32."""
    leaf = name.rsplit(".", 1)[-1]
    if leaf == "weight" and len(shape) >= 2:
        offset, scale = 0, math.sqrt(3 / math.prod(shape[1:]))
    elif leaf == "weight":
        offset, scale = 1, 0.1
    elif shape == (1,):
        # The last layer's, so that inverse depth is above 0 nearly everywhere.
        offset, scale = 0.5, 0.05
    elif leaf == "bias":
        offset, scale = 0, 0.05
    else:
        offset, scale = 0, 0.5
    values = offset + scale * uniform(name, math.prod(shape))
    return torch.from_numpy(values.astype(numpy.float32).reshape(shape))


def set_formula(tensors):
    """Sets the parameters; returns their names and shapes."""
    for name, tensor in tensors.items():
        tensor.copy_(formula(name, tuple(tensor.shape)))
    return [[name, list(tensor.shape)] for name, tensor in tensors.items()]


def image_of(width, height):
    values = uniform("pixels", width * height * 3)
    # Smooth, so that the depth has a shape.
    rows, columns = numpy.mgrid[0:height, 0:width]
    wave = numpy.stack([columns / width, rows / height, (columns + rows) / (width + height)], axis=-1)
    return ((values.reshape(height, width, 3) * 0.2 + wave * 0.8 + 0.2).clip(0, 1) * 255.0).astype(numpy.uint8)


def input_of(image):
    normalised = (torch.from_numpy(image).float() / 255 - torch.tensor(MEAN)) / torch.tensor(DEVIATION)
    return normalised.permute(2, 0, 1)[None]


def official_network(folder, sizes, metric):
    """The authors' network. Their module imports OpenCV for images only, which are not read here."""
    sys.modules.setdefault("cv2", types.ModuleType("cv2"))
    sys.modules["cv2"].INTER_CUBIC = sys.modules["cv2"].INTER_AREA = 0
    sys.path.insert(0, str(folder / "metric_depth" if metric else folder))
    for name in [name for name in sys.modules if name.startswith("depth_anything_v2")]:
        del sys.modules[name]
    from depth_anything_v2 import dpt
    from depth_anything_v2.dinov2 import DinoVisionTransformer

    sys.path.pop(0)

    def encoder(model_name):
        return DinoVisionTransformer(
            img_size=sizes.grid * PATCH,
            patch_size=PATCH,
            embed_dim=sizes.width,
            depth=sizes.blocks,
            num_heads=sizes.heads,
            init_values=1.0,
            block_chunks=0,
        )

    published = dpt.DINOv2
    dpt.DINOv2 = encoder
    model = dpt.DepthAnythingV2(encoder="vits", features=sizes.features, out_channels=sizes.stages).eval()
    dpt.DINOv2 = published
    model.intermediate_layer_idx = {"vits": [tap - 1 for tap in sizes.taps()]}
    return model


def hugging_face_network(sizes, metric):
    backbone = Dinov2Config(
        image_size=sizes.grid * PATCH,
        patch_size=PATCH,
        hidden_size=sizes.width,
        num_hidden_layers=sizes.blocks,
        num_attention_heads=sizes.heads,
        out_indices=sizes.taps(),
        reshape_hidden_states=False,
    )
    kind = {"depth_estimation_type": "metric", "max_depth": 20} if metric else {}
    config = DepthAnythingConfig(
        backbone_config=backbone,
        reassemble_hidden_size=sizes.width,
        neck_hidden_sizes=sizes.stages,
        fusion_hidden_size=sizes.features,
        **kind,
    )
    return DepthAnythingForDepthEstimation(config).eval(), config


def write(path, model, sizes, run, config=None):
    with torch.no_grad():
        data = {"tensors": set_formula(model.state_dict())}
        if config is not None:
            data["config"] = {
                "model_type": "depth_anything",
                "depth_estimation_type": config.depth_estimation_type,
                "max_depth": config.max_depth,
                "backbone_config": {"num_attention_heads": sizes.heads, "out_indices": sizes.taps()},
            }
        outputs = []
        for width, height in sizes.images:
            depth = run(input_of(image_of(width, height)))[0]
            print(path.name, width, height, "from", depth.min().item(), "to", depth.max().item())
            outputs.append([[round(value, 7) for value in row] for row in depth[:: sizes.step, :: sizes.step].tolist()])
        data["depth"] = outputs
    path.write_text(json.dumps(data, separators=(",", ":")) + "\n")


def main(repository, folder):
    folder.mkdir(parents=True, exist_ok=True)
    for prefix, sizes in (("", MINIATURE), ("full_", FULL)):
        for metric in (False, True):
            ending = "_metric" if metric else ""
            if sizes is FULL and metric:
                continue
            model = official_network(repository, sizes, metric)
            write(folder / f"{prefix}official{ending}.json", model, sizes, model)
            # Other numbers than the usual ones, which the configuration tells.
            heads = replace(sizes, heads=2 * sizes.heads)
            model, config = hugging_face_network(heads, metric)
            write(
                folder / f"{prefix}hugging_face{ending}.json",
                model,
                heads,
                lambda pixels, model=model: model(pixels).predicted_depth,
                config,
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
