#!/usr/bin/env python3
"""Computes Ultralytics' results for `crates/models/tests/data/fastsam`, for the tests of FastSAM.

    pip install ultralytics==8.4.190 safetensors        # in a virtual environment; torch for the CPU is enough
    python tools/make_fastsam_test_data.py crates/models/tests/data/fastsam

No trained weights are involved. `fastsam_mini_statedict.safetensors` is a narrow yolov8n-seg (width 0.125, depth 0.33,
one class) with random weights, float16; `image_310x230.png` and the head outputs in `postproc_*.safetensors` (`preds`,
`protos`) are made up, too. These files are inputs; the script does not make them. It

  writes    manifest_{s,x}.json: names and shapes of the parameters of FastSAM-s and FastSAM-x
  writes    forward.safetensors: input (every 4th row), raw output (float64, stored as float32: every 4th anchor; every 4th row and
            column of prototypes, mean and deviation of each) and detections of the image at 640
  compares  boxes, scores and masks in postproc_{a,b,c,d}.safetensors with Ultralytics' own post-processing
"""

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy
import torch
from PIL import Image
from safetensors.torch import load_file, save_file
from ultralytics.models.fastsam.predict import FastSAMPredictor
from ultralytics.nn.tasks import SegmentationModel, yaml_model_load

SIZE = 640


def architecture(scale, multiples=None):
    """Ultralytics' configuration of yolov8-seg with one class."""
    configuration = yaml_model_load(f"yolov8{scale}-seg.yaml")
    configuration["nc"] = 1
    if multiples:
        configuration["scales"] = {scale: multiples}
    return configuration


def write_manifest(path, scale):
    model = SegmentationModel(architecture(scale), nc=1, verbose=False)
    tensors = [[name, list(tensor.shape)] for name, tensor in model.state_dict().items()]
    manifest = json.loads(path.read_text()) if path.exists() else {"arch": f"yolov8{scale}-seg"}
    if manifest.get("tensors", tensors) != tensors:
        raise SystemExit(f"{path}: names or shapes differ")
    path.write_text(json.dumps(manifest | {"tensors": tensors}) + "\n")


def predictor(confidence, iou, retina_masks):
    overrides = {"conf": confidence, "iou": iou, "retina_masks": retina_masks, "max_det": 300, "imgsz": SIZE}
    return FastSAMPredictor(overrides=overrides | {"device": "cpu", "rect": True, "verbose": False, "save": False, "mode": "predict"})


def run_lengths(masks):
    """Lengths of row-major runs, alternately of zeros and ones, zeros first, and the offset of each mask's runs."""
    runs, offsets = [], [0]
    for mask in masks:
        flat = numpy.concatenate([[0], mask.reshape(-1).astype(numpy.int8), [2]])
        starts = numpy.flatnonzero(numpy.diff(flat))
        edges = numpy.concatenate([[0], starts[starts < mask.size], [mask.size]])
        runs.extend(numpy.diff(edges).tolist())
        offsets.append(len(runs))
    return torch.tensor(runs, dtype=torch.int32), torch.tensor(offsets, dtype=torch.int32)


def write_forward(folder):
    model = SegmentationModel(architecture("n", [0.33, 0.125, 1024]), nc=1, verbose=False)
    weights = load_file(folder / "fastsam_mini_statedict.safetensors")
    model.load_state_dict({name: tensor.float() if tensor.is_floating_point() else tensor for name, tensor in weights.items()})
    model.names = {0: "object"}
    model.eval()
    image = numpy.array(Image.open(folder / "image_310x230.png").convert("RGB"))
    run = predictor(0.4, 0.9, True)
    run.imgsz = [SIZE, SIZE]
    run.model = SimpleNamespace(pt=True, stride=32, format="pt", fp16=False, dynamic=False)
    run.device = torch.device("cpu")
    network_input = run.preprocess([numpy.ascontiguousarray(image[:, :, ::-1])])
    with torch.inference_mode():
        preds, protos = model.double()(network_input.double())[0]
    result = predictor(0.4, 0.9, True)
    result.setup_model(model.float(), verbose=False)
    [found] = result(folder / "image_310x230.png")
    masks = found.masks.data.numpy() > 0
    runs, offsets = run_lengths(masks)
    tensors = {
        "input_u8_rows_stride4": (network_input * 255).round().to(torch.uint8)[:, :, ::4],
        "preds_stride4": preds.float()[:, :, ::4],
        "protos_stride4": protos.float()[:, :, ::4, ::4],
        "protos_mean": protos.mean(dim=(0, 2, 3)).float(),
        "protos_std": protos.std(dim=(0, 2, 3), correction=0).float(),
        "det_xyxy": found.boxes.xyxy,
        "det_conf": found.boxes.conf,
        "det_mask_area": torch.from_numpy(masks.reshape(len(masks), -1).sum(axis=1).astype(numpy.int32)),
        "det_masks_rle": runs,
        "det_masks_rle_offsets": offsets,
        "det_masks_hw": torch.tensor(masks.shape[1:], dtype=torch.int32),
    }
    scores = found.boxes.conf.numpy()
    print(f"{len(scores)} detections, nearest score to the threshold {(preds[0, 4] - 0.4).abs().min():.1e}")
    print({name: tuple(tensor.shape) for name, tensor in tensors.items()})
    save_file({name: tensor.contiguous().clone() for name, tensor in tensors.items()}, folder / "forward.safetensors")


def compare_postprocessing(folder, letter, case):
    tensors = load_file(folder / f"postproc_{letter}.safetensors")
    width, height = case["orig_wh"]
    for run in case["runs"]:
        own = predictor(run["conf"], run["iou"], run["retina_masks"])
        own.model = SimpleNamespace(names={0: "object"}, end2end=False)
        own.batch = [["image"]]
        image = numpy.zeros((height, width, 3), numpy.uint8)
        network_input = torch.zeros(1, 3, *case["input_hw"])
        [found] = own.postprocess((tensors["preds"].clone(), tensors["protos"]), network_input, [image])

        def expected(name, prefix=run["prefix"]):
            return tensors[prefix + name]

        runs, offsets = run_lengths(found.masks.data.numpy() > 0)
        agrees = torch.equal(found.boxes.conf, expected("conf"))
        agrees &= torch.allclose(found.boxes.xyxy, expected("xyxy"), rtol=0, atol=1e-4)
        agrees &= torch.equal(runs, expected("masks_rle")) and torch.equal(offsets, expected("masks_rle_offsets"))
        print(f"postproc_{letter}, {run['prefix']} {len(found)} objects:", "agrees" if agrees else "DIFFERS")


def main():
    folder = Path(sys.argv[1])
    for scale in "sx":
        write_manifest(folder / f"manifest_{scale}.json", scale)
    write_forward(folder)
    for letter, case in json.loads((folder / "postproc.json").read_text()).items():
        compare_postprocessing(folder, letter, case)


if __name__ == "__main__":
    main()
