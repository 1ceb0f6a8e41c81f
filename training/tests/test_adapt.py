"""Tests of the adaptation to unlabelled recordings, on handmade runs."""

import importlib.util
import json
import os
import shutil
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from splatseg_training import adapt, affinities, augment, average, clutter, dataset, loader, sensors, train
from splatseg_training.consensus import Consensus, Rules
from splatseg_training.export import export, folded
from splatseg_training.network import AffinityNet, load, restore_norms

WIDTHS = (4, 4, 8, 8, 8)
SHAPE = (60, 80)


def two_halves():
    """Ids 7 on the left and 9 on the right."""
    ids = np.full(SHAPE, 7, np.uint16)
    ids[:, 40:] = 9
    return ids


def write_run(folder, frames):
    (folder / "segments").mkdir(parents=True)
    for number, ids in enumerate(frames):
        cv2.imwrite(str(folder / "segments" / f"{number:06}.png"), ids)
    return str(folder)


def consensus(tmp_path, one, two, **rules):
    return Consensus(write_run(tmp_path / "one", one), write_run(tmp_path / "two", two), Rules(**rules))


def test_ids_that_agree_in_all_frames_are_labels_away_from_their_border(tmp_path):
    two = [two_halves() for _ in range(10)]
    labels = consensus(tmp_path, two, two, margin=2).labels("000003")
    assert (labels[:, :38] == 7).all() and (labels[:, 42:] == 9).all() and (labels[:, 38:42] == 0).all()


def test_the_ids_of_the_passes_are_matched_by_their_pixels(tmp_path):
    one = two_halves()
    one[one == 9] = 3
    one[30:, :40] = 4  # pass one took the left half for two things
    labels = consensus(tmp_path, [one] * 10, [two_halves()] * 10, margin=1, border=1).labels("000000")
    assert (labels[:, :39] == 7).all() and (labels[:, 41:] == 9).all()


def test_pixels_on_which_the_passes_disagree_are_left_out_with_a_margin(tmp_path):
    other = two_halves()
    other[20:30, 10:20] = 9
    labels = consensus(tmp_path, [other] + [two_halves()] * 9, [two_halves()] * 10, margin=2).labels("000000")
    assert (labels[18:32, 8:22] == 0).all() and (labels[:18, :38] == 7).all() and (labels[:, 22:38] == 7).all()


def test_an_object_of_few_frames_is_no_label(tmp_path):
    rare = two_halves()
    rare[10:20, 50:70] = 11
    frames = [rare] * 3 + [two_halves()] * 9
    labels = consensus(tmp_path, frames, frames, min_frames=4).labels("000000")
    assert set(np.unique(labels)) == {0, 7, 9} and (labels[10:20, 50:70] == 0).all()
    assert 11 in consensus(tmp_path / "again", frames, frames, min_frames=3).labels("000000")


def test_a_frame_counts_for_an_object_only_if_most_of_it_is_agreed_on(tmp_path):
    wrong = two_halves()
    wrong[:50, 40:] = 7
    one, two = [two_halves()] * 6 + [wrong] * 5, [two_halves()] * 11
    assert not consensus(tmp_path, one, two, min_frames=7).kept[9]
    assert consensus(tmp_path / "again", one, two, min_frames=6).kept[9]


def test_frames_with_few_labels_or_one_object_are_left_out(tmp_path):
    empty, single = np.zeros(SHAPE, np.uint16), np.full(SHAPE, 7, np.uint16)
    frames = [two_halves()] * 10 + [empty, single]
    made = consensus(tmp_path, frames, frames)
    assert made.labels("000009") is not None and made.labels("000010") is None and made.labels("000011") is None


def test_a_folder_that_is_no_run_and_an_image_without_ids_are_named(tmp_path):
    with pytest.raises(ValueError, match="no id images"):
        Consensus(str(tmp_path / "none"), str(tmp_path / "none"), Rules())
    with pytest.raises(ValueError, match="000000.png"):
        consensus(tmp_path, [np.zeros((4, 4, 3), np.uint8)], [np.zeros((4, 4, 3), np.uint8)])


def test_labels_become_a_folder_that_training_reads(tmp_path, monkeypatch):
    made = consensus(tmp_path, [two_halves()] * 10, [two_halves()] * 10)
    (tmp_path / "two" / "summary.json").write_text(json.dumps({"settings": {"dataset": {"stride": 2}}}))
    colour = np.zeros((*SHAPE, 3), np.uint8)
    colour[..., 0] = 200
    depth, K = np.full(SHAPE, 1.5, np.float32), np.array([[70.0, 0, 39.5], [0, 70, 29.5], [0, 0, 1]])
    frames = [SimpleNamespace(name=str(i), rgb=colour, depth=depth, K=K) for i in range(12)]
    asked = []
    scene = SimpleNamespace(open_scene=lambda path, **settings: asked.append((path, settings)) or frames)
    monkeypatch.setattr(adapt, "package", lambda: scene)
    adapt.write_labels("recording", made, str(tmp_path / "labelled"))
    views = dataset.read_folder(str(tmp_path / "labelled"))
    assert asked == [("recording", {"stride": 2})] and len(views) == 10
    view = views[0][1]
    assert (view.colour == (200, 0, 0)).all() and (view.depth == 1500).all()
    assert set(np.unique(view.ids)) == {0, 7, 9} and np.allclose(view.camera, (280, 280, 159.5, 119.5))


def test_wide_and_tall_frames_are_cut_to_the_middle():
    camera = np.array([[500.0, 0, 319.5], [0, 500, 179.5], [0, 0, 1]])
    window, moved = adapt.middle((360, 640), camera)
    assert window == (slice(0, 360), slice(80, 560)) and moved[0, 2] == 239.5 and moved[1, 2] == 179.5
    window, moved = adapt.middle((640, 360), camera)
    assert window == (slice(185, 455), slice(0, 360)) and moved[1, 2] == -5.5


def test_measured_views_are_half_of_the_samples_and_get_no_sensor():
    view = dataset.View(None, np.full((240, 320), 1000, np.uint16), np.ones((240, 320), np.int32), np.ones(4))
    real = view._replace(depth=np.full((240, 320), 2000, np.uint16))
    seen = []

    def sample(view, settings, rng):
        seen.append((view, settings))
        return view.ids, view.ids

    samples = loader.Samples([[view]], sample, augment.Settings(), 1, [[real], [real]])
    for number in range(400):
        samples[number]
    measured = [settings for chosen, settings in seen if chosen is real]
    assert 160 < len(measured) < 240
    assert all(settings.sensor == 0 and settings.recolour == 0 for settings in measured)
    assert all(settings == augment.Settings() for chosen, settings in seen if chosen is view)


def test_without_the_sensor_depth_is_not_touched(tmp_path, monkeypatch):
    clutter.write(str(tmp_path), 1, seed=3)
    view = dataset.read_folder(str(tmp_path))[0][1]
    monkeypatch.setattr(sensors, "measure", lambda *_: pytest.fail("a sensor's noise on measured depth"))
    for number in range(5):
        augment.sample(view, augment.Settings(sensor=0.0), np.random.default_rng(number))


def random_weights(path):
    """A small network whose batch norms have statistics of data."""
    torch.manual_seed(0)
    net = AffinityNet(WIDTHS).train()
    with torch.no_grad():
        for _ in range(3):
            net(torch.randn(2, 8, 64, 96) * 2 + 1)
    torch.save(net.state_dict(), path)
    return net.eval()


def test_exported_weights_are_read_back(tmp_path):
    net = random_weights(tmp_path / "weights.pt")
    export(str(tmp_path / "weights.pt"), str(tmp_path / "out.safetensors"), -1.0)
    again, x = load(str(tmp_path / "out.safetensors")), torch.randn(1, 8, 64, 96)
    with torch.no_grad():
        expected, actual = net(x), again(x)
    assert (expected - actual).abs().max() < 0.01 * expected.abs().max()
    for name, tensor in folded(again).items():
        assert torch.allclose(tensor.float(), load_file(tmp_path / "out.safetensors")[name].float(), atol=1e-4), name


def test_the_shipped_weights_are_read():
    if not os.path.exists(adapt.SHIPPED):
        pytest.skip(f"no {adapt.SHIPPED}")
    with torch.no_grad():
        assert load(adapt.SHIPPED)(torch.zeros(1, 8, 64, 96)).isfinite().all()


def test_frozen_norms_keep_their_statistics(tmp_path):
    random_weights(tmp_path / "weights.pt")
    export(str(tmp_path / "weights.pt"), str(tmp_path / "start.safetensors"), -1.0)
    start = str(tmp_path / "start.safetensors")
    clutter.write(str(tmp_path / "data"), 2, seed=3)
    fixed = ["--steps", "2", "--batch", "2", "--workers", "0", "--height", "64", "--width", "96"]
    data = ["--data", str(tmp_path / "data"), "--measured", str(tmp_path / "data"), "--out", str(tmp_path / "run")]
    train.main([*data, *fixed, "--start", start, "--freeze-norms", "--widths", *map(str, WIDTHS)])
    before, after = load(start).state_dict(), load(str(tmp_path / "run" / "weights.pt")).state_dict()
    assert all(torch.allclose(before[name], after[name]) for name in before if "running" in name)
    assert not torch.equal(before["e2.1.a.0.weight"], after["e2.1.a.0.weight"])


def test_restored_norms_change_no_output_and_have_the_statistics_of_their_inputs(tmp_path):
    random_weights(tmp_path / "weights.pt")
    export(str(tmp_path / "weights.pt"), str(tmp_path / "start.safetensors"), -1.0)
    net, x = load(str(tmp_path / "start.safetensors")), torch.randn(8, 8, 64, 96) * 2 + 1
    with torch.no_grad():
        expected = net(x)
        restore_norms(net, x)
        assert (net(x) - expected).abs().max() < 1e-3 * expected.abs().max()
        # What the norms make of their inputs in training is what they make of them afterwards.
        assert (net.train()(x) - expected).abs().max() < 0.01 * expected.abs().max()


def test_exported_files_are_averaged(tmp_path):
    for name in ("a", "b"):
        random_weights(tmp_path / f"{name}.pt")
        export(str(tmp_path / f"{name}.pt"), str(tmp_path / f"{name}.safetensors"), -1.0)
    paths = [str(tmp_path / f"{name}.safetensors") for name in ("a", "b", "mean")]
    average.main([*paths[:2], "--out", paths[2]])
    first, second, mean = map(load_file, paths)
    for name, tensor in mean.items():
        assert torch.allclose(tensor.float(), (first[name].float() + second[name].float()) / 2, atol=2e-3), name
    assert torch.isfinite(load(paths[2])(torch.zeros(1, 8, 64, 96))).all()
    with pytest.raises(SystemExit):
        average.main([paths[0], str(tmp_path / "b.pt"), "--out", paths[2]])


def test_a_teacher_sees_exact_depth_and_turned_samples_have_none(tmp_path):
    clutter.write(str(tmp_path), 1, seed=3)
    [(_, view)] = dataset.read_folder(str(tmp_path))
    settings = augment.Settings(height=64, width=96, sensor=0.0, turn=0.0)
    x, _, exact = augment.sample_with_exact(view, settings, np.random.default_rng(4))
    assert np.array_equal(x, exact) and x.any()
    noisy, _, still_exact = augment.sample_with_exact(view, settings._replace(sensor=1.0), np.random.default_rng(5))
    assert not np.array_equal(noisy, still_exact)
    assert not augment.sample_with_exact(view, settings._replace(turn=1.0), np.random.default_rng(4))[2].any()


def test_a_network_that_says_what_its_teacher_says_does_not_disagree():
    logits = torch.randn(2, 12, 40, 50)
    assert affinities.divergence(logits, logits).abs() < 1e-6
    assert affinities.divergence(logits + 1, logits) > 0.05


def options(tmp_path, *extra):
    made = adapt.parse(["--recordings", "a", "--replay", "b", "--out", str(tmp_path / "out"), *extra])
    made.run_options = []
    return made


def test_a_folder_of_something_else_or_of_another_command_is_left_alone(tmp_path):
    adapt.claim(options(tmp_path))
    adapt.claim(options(tmp_path, "--threads", "7"))
    with pytest.raises(ValueError, match="steps"):
        adapt.claim(options(tmp_path, "--steps", "7"))
    (tmp_path / "out" / "options.json").rename(tmp_path / "out" / "mine.txt")
    with pytest.raises(ValueError, match="contains other files"):
        adapt.claim(options(tmp_path))


def test_a_missing_program_and_missing_weights_are_named(tmp_path):
    with pytest.raises(SystemExit, match="nowhere"):
        adapt.main(["--recordings", "a", "--replay", "b", "--out", str(tmp_path / "out"), "--splatseg", "nowhere"])
    assert not (tmp_path / "out").exists()
    with pytest.raises(ValueError, match="lost.pt"):
        adapt.starting_weights(options(tmp_path, "--start", "lost.pt"))


def test_the_command_adapts_a_synthetic_recording_and_starts_again_for_nothing(tmp_path, capsys):
    program = os.environ.get("SPLATSEG", "splatseg")
    if shutil.which(program) is None or importlib.util.find_spec("splatseg") is None:
        pytest.skip("needs the program splatseg (or SPLATSEG=PROGRAM) and its Python package")
    clutter.write(str(tmp_path / "replay"), 2, seed=3)
    out = tmp_path / "out"
    command = ["--recordings", "synthetic:frames=14,width=160,height=120", "--replay", str(tmp_path / "replay")]
    command += ["--out", str(out), "--splatseg", program, "--steps", "2", "--threads", "1", "--min-frames", "3"]
    adapt.main([*command, "--", "--threads", "1"])
    assert "of 14 frames" in capsys.readouterr().out
    assert load(str(out / "affinity.safetensors"))(torch.zeros(1, 8, 64, 96)).isfinite().all()
    adapt.main([*command, "--", "--threads", "1"])
    assert "already exists" in capsys.readouterr().out
