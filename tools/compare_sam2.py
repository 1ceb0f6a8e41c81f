#!/usr/bin/env python3
"""Compares the speed of splatseg's SAM 2.1, EdgeTAM or EfficientTAM with the official PyTorch code, one after the other
on the same machine.

    pip install torch torchvision sam2        # in a virtual environment
    cargo build --profile dist --package xtask
    python tools/compare_sam2.py crates/models/tests/data/sam2 --size base_plus --objects 1 5 20
    PYTHONPATH=EdgeTAM python tools/compare_sam2.py crates/models/tests/data/edgetam --size edgetam --image-size 512

EdgeTAM is a clone of https://github.com/facebookresearch/EdgeTAM (and needs `pip install timm`). EfficientTAM is one of
https://github.com/yformer/EfficientTAM: --size efficienttam_s or efficienttam_ti, at 512 or 1024 pixels.

Weights are random, because speed does not depend on them. Both track the same number of objects, prompted with masks on
the first frame, until the memory is full (7 frames). The result is the minimum over the later frames, to reduce the
influence of other work on the machine. With fewer --frames, it is the time of the last frame, and the memory is not
full. Prints one line of JSON per number of objects. --device and --splatseg-device choose a GPU for either side;
--compile compiles the official code (torch.compile).
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

CONFIGS = {"tiny": "t", "small": "s", "base_plus": "b+", "large": "l"}


def official(arguments, objects):
    """Seconds per call of the official code, and its peak memory, in a separate process."""
    import torch

    torch.set_num_threads(arguments.threads)
    torch.manual_seed(0)
    side = arguments.image_size
    device = arguments.device
    if arguments.size.startswith("efficienttam"):
        predictor, module = official_efficienttam(arguments)
    else:
        predictor, module = official_sam2(arguments)
    predictor.fill_hole_area = 0
    wait = torch.cuda.synchronize if device.startswith("cuda") else lambda: None
    images = torch.randn(arguments.frames, 3, side, side, device=device)
    encoder = []
    with torch.inference_mode():
        for _ in range(3):
            started = time.perf_counter()
            predictor.forward_image(images[:1])
            wait()
            encoder.append(time.perf_counter() - started)
    tracked = []
    if objects:
        module.load_video_frames = lambda **_: (images, side, side)
        state = predictor.init_state(video_path="")
        for index in range(objects):
            mask = torch.zeros(side, side, dtype=torch.bool)
            left = index * side // (2 * objects)
            mask[: side // 2, left : left + side // 4] = True
            predictor.add_new_mask(state, 0, index, mask)
        started = time.perf_counter()
        for frame, _, _ in predictor.propagate_in_video(state):
            wait()
            now = time.perf_counter()
            if frame > 0:
                tracked.append(now - started)
            started = now
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    result = {"encoder_s": encoder, "tracked_frame_s": tracked, "peak_memory_mib": peak}
    if device.startswith("cuda"):
        result["peak_device_memory_mib"] = torch.cuda.max_memory_allocated() // 2**20
    print(json.dumps(result))


def official_efficienttam(arguments):
    """The official predictor of EfficientTAM, and its module. Without CUDA it takes no other size than a configuration's."""
    import efficient_track_anything.efficienttam_video_predictor as module
    from efficient_track_anything.build_efficienttam import build_efficienttam_video_predictor

    suffix = "" if arguments.image_size == 1024 else f"_{arguments.image_size}x{arguments.image_size}"
    config = f"configs/efficienttam/{arguments.size}{suffix}.yaml"
    predictor = build_efficienttam_video_predictor(config, ckpt_path=None, device=arguments.device)
    if arguments.compile:
        compile_parts(predictor)
    return predictor, module


def official_sam2(arguments):
    """The official predictor of SAM 2.1 or EdgeTAM, and its module."""
    import sam2.sam2_video_predictor as module
    from sam2.build_sam import build_sam2_video_predictor

    side = arguments.image_size
    overrides = [f"++model.image_size={side}"]
    config = "configs/edgetam.yaml"
    options = {}
    if arguments.size == "edgetam":
        import sam2.modeling.backbones.timm as backbone
        import timm

        backbone.create_model = lambda name, pretrained, **options: timm.create_model(name, pretrained=False, **options)
        overrides.append(f"++model.memory_attention.layer.cross_attention.q_sizes=[{side // 16},{side // 16}]")
    else:
        config = f"configs/sam2.1/sam2.1_hiera_{CONFIGS[arguments.size]}.yaml"
        options = {"vos_optimized": arguments.compile}
    predictor = build_sam2_video_predictor(
        config, ckpt_path=None, device=arguments.device, hydra_overrides_extra=overrides, **options
    )
    if arguments.size == "edgetam":
        let_several_objects_pass()
        if arguments.compile:
            compile_parts(predictor)
    return predictor, module


def let_several_objects_pass():
    """Mends a line of EdgeTAM's perceiver, which fails with more than one object: its tensor has no such view."""
    import inspect
    import textwrap

    import sam2.modeling.perceiver as module

    source = textwrap.dedent(inspect.getsource(module.PerceiverResampler.forward_2d))
    mended = source.replace(".view(-1, 1, C)", ".reshape(-1, 1, C)")
    if mended == source:
        raise SystemExit("EdgeTAM's perceiver has changed")
    exec(mended, vars(module))  # noqa: S102 (the official code with one word changed)
    module.PerceiverResampler.forward_2d = module.forward_2d


def compile_parts(predictor):
    """Compiles what `vos_optimized` compiles in SAM 2.1, which EdgeTAM's version lacks, and EfficientTAM's without CUDA."""
    import torch

    names = "image_encoder memory_encoder memory_attention spatial_perceiver sam_prompt_encoder sam_mask_decoder"
    for part in (getattr(predictor, name, None) for name in names.split()):
        if part is not None:
            part.forward = torch.compile(part.forward)


def last_json(command):
    out = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
    return json.loads(out.strip().splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("manifests", type=Path, help="folder of manifest_SIZE.json")
    parser.add_argument("--size", choices=[*CONFIGS, "edgetam", "efficienttam_s", "efficienttam_ti"], default="base_plus")
    parser.add_argument("--image-size", type=int, default=1024)
    parser.add_argument("--objects", type=int, nargs="+", default=[1, 5, 20])
    parser.add_argument("--frames", type=int, default=9)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--xtask", default="target/dist/xtask")
    parser.add_argument("--device", default="cpu", help="device of the official code, e.g. cuda")
    parser.add_argument("--splatseg-device", default="cpu", help="cpu, gpu, cuda, vulkan or metal")
    parser.add_argument("--compile", action="store_true", help="compile the official code")
    parser.add_argument("--official-only", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.official_only is not None:
        return official(arguments, arguments.official_only)
    for objects in arguments.objects:
        common = ["--size", arguments.size, "--image-size", str(arguments.image_size), "--frames", str(arguments.frames)]
        theirs = last_json(
            [sys.executable, __file__, str(arguments.manifests), *common, "--threads", str(arguments.threads)]
            + ["--device", arguments.device, *(["--compile"] if arguments.compile else [])]
            + ["--official-only", str(objects)]
        )
        ours = last_json(
            ["env", f"RAYON_NUM_THREADS={arguments.threads}", arguments.xtask, "sam2-speed"]
            + [str(arguments.manifests / f"manifest_{arguments.size}.json"), "--image-size", str(arguments.image_size)]
            + ["--objects", str(objects), "--frames", str(arguments.frames), "--device", arguments.splatseg_device]
        )
        row = {"size": arguments.size, "image_size": arguments.image_size, "objects": objects}
        for name, result in (("official", theirs), ("splatseg", ours)):
            row[f"{name}_encoder_s"] = round(min(result["encoder_s"]), 3)
            if result["tracked_frame_s"]:
                row[f"{name}_tracked_frame_s"] = round(min(result["tracked_frame_s"][min(6, arguments.frames - 2) :]), 3)
            row[f"{name}_peak_memory_mib"] = result["peak_memory_mib"]
        row["splatseg_memory_bank_mib"] = round(ours["memory_bank_mib"], 1)
        row["splatseg_moved_per_frame"] = ours["moved_per_frame"]
        row["official_peak_device_memory_mib"] = theirs.get("peak_device_memory_mib")
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
