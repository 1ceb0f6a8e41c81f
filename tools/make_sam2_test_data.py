#!/usr/bin/env python3
"""Writes the official SAM 2.1 code's results with weights given by a formula, for
`crates/models/tests/it/sam2_formula.rs`.

    pip install torch torchvision sam2 safetensors        # in a virtual environment
    python tools/make_sam2_test_data.py crates/models/tests/data/sam2

No checkpoint is needed: element i of the tensor called n is `offset + scale · u(n, i)`, where u is a hash of both in
[-1, 1), and offset and scale depend on the last part of the name (`formula`; `tests/it/sam2_golden/mod.rs` is the same in
Rust). The model is a miniature with the structure and flags of Hiera-B+; the video is given by a formula, too.

    manifest_mini.json                          names and shapes of the miniature's parameters
    manifest_{tiny,small,base_plus,large}.json  those of the published sizes
    formula_video.safetensors                   three objects, prompted with a mask, a box and clicks on the first of five frames:
                                                low-resolution logits, object scores and pointers [frame, object, ..], and the image
                                                embedding of the first frame
    formula_stream.safetensors                  the same, but clicks correct object 1 on frame 2, from whose successor
                                                propagation goes on, and small holes are filled: the defaults of
                                                `build_sam2_video_predictor`. Its CUDA kernel for components is replaced

The first video is computed without filling holes, as without that kernel.
"""

import json
import math
import sys
from pathlib import Path

import hydra
import numpy
import sam2.utils.misc
import torch
from hydra import compose, initialize_config_module
from hydra.utils import instantiate
from make_sam2_size_test_data import OVERRIDES, override
from omegaconf import OmegaConf
from safetensors.numpy import save_file

SIZE = 128
FRAMES = 5
CORRECTED_FRAME = 2
PUBLISHED = {"tiny": "t", "small": "s", "base_plus": "b+", "large": "l"}


def hash_of(name):
    value = 0xCBF29CE484222325
    for byte in name.encode():
        value = (value ^ byte) * 0x100000001B3 % 2**64
    return value


def uniform(name, indices):
    """Numbers of the sequence `name`, in [-1, 1): SplitMix64 of its FNV-1a hash plus the index."""
    z = numpy.uint64((hash_of(name) + 0x9E3779B97F4A7C15) % 2**64) + indices.astype(numpy.uint64)
    z = (z ^ (z >> numpy.uint64(30))) * numpy.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> numpy.uint64(27))) * numpy.uint64(0x94D049BB133111EB)
    z = z ^ (z >> numpy.uint64(31))
    return (z >> numpy.uint64(11)).astype(numpy.float64) / 2**53 * 2 - 1


def formula(name, shape):
    """A parameter, float32."""
    leaf = name.rsplit(".", 1)[-1]
    if leaf == "positional_encoding_gaussian_matrix":
        offset, scale = 0, math.sqrt(3)
    elif leaf == "gamma":
        offset, scale = 1, 0.1
    elif name == "sam_mask_decoder.pred_obj_score_head.layers.2.bias":
        offset, scale = 3, 0.05
    elif leaf == "weight" and len(shape) >= 2:
        offset, scale = 0, math.sqrt(3 / math.prod(shape[1:]))
    elif leaf in ("weight", "running_var"):
        offset, scale = 1, 0.1
    elif leaf in ("bias", "running_mean"):
        offset, scale = 0, 0.05
    elif leaf in ("latents", "latents_2d"):
        offset, scale = 0, 1
    else:
        offset, scale = 0, 0.02
    values = offset + scale * uniform(name, numpy.arange(math.prod(shape)))
    return torch.from_numpy(values.astype(numpy.float32).reshape(shape))


def frame(t):
    """A normalised input with moving coarse cells and fine noise, float32 [3, SIZE, SIZE]."""
    channel, y, x = numpy.indices((3, SIZE, SIZE))
    cells = SIZE // 16
    coarse = channel * cells * cells + (y + 2 * t) // 16 % cells * cells + (x + 4 * t) // 16 % cells
    fine = (channel * SIZE + y) * SIZE + x
    values = 1.5 * uniform("input.coarse", coarse) + 0.5 * uniform(f"input.fine.{t}", fine)
    return torch.from_numpy(values.astype(numpy.float32))


def network(config_name, overrides):
    with initialize_config_module("sam2", version_base=None):
        config = compose(f"configs/sam2.1/sam2.1_hiera_{config_name}.yaml", overrides=overrides)
    OmegaConf.resolve(config)
    return instantiate(config.model, _recursive_=True).eval()


def write_manifest(path, model):
    tensors = [[name, list(tensor.shape)] for name, tensor in model.state_dict().items()]
    manifest = json.loads(path.read_text()) if path.exists() else {}
    if manifest.get("tensors", tensors) != tensors:
        raise SystemExit(f"{path}: names or shapes differ")
    path.write_text(json.dumps(manifest | {"tensors": tensors}) + "\n")


def components(background):
    """8-connected components of `[objects, 1, height, width]`: labels from 1, and the area of each pixel's component."""
    labels, areas = torch.zeros(background.shape, dtype=torch.int32), torch.zeros(background.shape, dtype=torch.int32)
    for item, plane in enumerate(background[:, 0].numpy()):
        left = set(zip(*(places.tolist() for places in plane.nonzero()), strict=True))
        label = 0
        while left:
            label += 1
            region = [left.pop()]
            for row, column in region:
                around = {(row + down, column + right) for down in (-1, 0, 1) for right in (-1, 0, 1)} & left
                region.extend(around)
                left -= around
            rows, columns = zip(*region, strict=True)
            labels[item, 0, rows, columns] = label
            areas[item, 0, rows, columns] = len(region)
    return labels, areas


def follow(predictor, correct_frame):
    """Prompts three objects on the first frame and tracks them, with a correction of the first object on a frame."""
    y, x = torch.meshgrid(torch.arange(SIZE), torch.arange(SIZE), indexing="ij")
    state = predictor.init_state(video_path="")
    predictor.add_new_mask(state, 0, 1, (x >= 20) & (x < 60) & (y >= 30) & (y < 70))
    predictor.add_new_points_or_box(state, 0, 2, box=[70.0, 20.0, 118.0, 64.0])
    clicks = {"points": [[40.0, 96.0], [90.0, 100.0]], "labels": [1, 0]}
    predictor.add_new_points_or_box(state, 0, 3, **clicks)
    if correct_frame is not None:
        for _ in predictor.propagate_in_video(state, start_frame_idx=0, max_frame_num_to_track=correct_frame):
            pass
        clicks = {"points": [[48.0, 60.0], [100.0, 30.0], [30.0, 50.0]], "labels": [1, 0, 1]}
        predictor.add_new_points_or_box(state, correct_frame, 1, **clicks)
    start = 0 if correct_frame is None else correct_frame + 1
    for _ in predictor.propagate_in_video(state, start_frame_idx=start):
        pass

    def outputs(key):
        def of(index, t):
            outputs = state["output_dict_per_obj"][index]
            return outputs["cond_frame_outputs" if t == 0 else "non_cond_frame_outputs"][t][key][0]

        return torch.stack([torch.stack([of(index, t) for index in range(3)]) for t in range(FRAMES)]).float()

    tensors = {
        "low_res_logits": outputs("pred_masks")[:, :, 0],
        "object_score_logits": outputs("object_score_logits")[..., 0],
    }
    return tensors | {"obj_ptr": outputs("obj_ptr")}


def main():
    folder = Path(sys.argv[1])
    hydra.core.global_hydra.GlobalHydra.instance().clear()  # importing sam2 has set one up
    for size, config in PUBLISHED.items():
        write_manifest(folder / f"manifest_{size}.json", network(config, []))
    sides = f"[{SIZE // 16},{SIZE // 16}]"
    changed = {"image_size": SIZE, "memory_attention.layer.self_attention.feat_sizes": sides}
    changed |= {"memory_attention.layer.cross_attention.feat_sizes": sides}
    predictor = network("b+", [override(*item) for item in (OVERRIDES | changed).items()])
    write_manifest(folder / "manifest_mini.json", predictor)
    predictor.load_state_dict({name: formula(name, tensor.shape) for name, tensor in predictor.state_dict().items()})

    import sam2.sam2_video_predictor as module

    images = torch.stack([frame(t) for t in range(FRAMES)])
    module.load_video_frames = lambda **_: (images, SIZE, SIZE)
    sam2.utils.misc.get_connected_components = components
    with torch.inference_mode():
        embedding = predictor.forward_image(images[:1])["backbone_fpn"][2]
        videos = {"formula_video": follow(predictor, None) | {"embedding": embedding}}
        predictor.fill_hole_area = 8
        videos["formula_stream"] = follow(predictor, CORRECTED_FRAME)
    for name, tensors in videos.items():
        save_file({key: tensor.contiguous().numpy() for key, tensor in tensors.items()}, folder / f"{name}.safetensors")
        print(name, {key: tuple(tensor.shape) for key, tensor in tensors.items()})
        print("object scores", tensors["object_score_logits"].flatten().tolist())
        print("share of the image in each mask", (tensors["low_res_logits"] > 0).float().mean(dim=(2, 3)).tolist())
        print("filled pixels", (tensors["low_res_logits"] == 0.1).sum(dim=(2, 3)).tolist())


if __name__ == "__main__":
    main()
