#!/usr/bin/env python3
"""Writes the official SAM 2.1 code's results at another image size than its checkpoint's, for `tests/it/sam2.rs`.

    pip install torch torchvision sam2 safetensors pillow        # in a virtual environment
    python tools/make_sam2_size_test_data.py ../shared/golden/sam2 crates/models/tests/data/sam2_mini_224.safetensors

The miniature model runs on 224×224 instead of 256×256: the embedding of the first frame, and low-resolution logits of
object 1, prompted by its mask on the first frame and tracked for two more.
"""

import sys
from pathlib import Path

import hydra
import numpy
import sam2  # noqa: F401
import torch
from hydra import compose, initialize_config_module
from hydra.utils import instantiate
from omegaconf import OmegaConf
from PIL import Image
from safetensors.numpy import load_file, save_file

SIZE = 224
HEAD = "model"
OVERRIDES = {
    "_target_": "sam2.sam2_video_predictor.SAM2VideoPredictor",
    "image_size": SIZE,
    "image_encoder.trunk.embed_dim": 16,
    "+image_encoder.trunk.stages": "[1,2,4,2]",
    "+image_encoder.trunk.global_att_blocks": "[4,6]",
    "+image_encoder.trunk.window_pos_embed_bkg_spatial_size": "[14,14]",
    "image_encoder.neck.position_encoding.num_pos_feats": 64,
    "image_encoder.neck.d_model": 64,
    "image_encoder.neck.backbone_channel_list": "[128,64,32,16]",
    "memory_attention.d_model": 64,
    "memory_attention.layer.dim_feedforward": 128,
    "memory_attention.layer.d_model": 64,
    "memory_attention.layer.self_attention.embedding_dim": 64,
    "memory_attention.layer.self_attention.feat_sizes": f"[{SIZE // 16},{SIZE // 16}]",
    "memory_attention.layer.cross_attention.embedding_dim": 64,
    "memory_attention.layer.cross_attention.feat_sizes": f"[{SIZE // 16},{SIZE // 16}]",
    "memory_attention.layer.cross_attention.kv_in_dim": 16,
    "memory_encoder.out_dim": 16,
    "+memory_encoder.in_dim": 64,
    "memory_encoder.position_encoding.num_pos_feats": 16,
    "+memory_encoder.mask_downsampler.embed_dim": 64,
    "memory_encoder.fuser.layer.dim": 64,
    "+binarize_mask_from_pts_for_mem_enc": "true",
    "+fill_hole_area": 0,
    "++sam_mask_decoder_extra_args.dynamic_multimask_via_stability": "true",
    "++sam_mask_decoder_extra_args.dynamic_multimask_stability_delta": 0.05,
    "++sam_mask_decoder_extra_args.dynamic_multimask_stability_thresh": 0.98,
}


def override(name: str, value) -> str:
    plus = name[: len(name) - len(name.lstrip("+"))]
    return f"{plus}{HEAD}.{name.lstrip('+')}={value}"


def main():
    golden, out = Path(sys.argv[1]), Path(sys.argv[2])
    hydra.core.global_hydra.GlobalHydra.instance().clear()  # importing sam2 has set one up
    with initialize_config_module("sam2", version_base=None):
        config = compose("configs/sam2.1/sam2.1_hiera_b+.yaml", overrides=[override(*item) for item in OVERRIDES.items()])
    OmegaConf.resolve(config)
    predictor = instantiate(config.model, _recursive_=True).eval()
    predictor.load_state_dict(torch.load(golden / "sam2_mini.pt", weights_only=True)["model"])
    mean = torch.tensor([0.485, 0.456, 0.406])[:, None, None]
    std = torch.tensor([0.229, 0.224, 0.225])[:, None, None]
    frames = [Image.open(golden / f"mini_video/{index:05}.png").convert("RGB") for index in range(3)]
    resized = [torch.from_numpy(numpy.array(frame.resize((SIZE, SIZE))) / 255.0).float().permute(2, 0, 1) for frame in frames]
    images = torch.stack([(image - mean) / std for image in resized])
    mask = torch.from_numpy(load_file(golden / "mini_preprocess.safetensors")["mask_video_u8"][0] > 0)

    import sam2.sam2_video_predictor as module

    module.load_video_frames = lambda **_: (images, frames[0].height, frames[0].width)
    with torch.inference_mode():
        embedding = predictor.forward_image(images[:1])["backbone_fpn"][2]
        state = predictor.init_state(video_path="")
        predictor.add_new_mask(state, 0, 1, mask)
        for _ in predictor.propagate_in_video(state):
            pass
        outputs = state["output_dict_per_obj"][0]
        frames = {**outputs["cond_frame_outputs"], **outputs["non_cond_frame_outputs"]}
        logits = torch.cat([frames[index]["pred_masks"] for index in range(3)])
        scores = torch.cat([frames[index]["object_score_logits"] for index in range(3)])
    tensors = {"embedding": embedding, "low_res_logits": logits[:, 0], "object_score_logits": scores[:, 0]}
    save_file({name: tensor.float().contiguous().numpy() for name, tensor in tensors.items()}, out)
    print({name: tuple(tensor.shape) for name, tensor in tensors.items()}, scores.flatten().tolist())


if __name__ == "__main__":
    main()
