#!/usr/bin/env python3
"""Writes the official EdgeTAM code's results with weights given by a formula, for
`crates/models/tests/it/edgetam.rs`.

    pip install torch torchvision sam2 timm safetensors        # in a virtual environment
    git clone https://github.com/facebookresearch/EdgeTAM
    PYTHONPATH=EdgeTAM python tools/make_edgetam_test_data.py crates/models/tests/data/edgetam

EdgeTAM's package has the name `sam2`, too: on PYTHONPATH it comes first. Weights and video are those of
make_sam2_test_data.py, the model is a miniature of EdgeTAM. Every object is tracked by itself, because this version of
the official predictor tracks all objects together, so that a correction of one changes the memories of all.

    manifest_edgetam.json        names and shapes of the published network's parameters
    manifest_edgetam_mini.json   those of the miniature
    video.safetensors            three objects, prompted with a mask, a box and clicks on the first of five frames;
                                 also the embedding of the first frame and the memory of the first object in it
    stream.safetensors           the same, with a correction of the first object on frame 2, and holes filled
    late.safetensors             an object that is prompted on frame 1, absent in the next two frames and back in the
                                 last (its score is changed by an image without structure)
"""

import json
import math
import sys
from pathlib import Path

import hydra
import sam2.modeling.backbones.timm as backbone
import sam2.utils.misc
import timm
import torch
from hydra import compose, initialize_config_module
from hydra.utils import instantiate
from make_sam2_size_test_data import OVERRIDES, override
from make_sam2_test_data import CORRECTED_FRAME, FRAMES, SIZE, components, formula, frame, write_manifest
from omegaconf import OmegaConf
from safetensors.numpy import save_file

SIDE = SIZE // 16
# The widths of SAM 2.1's miniature, and what build_sam2_video_predictor sets.
MINI = {
    name: value
    for name, value in OVERRIDES.items()
    if ".trunk." not in name and not name.endswith("cross_attention.feat_sizes")
} | {
    "image_size": SIZE,
    "image_encoder.neck.backbone_channel_list": "[48,40,24,16]",
    "memory_attention.layer.self_attention.feat_sizes": f"[{SIDE},{SIDE}]",
    "memory_attention.layer.cross_attention.q_sizes": f"[{SIDE},{SIDE}]",
    "memory_attention.layer.cross_attention.k_sizes": "[4,4]",
    "spatial_perceiver.dim": 16,
    "spatial_perceiver.dim_head": 16,
    "spatial_perceiver.num_latents": 6,
    "spatial_perceiver.num_latents_2d": 16,
    "spatial_perceiver.position_encoding.num_pos_feats": 16,
}
MINI_TRUNK = {"embed_dim": (16, 24, 40, 48), "depth": (2, 1, 3, 1)}
# Factors of the formula's parameters whose names have this part, so that the outputs depend on the memory, and objects
# are absent at times.
FACTORS = [
    ["cross_attn_image.q_proj.weight", 3],
    ["cross_attn_image.k_proj.weight", 3],
    ["cross_attn_image.v_proj.weight", 6],
    ["cross_attn_image.out_proj.weight", 6],
    ["memory_encoder.pix_feat_proj.weight", 0.3],
    ["spatial_perceiver.layers", 1.5],
    ["mask_tokens.weight", 30],
    ["pred_obj_score_head.layers.2.weight", -8],
    ["pred_obj_score_head.layers.2.bias", 0.4],
]
MASK, BOX = "mask", "box"


def network(overrides, trunk):
    """The network with random weights; `trunk` are changes of the trunk."""

    def create(name, pretrained, **options):
        return timm.create_model(name, pretrained=False, **options, **trunk)

    backbone.create_model = create
    with initialize_config_module("sam2", version_base=None):
        config = compose("configs/edgetam.yaml", overrides=[override(*item) for item in overrides.items()])
    OmegaConf.resolve(config)
    return instantiate(config.model, _recursive_=True).eval()


def parameter(name, tensor):
    if tensor.dtype == torch.int64:
        return tensor
    factors = [factor for part, factor in FACTORS if part in name]
    return formula(name, tensor.shape) * math.prod(factors)


def prompt(predictor, state, t, kind):
    y, x = torch.meshgrid(torch.arange(SIZE), torch.arange(SIZE), indexing="ij")
    if kind == MASK:
        predictor.add_new_mask(state, t, 1, (x >= 20) & (x < 60) & (y >= 30) & (y < 70))
    elif kind == BOX:
        predictor.add_new_points_or_box(state, t, 1, box=[70.0, 20.0, 118.0, 64.0])
    else:
        predictor.add_new_points_or_box(state, t, 1, points=kind[0], labels=kind[1])


CLICKS = ([[40.0, 96.0], [90.0, 100.0]], [1, 0])
CORRECTION = ([[48.0, 60.0], [100.0, 30.0], [30.0, 50.0]], [1, 0, 1])


def follow(predictor, kind, first=0, correct_frame=None):
    """Prompts one object on frame `first` and tracks it; returns its outputs in these frames, and the state."""
    state = predictor.init_state(video_path="")
    prompt(predictor, state, first, kind)
    if correct_frame is not None:
        for _ in predictor.propagate_in_video(state, start_frame_idx=first, max_frame_num_to_track=correct_frame):
            pass
        prompt(predictor, state, correct_frame, CORRECTION)
    for _ in predictor.propagate_in_video(state, start_frame_idx=first if correct_frame is None else correct_frame + 1):
        pass

    # EfficientTAM's predictor has one for each object.
    kept = state["output_dict"] if "output_dict" in state else state["output_dict_per_obj"][0]

    def outputs(key):
        def of(t):
            return kept["cond_frame_outputs" if t == first else "non_cond_frame_outputs"][t][key][0]

        return torch.stack([of(t) for t in range(first, FRAMES)]).float()

    tensors = {"low_res_logits": outputs("pred_masks")[:, 0], "obj_ptr": outputs("obj_ptr")}
    tensors["object_score_logits"] = outputs("object_score_logits")[:, 0]
    return tensors | {"memory": outputs("maskmem_features")}


def stacked(objects):
    """Objects `[frames, ..]` as `[frames, objects, ..]`."""
    return {key: torch.stack([found[key] for found in objects], dim=1) for key in objects[0] if key != "memory"}


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(exist_ok=True)
    hydra.core.global_hydra.GlobalHydra.instance().clear()  # importing sam2 has set one up
    write_manifest(folder / "manifest_edgetam.json", network({}, {}))
    predictor = network(MINI, MINI_TRUNK)
    (folder / "manifest_edgetam_mini.json").write_text(json.dumps({"factors": FACTORS}))
    write_manifest(folder / "manifest_edgetam_mini.json", predictor)
    predictor.load_state_dict({name: parameter(name, tensor) for name, tensor in predictor.state_dict().items()})

    import sam2.sam2_video_predictor as module

    images = torch.stack([frame(t) for t in range(FRAMES)])
    module.load_video_frames = lambda **_: (images, SIZE, SIZE)
    sam2.utils.misc.get_connected_components = components
    kinds = (MASK, BOX, CLICKS)
    with torch.inference_mode():
        embedding = predictor.forward_image(images[:1])["backbone_fpn"][2]
        objects = [follow(predictor, kind) for kind in kinds]
        extra = {"embedding": embedding, "memory": objects[0]["memory"][:2]}
        videos = {"video": stacked(objects) | extra}
        videos["late"] = stacked([follow(predictor, CLICKS, first=1)])
        predictor.fill_hole_area = 8
        videos["stream"] = stacked(
            [follow(predictor, kind, correct_frame=CORRECTED_FRAME if kind == MASK else None) for kind in kinds]
        )
    for name, tensors in videos.items():
        save_file({key: tensor.contiguous().numpy() for key, tensor in tensors.items()}, folder / f"{name}.safetensors")
        print(name, {key: tuple(tensor.shape) for key, tensor in tensors.items()})
        print("object scores", tensors["object_score_logits"].flatten().tolist())
        print("share of the image in each mask", (tensors["low_res_logits"] > 0).float().mean(dim=(2, 3)).tolist())
        logits = tensors["low_res_logits"]
        print("objects' logits differ by at most", (logits - logits[:, :1]).abs().amax(dim=(2, 3)).tolist())
        print("filled pixels", (tensors["low_res_logits"] == 0.1).sum(dim=(2, 3)).tolist())


if __name__ == "__main__":
    main()
