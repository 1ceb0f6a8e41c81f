#!/usr/bin/env python3
"""Writes the official EfficientTAM code's results with weights given by a formula, for
`crates/models/tests/it/efficienttam.rs`.

    pip install torch torchvision sam2 timm safetensors        # in a virtual environment
    git clone https://github.com/facebookresearch/EdgeTAM; git clone https://github.com/yformer/EfficientTAM
    PYTHONPATH=EdgeTAM:EfficientTAM python tools/make_efficienttam_test_data.py crates/models/tests/data/efficienttam

As make_edgetam_test_data.py, for a miniature of EfficientTAM: with whole memories, and with both ways of pooling them.

    manifest_efficienttam_s.json, manifest_efficienttam_ti.json     names and shapes of the published networks' parameters
    manifest_efficienttam_mini.json                                 those of the miniature
    video.safetensors                                               three objects with whole memories, and the embedding
    stream.safetensors                                              the same, with a correction, and holes filled
    weighted.safetensors, shifted.safetensors                       with pooled memories (configurations _1 and _2)
"""

import json
import sys
from pathlib import Path

import efficient_track_anything.efficienttam_video_predictor as module
import efficient_track_anything.utils.misc
import hydra
import make_edgetam_test_data as edgetam
import torch
from hydra import compose, initialize_config_module
from hydra.utils import instantiate
from make_edgetam_test_data import BOX, CLICKS, MASK, MINI, SIDE, follow, parameter, stacked
from make_sam2_size_test_data import override
from make_sam2_test_data import CORRECTED_FRAME, FRAMES, SIZE, components, frame, write_manifest
from omegaconf import OmegaConf
from safetensors.numpy import save_file

SHARED = {
    name: value
    for name, value in MINI.items()
    if not name.startswith(("image_encoder", "spatial_perceiver")) and not name.endswith(("q_sizes", "k_sizes"))
}
MINI_OVERRIDES = SHARED | {
    "_target_": "efficient_track_anything.efficienttam_video_predictor.EfficientTAMVideoPredictor",
    "compile_image_encoder": "false",
    "image_encoder.trunk.embed_dim": 128,
    "image_encoder.trunk.depth": 3,
    "image_encoder.trunk.num_heads": 2,
    "image_encoder.trunk.window_block_indexes": "[0,1]",
    "image_encoder.neck.position_encoding.num_pos_feats": 64,
    "image_encoder.neck.d_model": 64,
    "image_encoder.neck.backbone_channel_list": "[128]",
    "memory_attention.layer.cross_attention.feat_sizes": f"[{SIDE},{SIDE}]",
}


# Objects are there in some frames, and absent in others. With four layers of attention, factors like EdgeTAM's would
# amplify the rounding of memories to bfloat16 from frame to frame.
CHANGED = {
    "pred_obj_score_head.layers.2.bias": 1.2,
    "cross_attn_image.q_proj.weight": 1,
    "cross_attn_image.k_proj.weight": 1,
    "cross_attn_image.v_proj.weight": 2,
    "cross_attn_image.out_proj.weight": 2,
}
FACTORS = [[part, CHANGED.get(part, factor)] for part, factor in edgetam.FACTORS]


def network(name, overrides):
    with initialize_config_module("efficient_track_anything", version_base=None):
        overrides = [override(*item) for item in overrides.items()]
        config = compose(f"configs/efficienttam/efficienttam_{name}.yaml", overrides=overrides)
    OmegaConf.resolve(config)
    return instantiate(config.model, _recursive_=True).eval()


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(exist_ok=True)
    edgetam.FACTORS = FACTORS
    hydra.core.global_hydra.GlobalHydra.instance().clear()  # importing the package has set one up
    for size in ("s", "ti"):
        write_manifest(folder / f"manifest_efficienttam_{size}.json", network(size, {"compile_image_encoder": "false"}))
    manifest = folder / "manifest_efficienttam_mini.json"
    manifest.write_text(json.dumps({"factors": FACTORS}))
    images = torch.stack([frame(t) for t in range(FRAMES)])
    module.load_video_frames = lambda **_: (images, SIZE, SIZE)
    efficient_track_anything.utils.misc.get_connected_components = components
    kinds = (MASK, BOX, CLICKS)
    videos = {}
    with torch.inference_mode():
        for config, name in (("s", "video"), ("s_1", "weighted"), ("s_2", "shifted")):
            predictor = network(config, MINI_OVERRIDES)
            write_manifest(manifest, predictor)
            state = predictor.state_dict()
            predictor.load_state_dict({name: parameter(name, tensor) for name, tensor in state.items()})
            videos[name] = stacked([follow(predictor, kind) for kind in kinds])
            if name == "video":
                videos[name]["embedding"] = predictor.forward_image(images[:1])["backbone_fpn"][0]
                predictor.fill_hole_area = 8
                corrected = [
                    follow(predictor, kind, correct_frame=CORRECTED_FRAME if kind == MASK else None) for kind in kinds
                ]
                videos["stream"] = stacked(corrected)
    for name, tensors in videos.items():
        save_file({key: tensor.contiguous().numpy() for key, tensor in tensors.items()}, folder / f"{name}.safetensors")
        print(name, {key: tuple(tensor.shape) for key, tensor in tensors.items()})
        logits = tensors["low_res_logits"]
        print("object scores", tensors["object_score_logits"].flatten().tolist())
        print("share of the image in each mask", (logits > 0).float().mean(dim=(2, 3)).tolist())
        print("objects' logits differ by at most", (logits - logits[:, :1]).abs().amax(dim=(2, 3)).tolist())
        print(
            "pooling changes logits by", (logits - videos["video"]["low_res_logits"]).abs().amax(dim=(1, 2, 3)).tolist()
        )
        print("filled pixels", (logits == 0.1).sum(dim=(2, 3)).tolist())


if __name__ == "__main__":
    main()
