"""Whole scenes: ``Pipeline.run`` and ``splatseg.run``."""

import json
import os
import shutil
import signal
import subprocess
import sys
import warnings

import numpy as np
import pytest
import splatseg as ss
from conftest import ROOM, ROOT, command, step, wait_for


def test_a_pipeline_runs_over_a_scene(room):
    by_hand, over_scene = ss.FastSamSplat(segmenter="graph"), ss.FastSamSplat(segmenter="graph")
    expected = [step(by_hand, frame) for frame in room[::2]]
    # A path with settings, an opened scene, and other frames.
    for source, settings in [(ROOM, {"stride": 2}), (ss.open_scene(ROOM, stride=2), {}), (iter(room[::2]), {})]:
        over_scene = ss.FastSamSplat(segmenter="graph")
        found = list(over_scene.run(source, **settings))
        assert [result.name for result in found] == [frame.name for frame in room[::2]]
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_array_equal(one.ids, other.ids)


def test_a_source_that_cannot_be_run_is_told_at_once(room):
    pipeline = ss.FastSamSplat(segmenter="graph")
    with pytest.raises(ValueError, match="nowhere: does not exist"):
        pipeline.run("nowhere")
    with pytest.raises(TypeError, match="stride: settings are for a source that is opened here"):
        pipeline.run(room, stride=2)
    with pytest.raises(TypeError, match=r"dataset\.strid, did you mean"):
        pipeline.run(ROOM, strid=2)


def test_a_path_is_opened_with_the_settings_of_the_pipeline(tmp_path, room):
    pipeline = ss.FastSamSplat(segmenter="graph", dataset={"stride": 3, "resize": "48x36"})
    found = list(pipeline.run(ROOM))
    assert [result.name for result in found] == [frame.name for frame in room[::3]]
    assert found[0].ids.shape == (36, 48)
    for settings in [{"stride": 4}, {"dataset.stride": 4}]:
        assert len(list(pipeline.run(ROOM, **settings))) == 2
    # The settings of an earlier run.
    ss.run(ROOM, tmp_path / "out", segmenter="graph", page=False, dataset={"max_frames": 2})
    again = ss.FastSamSplat(config=tmp_path / "out/summary.json")
    assert len(list(again.run(ROOM))) == 2


def test_poses_of_a_path_are_converted_once(tmp_path):
    scene = tmp_path / "scene"
    shutil.copytree(ROOT / "crates/dataset/tests/data/folder/room", scene)
    settings = {"pose_convention": "opengl", "pose_scale": 0.5}
    expected = [frame.camera_to_world for frame in ss.open_scene(scene, **settings)]
    pipeline = ss.FastSamSplat(segmenter="graph", dataset=settings)
    plain = ss.FastSamSplat(segmenter="graph")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for results in [pipeline.run(scene), plain.run(scene, **settings)]:
            for result, pose in zip(results, expected, strict=True):
                np.testing.assert_allclose(result.camera_to_world, pose, atol=1e-6)
    with pytest.raises(TypeError, match="pose_scale: the pipeline has dataset.pose_scale already"):
        pipeline.run(scene, pose_scale=0.5)


def test_with_strict_input_a_frame_that_cannot_be_used_ends_a_run(tmp_path):
    scene = tmp_path / "scene"
    shutil.copytree(ROOT / "crates/dataset/tests/data/folder/room", scene)
    sorted((scene / "color").iterdir())[1].write_bytes(b"not a picture")
    with pytest.warns(UserWarning, match="frame skipped"):
        assert len(list(ss.FastSamSplat(segmenter="graph").run(scene))) == 3
    for source in [scene, ss.open_scene(scene)]:
        results = ss.FastSamSplat(segmenter="graph", strict_input=True).run(source)
        next(results)
        with pytest.raises(ValueError, match="strict_input ends the run"):
            list(results)


def test_a_run_shows_its_progress_if_it_can(room, monkeypatch, capsys):
    pipeline = ss.FastSamSplat(segmenter="graph")
    # Standard error is no terminal here.
    assert len(list(pipeline.run(room[:2]))) == 2
    assert capsys.readouterr().err == ""
    pytest.importorskip("tqdm")
    assert len(list(pipeline.run(room[:2], progress=True))) == 2
    assert "2/2" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "tqdm", None)
    monkeypatch.delitem(sys.modules, "tqdm.auto", raising=False)
    assert len(list(pipeline.run(room[:2]))) == 2
    with pytest.raises(ImportError, match=r"progress=True needs tqdm: pip install tqdm"):
        pipeline.run(room, progress=True)


def test_results_in_a_folder_are_those_of_the_command(tmp_path, capfd):
    one, other = tmp_path / "one", tmp_path / "other"
    flags = ["--seed=3", "--set=memory.max_votes=8", "--set=dataset.stride=2", "--segmenter=graph"]
    assert command("run", ROOM, "--out", str(one), *flags).returncode == 0
    settings = {"memory": {"max_votes": 8}, "dataset": {"stride": 2}}
    run = ss.run(ROOM, other, segmenter=ss.Graph(), seed=3, save_memory=tmp_path / "map.ply", **settings)
    assert "format synthetic" in capfd.readouterr().err
    names = sorted(path.name for path in (one / "segments").iterdir())
    assert len(names) == 4
    for name in names:
        assert (one / "segments" / name).read_bytes() == (other / "segments" / name).read_bytes()
    assert (run.out, run.page, run.summary["frames"]) == (other, other / "index.html", 4)
    listed = json.loads((one / "objects.json").read_text())["objects"]
    assert [entry.id for entry in run.objects()] == [entry["id"] for entry in listed]
    assert len(ss.FastSamSplat.load(tmp_path / "map.ply").objects()) >= 3
    assert repr(run) == f"<splatseg.Run {str(other)!r}: 4 frames>"


def test_a_run_that_is_not_possible_raises(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "file").write_text("")
    for source, target, more, message in [
        ("nowhere", tmp_path / "new", {}, "nowhere: does not exist"),
        (ROOM, out, {}, "folder is not empty: choose another out, or pass overwrite=True"),
        (ROOM, tmp_path / "new", {"sed": 3}, "there is no setting sed"),
    ]:
        with pytest.raises(ValueError, match=message):
            ss.run(source, target, **more)
    with pytest.raises(TypeError, match="segmenter is a function"):
        ss.run(ROOM, tmp_path / "new", segmenter=lambda rgb, depth: None)
    with pytest.raises(TypeError, match="depth_predictor is a function"):
        ss.run(ROOM, tmp_path / "new", depth_predictor=lambda rgb: None)

    class Own(ss.Graph):
        def __call__(self, *frame, **more):
            return super().__call__(*frame, **more)

    with pytest.raises(TypeError, match="segmenter is of type Own, which has its own __call__"):
        ss.run(ROOM, tmp_path / "new", segmenter=Own())


def test_a_run_has_the_settings_of_its_segmenter_and_the_keywords(tmp_path):
    run = ss.run(ROOM, tmp_path / "out", segmenter=ss.Graph(min_area=50), graph={"max_pixels": 70_000}, page=np.False_)
    assert run.page is None
    graph = run.summary["settings"]["graph"]
    assert (graph["min_area"], graph["max_pixels"]) == (50, 70_000)


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_a_run_and_keeps_what_is_done(tmp_path):
    out = tmp_path / "out"
    scene = ROOM.replace("frames=8", "frames=4000")
    # A shell makes background processes ignore SIGINT, and their children inherit it.
    program = f"""
import signal
import splatseg as ss

signal.signal(signal.SIGINT, signal.default_int_handler)
ss.run({scene!r}, {str(out)!r}, segmenter="graph")
"""
    arguments = [sys.executable, "-c", program]
    process = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True, start_new_session=True)
    wait_for(out / "segments/frame-000002.png")
    # As a terminal does: to all processes of the group.
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert process.returncode != 0 and "KeyboardInterrupt" in errors, errors
    assert (out / "summary.json").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
@pytest.mark.parametrize("error", ["KeyboardInterrupt", "TimeoutError"])
def test_an_exception_ends_the_process_of_a_run(tmp_path, error):
    out = tmp_path / "out"
    scene = ROOM.replace("frames=8", "frames=4000")
    program = f"""
import signal
import splatseg as ss

def fail(*_):
    raise {error}

signal.signal(signal.SIGINT, fail)
ss.run({scene!r}, {str(out)!r}, segmenter="graph")
"""
    process = subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE, text=True)
    wait_for(out / "segments/frame-000002.png")
    # As a notebook or a supervisor does: to this process alone.
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert process.returncode != 0 and error in errors, errors
    # The command has ended before the exception goes on.
    summary = json.loads((out / "summary.json").read_text())
    assert 3 <= summary["frames"] < 4000
