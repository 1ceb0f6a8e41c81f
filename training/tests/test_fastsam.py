"""Tests of FastSAM's trainer on painted boxes and with the data of the Rust program's tests."""

import csv
import json
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from splatseg_training.dataset import View
from splatseg_training.fastsam import boxes, evaluate, network, predict, train
from splatseg_training.fastsam.assignment import assign
from splatseg_training.fastsam.export import export
from splatseg_training.fastsam.losses import coverage, distance_loss, losses
from splatseg_training.fastsam.network import FastSam, Output, scaled
from splatseg_training.fastsam.samples import MAX_OBJECTS, Settings, objects, sample
from splatseg_training.optimiser import optimisers

REFERENCE = Path(__file__).parents[2] / "crates" / "models" / "tests" / "data" / "fastsam"
TINY = scaled(1 / 3, 0.0625)


def painted(seed, width=160, height=128):
    """An image [height, width, 3] of four rectangles, one per quarter, and its ids; the background is also an
    object."""
    rng = np.random.default_rng(seed)
    ids = np.ones((height, width), np.uint16)
    colours = rng.integers(0, 256, (6, 3)).astype(np.uint8)
    for k in range(4):
        w, h = rng.integers(width // 5, width // 2 - 8), rng.integers(height // 5, height // 2 - 8)
        x = k % 2 * width // 2 + rng.integers(0, width // 2 - w)
        y = k // 2 * height // 2 + rng.integers(0, height // 2 - h)
        ids[y : y + h, x : x + w] = k + 2
    return colours[ids], ids


def batch(images):
    """Images [N, 3, H, W] in [0, 1], ids and boxes."""
    truths = [objects(ids, 20) for _, ids in images]
    x = torch.from_numpy(np.stack([rgb for rgb, _ in images])).permute(0, 3, 1, 2).float() / 255
    return x, *(torch.from_numpy(np.stack(values)) for values in zip(*truths))


def _inside(truth, points):
    return ((points > truth[:, None, :2]) & (points < truth[:, None, 2:])).all(-1)


def near_output(ids, truth, certainty, error):
    """An `Output` for one image with up to 32 objects: scores and masks are right at a `certainty` of 1; boxes at an
    `error` of 0, the share by which they are too large.
    """
    points, strides = boxes.anchors(*ids.shape[1:])
    areas = torch.where(_inside(truth[0], points), boxes.area(truth[0])[:, None], torch.inf)
    box = truth[0, areas.argmin(0)]
    sides = torch.cat([points - box[:, :2], box[:, 2:] - points], 1) / strides[:, None]
    apart = ((1 + error) * sides.clamp(0, 15)[..., None] - torch.arange(network.BINS)).abs()
    distances = ((1 - apart).clamp(min=0) + 1e-4).log()[None]
    owner, quality = assign(torch.ones(1, len(points)), boxes.decoded(distances, points, strides), points, truth)
    scores = quality.logit(1e-4) * certainty
    coefficients = torch.nn.functional.one_hot(owner.clamp(min=0), 32).float()
    return Output(distances, scores, coefficients, certainty * coverage(ids, 32).logit(1e-4))


@pytest.mark.parametrize("size", network.SIZES)
def test_outputs_have_one_row_per_anchor(size):
    with torch.device("meta"):
        output = FastSam(scaled(*network.SIZES[size]))(torch.zeros(2, 3, 96, 64))
    count = 12 * 8 + 6 * 4 + 3 * 2
    assert output.distances.shape == (2, count, 4, 16) and output.scores.shape == (2, count)
    assert output.coefficients.shape == (2, count, 32) and output.prototypes.shape == (2, 32, 24, 16)


@pytest.mark.parametrize("size", "sx")
def test_tensors_are_those_of_the_published_models(size):
    expected = dict(json.loads((REFERENCE / f"manifest_{size}.json").read_text())["tensors"])
    with torch.device("meta"):
        state = FastSam(scaled(*network.SIZES[size])).state_dict()
    assert expected.pop("model.22.dfl.conv.weight") == [1, 16, 1, 1]
    assert {name: list(tensor.shape) for name, tensor in state.items()} == expected


def test_network_and_prediction_equal_the_reference():
    net = network.load(REFERENCE / "fastsam_mini_statedict.safetensors")
    expected = load_file(REFERENCE / "forward.safetensors")
    rgb = cv2.imread(str(REFERENCE / "image_310x230.png"))[:, :, ::-1].copy()
    padded, _ = predict.letterboxed(rgb, 640)
    x = torch.from_numpy(padded).permute(2, 0, 1)[None]
    assert (x[:, :, ::4] == expected["input_u8_rows_stride4"]).all()
    with torch.no_grad():
        output = net(x.float() / 255)
    found = boxes.decoded(output.distances, *boxes.anchors(*x.shape[2:]))
    centred = torch.cat([(found[..., :2] + found[..., 2:]) / 2, found[..., 2:] - found[..., :2]], -1)
    rows = torch.cat([centred, output.scores.sigmoid()[..., None], output.coefficients], -1).transpose(1, 2)
    assert torch.allclose(rows[:, :, ::4], expected["preds_stride4"], rtol=1e-4, atol=5e-3)
    assert torch.allclose(output.prototypes[:, :, ::4, ::4], expected["protos_stride4"], rtol=1e-4, atol=1e-3)
    objects = predict.predict(net, rgb, predict.Settings(640))
    assert np.allclose(objects.scores, expected["det_conf"], atol=1e-4)
    assert np.abs(objects.masks.sum((1, 2)) - expected["det_mask_area"].numpy()).max() <= 2


def test_anchors_go_to_the_object_they_fit_best():
    points = torch.tensor([[4.0, 4], [12, 4], [20, 4], [28, 4], [60, 60]])
    truth = torch.tensor([[[0.0, 0, 24, 8], [16, 0, 32, 8], [58, 58, 59, 59], [0, 0, 0, 0]]])
    predicted = torch.tensor([[[0.0, 0, 24, 8], [0, 0, 12, 8], [16, 0, 32, 8], [0, 0, 8, 8], [58, 58, 59, 59]]])
    scores = torch.tensor([[0.25, 1.0, 0.64, 0.5, 0.81]])
    owner, quality = assign(scores, predicted, points, truth)
    # Anchor 2 is inside two objects and fits the second one; anchor 3 is inside one that its box misses; anchor 4 is
    # outside of a box of one pixel, but within half a stride.
    assert owner.tolist() == [[0, 0, 1, 1, 2]]
    expected = [1, 1 / 0.25**0.5 * 0.5**6, 1, 0, 1]
    assert quality[0].tolist() == pytest.approx(expected, abs=1e-6)


def test_an_object_takes_its_best_anchors_alone():
    points, _ = boxes.anchors(64, 64)
    truth = torch.tensor([[[0.0, 0, 64, 64]]])
    scores = torch.linspace(0.1, 0.9, len(points))[None]
    owner, quality = assign(scores, truth.expand(1, len(points), 4), points, truth)
    assert (owner[0] == 0).nonzero()[:, 0].tolist() == list(range(len(points) - 10, len(points)))
    assert quality.max() == pytest.approx(1) and quality[0, -1] == quality.max()


def test_complete_iou_of_known_boxes():
    box = torch.tensor([0.0, 0, 4, 4])
    assert boxes.complete_iou(box, box) == pytest.approx(1)
    # Apart by 8 along x: no overlap; the enclosing box is 12 wide and 4 high.
    assert boxes.complete_iou(box, box + torch.tensor([8.0, 0, 8, 0])) == pytest.approx(-64 / 160)
    assert boxes.complete_iou(box, torch.tensor([0.0, 1, 4, 3])) < boxes.iou(box, torch.tensor([0.0, 1, 4, 3]))


def test_distance_loss_is_least_at_the_true_mixture_of_two_bins():
    points, strides = torch.tensor([[20.0, 20]]), torch.tensor([8.0])
    target = torch.tensor([[0.0, 20, 32, 28]])  # distances 2.5, 0, 1.5, 1
    logits = torch.full((1, 4, 16), -30.0)
    for side, bins in enumerate(([2, 3], [0], [1, 2], [1])):
        logits[0, side, bins] = 0
    assert distance_loss(logits, target, points, strides)[0] == pytest.approx(np.log(2) / 2, abs=1e-4)
    assert (boxes.decoded(logits[None], points, strides)[0] - target).abs().max() < 1e-3


def test_losses_fall_as_the_prediction_improves():
    _, ids, truth = batch([painted(1)])
    for name in ("score", "box", "distance", "mask"):
        values = []
        for right in (0.2, 0.6, 1.0):
            certainty, error = (right, 0.0) if name in ("score", "mask") else (1.0, (1 - right) / 4)
            values.append(losses(near_output(ids, truth, certainty, error), ids, truth)[name])
        assert values[0] > values[1] > values[2] >= 0, name


def test_losses_of_an_image_without_objects_are_finite():
    net = FastSam(TINY)
    ids, truth = torch.zeros(1, 64, 64, dtype=torch.uint8), torch.zeros(1, MAX_OBJECTS, 4)
    parts = losses(net(torch.rand(1, 3, 64, 64)), ids, truth)
    sum(parts.values()).backward()
    assert parts["box"] == parts["distance"] == parts["mask"] == 0 and parts["score"].isfinite()


def test_samples_depend_on_their_seed_alone_and_boxes_enclose_objects():
    rgb, ids = painted(3, width=320, height=240)
    camera = np.array([270.0, 270, 159.5, 119.5])
    depth = ids * np.uint16(100) + np.uint16(1000)
    for view in (View(rgb, depth, ids, camera), View(None, depth, ids, camera)):
        image, found, box = sample(view, Settings(), np.random.default_rng(7))
        again = sample(view, Settings(), np.random.default_rng(7))
        assert image.shape == (3, 256, 320) and (image == again[0]).all() and (found == again[1]).all()
        for k in range(found.max()):
            rows, columns = np.nonzero(found == k + 1)
            assert len(rows) >= 20
            assert box[k].tolist() == [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
        assert not box[found.max() :].any()


def test_colours_and_ids_move_together():
    rgb, ids = painted(4, width=320, height=240)
    view = View(rgb, np.ones_like(ids), ids, np.ones(4))
    settings = Settings(recolour=0, photograph=0, min_pixels=1)
    for seed in range(5):
        image, found, _ = sample(view, settings, np.random.default_rng(seed))
        for k in range(1, found.max() + 1):
            inner = cv2.erode((found == k).astype(np.uint8), np.ones((5, 5))) > 0
            assert not inner.any() or image[:, inner].std(1).max() < 1


def test_a_few_steps_learn_two_images_and_the_export_finds_the_same(tmp_path):
    torch.manual_seed(0)
    images = [painted(1), painted(2)]
    x, ids, truth = batch(images)
    net = FastSam(scaled(1 / 3, 0.125)).train()
    both = optimisers(net, network.OUTER)
    for step in range(120):
        for optimiser in both:
            for group in optimiser.param_groups:
                group["lr"] = 2e-3 * min(1, (step + 1) / 10, (120 - step) / 60) * group["scale"]
        loss = sum(losses(net(x), ids, truth).values())
        net.zero_grad()
        loss.backward()
        for optimiser in both:
            optimiser.step()
    settings = predict.Settings(160, 0.3, 0.7)
    for rgb, true_ids in images:
        found = predict.predict(net.eval(), rgb, settings)
        best = evaluate.mask_iou(found.masks, evaluate.truth(true_ids, 20)).max(0)
        assert best.mean() > 0.85, best
    torch.save(net.state_dict(), tmp_path / "weights.pt")
    export(str(tmp_path / "weights.pt"), str(tmp_path / "out.safetensors"))
    again = network.load(str(tmp_path / "out.safetensors"))
    with torch.no_grad():
        for one, other in zip(net(x), again(x)):
            assert (one - other).abs().max() < 0.02 * one.abs().max()


def write_folder(folder, count=2):
    """A labelled folder of painted boxes."""
    for name in ("color", "depth", "instance-filt", "intrinsic"):
        (folder / name).mkdir(parents=True)
    matrix = np.diag([270.0, 270, 1, 1])
    matrix[:2, 2] = 159.5, 119.5
    np.savetxt(folder / "intrinsic" / "intrinsic_depth.txt", matrix)
    for i in range(count):
        rgb, ids = painted(i, width=320, height=240)
        cv2.imwrite(str(folder / "color" / f"{i}.png"), rgb[:, :, ::-1])
        cv2.imwrite(str(folder / "depth" / f"{i}.png"), np.full(ids.shape, 1000, np.uint16))
        cv2.imwrite(str(folder / "instance-filt" / f"{i}.png"), ids)


def test_a_resumed_run_has_the_losses_of_an_unbroken_one(tmp_path, monkeypatch, capsys):
    write_folder(tmp_path / "scene")

    def run(out, steps, stop=None):
        arguments = f"--data {tmp_path}/scene --out {tmp_path / out} --steps {steps} --batch 2 --workers 0"
        arguments += f" --image-size 96 --device cpu --threads 1 --validate {tmp_path}/scene"
        monkeypatch.setattr(sys, "argv", ["train", *arguments.split()])
        with monkeypatch.context() as patch:
            if stop is not None:
                patch.setattr(train.Run, "progress", lambda self: 1 if self.step == stop else self.step / steps)
            train.main()
        with open(tmp_path / out / "losses.csv") as file:
            return [row["loss"] for row in csv.DictReader(file)]

    unbroken = run("a", 4)
    assert len(unbroken) == 4
    assert run("b", 4, stop=2) == unbroken[:2] and run("b", 4) == unbroken
    assert "2 views from 1 folders: mask mAP50" in capsys.readouterr().out


def random_masks(rng, count):
    masks = np.zeros((count, 40, 60), bool)
    for mask in masks:
        y, x = rng.integers(0, 30), rng.integers(0, 45)
        mask[y : y + rng.integers(5, 20), x : x + rng.integers(5, 30)] = True
    return masks


def test_average_precision_equals_cocos():
    mask_tools = pytest.importorskip("pycocotools.mask")
    from pycocotools.coco import COCO
    from pycocotools.cocoeval import COCOeval

    rng = np.random.default_rng(0)
    images, annotations, results = [], [], []
    for image in range(6):
        true = random_masks(rng, 6)
        shifted = np.roll(true, rng.integers(-3, 4), axis=2)
        found = np.concatenate([shifted[: rng.integers(2, 7)], random_masks(rng, 5)])
        order = np.argsort(-(scores := rng.random(len(found)).round(6)))
        images.append((predict.Objects(scores[order], found[order]), true))
        for masks, to in ((true, annotations), (found, results)):
            for k, mask in enumerate(masks):
                rle = mask_tools.encode(np.asfortranarray(mask.astype(np.uint8)))
                score = float(scores[k]) if to is results else 0.0
                area = float(mask.sum())
                to.append({"image_id": image, "category_id": 1, "segmentation": rle, "area": area, "score": score})
                to[-1] |= {"id": len(to), "iscrowd": 0, "bbox": [0, 0, 1, 1]}
    coco = COCO()
    coco.dataset = {
        "images": [{"id": i, "width": 60, "height": 40} for i in range(6)],
        "annotations": annotations,
        "categories": [{"id": 1, "name": "object"}],
    }
    coco.createIndex()
    detected = COCO()
    detected.dataset = coco.dataset | {"annotations": results}
    detected.createIndex()
    reference = COCOeval(coco, detected, "segm")
    reference.evaluate()
    reference.accumulate()
    reference.summarize()
    precision, _ = evaluate.average_precision(images)
    assert precision.mean() == pytest.approx(reference.stats[0], abs=1e-6)
    assert precision[0] == pytest.approx(reference.stats[1], abs=1e-6) and 0.1 < precision[0] < 0.9
