"""Tests of the trainer on generated scenes; a few seconds."""

import csv
import itertools
import re
import shutil
import sys
import zipfile

import cv2
import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from splatseg_training import (
    affinities,
    agglomerate,
    augment,
    average,
    clutter,
    counters,
    dataset,
    evaluate,
    sensors,
    sheets,
    train,
)
from splatseg_training.export import export
from splatseg_training.network import AffinityNet, load

WIDTHS = (4, 4, 8, 8, 8)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenes")
    clutter.write(str(path), 6, seed=3)
    return path


def random_net(seed=0):
    """A small network whose batch norms have statistics of data."""
    torch.manual_seed(seed)
    net = AffinityNet(WIDTHS).train()
    with torch.no_grad():
        for _ in range(3):
            net(torch.randn(2, 8, 64, 96) * 2 + 1)
    return net.eval()


def test_targets_equal_a_naive_loop():
    ids = torch.from_numpy(np.random.default_rng(0).integers(0, 4, (2, 30, 40)))
    same, known = affinities.targets(ids)
    cases = itertools.product(range(2), enumerate(affinities.OFFSETS), range(30), range(0, 40, 3))
    for n, (i, (dy, dx)), y, x in cases:
        inside = 0 <= y + dy < 30 and 0 <= x + dx < 40
        a, b = ids[n, y, x], ids[n, y + dy, x + dx] if inside else 0
        assert known[n, i, y, x] == (a > 0 and b > 0)
        if known[n, i, y, x]:
            assert same[n, i, y, x] == (a == b)


def test_loss_ignores_unlabelled_pixels_and_falls_with_better_predictions():
    ids = torch.zeros(1, 40, 40, dtype=torch.long)
    ids[:, :, :15], ids[:, :, 15:30] = 1, 2
    depth = torch.ones(1, 40, 40)
    right = affinities.targets(ids)[0] * 8 - 4
    other = right.clone()
    other[:, 0, :, 31:] = 50
    assert affinities.loss(right, ids, depth) < 0.05 < affinities.loss(-right, ids, depth)
    assert affinities.loss(right, ids, depth) == affinities.loss(other, ids, depth)


def test_export_equals_the_network(tmp_path):
    net = random_net()
    torch.save(net.state_dict(), tmp_path / "weights.pt")
    export(str(tmp_path / "weights.pt"), str(tmp_path / "out.safetensors"), -1.0)
    tensors = load_file(tmp_path / "out.safetensors")
    x = torch.randn(1, 8, 64, 96)
    expected, actual = net(x), forward(tensors, x)
    assert (expected - actual).abs().max() < 0.01 * expected.abs().max()


def test_an_odd_size_is_not_stretched():
    """Away from the padding, a cut-off row and column move nothing."""
    net = random_net()
    net.pool = torch.nn.Identity()  # the mean of the whole image would change a little everywhere
    net.pool.forward = torch.zeros_like
    x = torch.randn(1, 8, 320, 352)
    whole, cut = net(x), net(x[:, :, :318, :350])
    assert cut.shape[2:] == (159, 175)
    difference = (whole[:, :, :159, :175] - cut).abs()
    assert difference[:, :, :40, :56].max() < 1e-4 * whole.abs().max() < difference.max()


def forward(tensors, x):
    """The exported network, computed as in the Rust program."""
    t = {name: tensor.float() for name, tensor in tensors.items()}

    def conv(x, name, stride=1, active=True):
        kernel = t[name + ".weight"].shape[-1]
        y = torch.nn.functional.conv2d(x, t[name + ".weight"], t[name + ".bias"], stride, kernel // 2)
        return torch.nn.functional.silu(y) if active else y

    levels = [conv(x, "stem", 2)]
    for stage in (1, 2, 3, 4):
        y = conv(levels[-1], f"e{stage}.0", 2)
        for block in range(1, 3 if stage > 1 else 2):
            y = y + conv(conv(y, f"e{stage}.{block}.a"), f"e{stage}.{block}.b")
        levels.append(y)
    y = levels[4] + conv(levels[4].mean((2, 3), keepdim=True), "pool")
    for level in (3, 2, 1, 0):
        up = conv(y, f"l{level + 1}", active=False)
        up = torch.nn.functional.interpolate(up, scale_factor=2, mode="bilinear", align_corners=False)
        y = levels[level] + up[:, :, : levels[level].shape[2], : levels[level].shape[3]]
        for block in range(1 if level > 1 else 2):
            y = conv(y, f"d{level}.{block}")
    return conv(y, "head", active=False)


def run(folder, out, steps, monkeypatch, stop=None):
    arguments = f"--data {folder} --out {out} --steps {steps} --seed 5 --batch 2 --height 64 --width 96 --workers 0"
    monkeypatch.setattr(sys, "argv", ["train", *arguments.split(), "--widths", *map(str, WIDTHS)])
    if stop is not None:
        update = train.Run.update

        def interrupted(self, *values):
            if self.step == stop:
                raise KeyboardInterrupt
            return update(self, *values)

        monkeypatch.setattr(train.Run, "update", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train.main()
        monkeypatch.setattr(train.Run, "update", update)
    train.main()
    with open(out / "losses.csv") as file:
        return [row["loss"] for row in csv.DictReader(file)]


def test_a_resumed_run_has_the_losses_of_an_unbroken_one(folder, tmp_path, monkeypatch):
    unbroken = run(folder, tmp_path / "a", 6, monkeypatch)
    assert len(unbroken) == 6
    assert unbroken == run(folder, tmp_path / "b", 6, monkeypatch, stop=3)
    assert load(tmp_path / "a" / "weights.pt")(torch.zeros(1, 8, 64, 96)).shape == (1, 12, 32, 48)


def test_samples_depend_on_their_seed_alone(folder):
    view = dataset.read_folder(str(folder))[0][1]
    for settings in (augment.Settings(), augment.Settings(height=240, width=320)):
        x, ids = augment.sample(view, settings, np.random.default_rng(7))
        again, _ = augment.sample(view, settings, np.random.default_rng(7))
        assert x.shape == (8, settings.height, settings.width) and ids.shape == (
            settings.height // 2,
            settings.width // 2,
        )
        assert (x == again).all() and np.isfinite(x).all()


def test_the_sensor_keeps_most_of_the_depth_near_its_value():
    z = np.full((120, 160), 1.5, np.float32)
    ids, camera = np.ones((120, 160), int), np.array([250, 250, 79.5, 59.5])
    shares = []
    for seed in range(30):
        out = sensors.measure(z, None, ids, camera, np.random.default_rng(seed))
        shares.append((out > 0).mean())
        assert np.abs(out[out > 0] - 1.5).mean() < 0.05
    assert np.median(shares) > 0.7


def test_scannets_archive_is_read(folder, tmp_path):
    (tmp_path / "depth").mkdir()
    (tmp_path / "intrinsic").mkdir()
    (tmp_path / "color").mkdir()
    depth = cv2.imread(str(folder / "depth" / "0.png"), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(tmp_path / "depth" / "0.png"), depth.repeat(2, 0).repeat(2, 1))
    cv2.imwrite(str(tmp_path / "color" / "0.jpg"), np.full((968, 1296, 3), (10, 120, 240), np.uint8))
    (tmp_path / "intrinsic" / "intrinsic_depth.txt").write_text("540 0 319.5 0\n0 540 239.5 0\n0 0 1 0\n0 0 0 1\n")
    with zipfile.ZipFile(tmp_path / "scene0000_00_2d-instance-filt.zip", "w") as archive:
        archive.write(folder / "instance-filt" / "0.png", "instance-filt/0.png")
    ((_, expected), *_), ((_, view),) = dataset.read_folder(str(folder)), dataset.read_folder(str(tmp_path))
    assert (view.depth == expected.depth).all() and (view.ids == expected.ids).all()
    assert np.allclose(view.camera, expected.camera)
    assert np.abs(view.colour[100, 100].astype(int) - (240, 120, 10)).max() < 5


def test_perfect_affinities_give_back_the_objects():
    ids = np.zeros((30, 40), int)
    ids[:, 20:], ids[10:20, 5:15] = 1, 2
    same, _ = affinities.targets(torch.from_numpy(ids + 1)[None])
    done = agglomerate.merges(same[0].numpy() * 8 - 4, -1.0)
    assert (agglomerate.segments(done, -1.0, ids.shape) == np.unique(ids, return_inverse=True)[1].reshape(30, 40)).all()
    doubled = ids.repeat(2, 0).repeat(2, 1) + 1
    iou, found, segments, objects = evaluate.score(doubled, evaluate.full_size(ids, doubled.shape))
    assert (found, segments, objects) == (3, 3, 3) and iou == pytest.approx(3)


def test_the_best_of_all_thresholds_fits_each_object_best(folder, tmp_path, capsys):
    truth = np.zeros((60, 80), int)
    truth[:, 40:60], truth[:, 60:] = 1, 2
    truth += 1
    halves, thirds = 1 + (truth > 1), np.where(truth > 2, 3, 1)
    assert evaluate.best_iou(truth, [halves]).tolist() == pytest.approx([1, 20 / 35, 15 / 35])
    assert evaluate.best_iou(truth, [halves, thirds]).tolist() == pytest.approx([1, 20 / 35, 1])
    assert evaluate.best_iou(truth, [np.zeros_like(truth)]).tolist() == [0, 0, 0]
    coloured = shutil.copytree(folder, tmp_path / "coloured")
    (coloured / "color").mkdir()
    for number in range(6):
        cv2.imwrite(str(coloured / "color" / f"{number}.png"), np.full((240, 320, 3), 100, np.uint8))
    evaluate.report_best(random_net(), [str(coloured)], (3.0, -6.0), every=3)
    assert re.search(r"2 frames  best of 2 thresholds  mean IoU [\d.]+  recall50 [\d.]+\n", capsys.readouterr().out)


def test_an_unlabelled_folder_is_named(tmp_path):
    (tmp_path / "intrinsic").mkdir()
    np.savetxt(tmp_path / "intrinsic" / "intrinsic_depth.txt", np.eye(4))
    with pytest.raises(ValueError, match=re.escape(str(tmp_path))):
        dataset.read_folder(str(tmp_path))


def test_sheets_lie_on_their_surface():
    shape, camera = (120, 160), np.array([140.0, 140, 79.5, 59.5])
    rows, columns = np.mgrid[:120, :160]
    z = (1 / (0.7 + 0.002 * (rows - 60) + 0.001 * (columns - 80))).astype(np.float32)
    ids = np.where(columns < 100, 1, 2)
    laid = 0
    for seed in range(40):
        depth, labels, papers = sheets.lay(z, ids, camera, np.random.default_rng(seed))
        laid += len(papers)
        changed = labels != ids
        assert (depth[~changed] == z[~changed]).all()
        assert (depth <= z).all() and (z - depth).max() < 0.06
        for paper in papers:
            assert (labels[paper.mask] == paper.id).all() and len(np.unique(ids[paper.mask])) <= 1
        image = sheets.printed(np.full((*shape, 3), 128, np.uint8), papers, np.random.default_rng(seed))
        assert (image[~changed] == 128).all()
    assert laid > 40


def test_a_worktop_lies_on_cupboards_and_is_a_thing_of_its_own():
    for seed in range(10):
        scene, _ = counters.counter_scene(np.random.default_rng(seed))
        boxes = {}
        for solid in scene.solids:
            boxes.setdefault(solid.id, []).append(solid.corners())
        worktop = np.concatenate(boxes[min(i for i in boxes if scene_is_worktop(boxes, i))])
        bottom = worktop[:, 2].min()
        tops = [np.concatenate(corners)[:, 2].max() for id, corners in boxes.items() if id > 3]
        assert any(abs(top - bottom) < 1e-6 for top in tops)


def scene_is_worktop(boxes, id):
    """The first thing after floor and walls."""
    corners = np.concatenate(boxes[id])
    return corners[:, 2].min() > 0.5 and np.ptp(corners[:, 2]) < 0.07


def test_averaged_weights_lie_between_those_of_two_runs(tmp_path):
    paths = [tmp_path / name for name in ("a.pt", "b.pt", "c.pt")]
    for seed, path in enumerate(paths[:2]):
        torch.save(random_net(seed).state_dict(), path)
    average.main([str(paths[0]), str(paths[1]), "--share", "0.25", "--out", str(paths[2])])
    a, b, c = (torch.load(path, weights_only=True) for path in paths)
    assert all(
        torch.allclose(c[name].float(), 0.75 * a[name].float() + 0.25 * b[name].float(), atol=1e-6)
        for name in a
        if a[name].is_floating_point()
    )
    x = torch.zeros(1, 8, 64, 96)
    assert load(paths[2])(x).shape == load(paths[0])(x).shape
    other = {name: tensor for name, tensor in a.items() if not name.startswith("head")}
    with pytest.raises(ValueError, match="same network"):
        average.average(a, other, 0.5)
