"""Recorded scenes, and scores."""

import json
import shutil
import warnings

import numpy as np
import pytest
import splatseg as ss
from conftest import ROOM, ROOT, command

RECORDING = ROOT / "crates/dataset/tests/data/mcap/room.mcap"


def test_frames_can_be_counted_indexed_and_iterated():
    scene = ss.open_scene(ROOM, stride=3)
    assert (len(scene), scene.format, scene.has_ground_truth) == (3, "synthetic", True)
    frames = list(scene)
    assert [frame.index for frame in frames] == [0, 3, 6]
    last = scene[-1]
    for found in (frames[2], scene[2]):
        np.testing.assert_array_equal(found.rgb, last.rgb)
        np.testing.assert_array_equal(found.camera_to_world, last.camera_to_world)
    assert last.rgb.shape == (72, 96, 3) and last.depth.dtype == np.float32 and last.K.shape == (3, 3)
    assert last.ground_truth.dtype == np.uint32 and last.ground_truth.max() > 0
    rotation = last.camera_to_world[:3, :3]
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-5)
    for index in (3, -4):
        with pytest.raises(IndexError):
            scene[index]


def test_settings_of_scenes():
    scene = ss.open_scene(ROOM, resize="48x36", crop_border=2, max_frames=2)
    assert len(scene) == 2 and scene[0].rgb.shape == (32, 44, 3)
    assert len(ss.open_scene(ROOM, **{"dataset.start": 6})) == 2
    for wrong, error, message in [
        ({"strid": 2}, TypeError, r"there is no setting dataset\.strid, did you mean dataset\.stride"),
        ({"stride": 0}, ValueError, "dataset.stride is 0"),
        ({"start": 99}, ValueError, "dataset.start is 99"),
    ]:
        with pytest.raises(error, match=message):
            ss.open_scene(ROOM, **wrong)
    with pytest.raises(ValueError, match="nowhere: does not exist"):
        ss.open_scene("nowhere")


def test_a_recording_of_a_robot():
    frames = list(ss.open_scene(RECORDING))
    assert len(frames) == 4 and frames[1].timestamp > frames[0].timestamp
    seg = ss.FastSamSplat(segmenter="graph")
    for f in frames:
        r = seg.step(f.rgb, f.depth, K=f.K, camera_to_world=f.camera_to_world, timestamp=f.timestamp)
    assert len(r.objects) > 1


def test_frames_that_cannot_be_used_are_left_out_with_a_warning(tmp_path):
    scene = tmp_path / "scene"
    shutil.copytree(ROOT / "crates/dataset/tests/data/folder/room", scene)
    colors = sorted((scene / "color").iterdir())
    colors[1].write_bytes(b"not a picture")
    with pytest.warns(UserWarning, match=colors[1].name):
        frames = list(ss.open_scene(scene))
    assert len(frames) == len(colors) - 1
    with warnings.catch_warnings(), pytest.raises(ValueError, match=colors[1].name):
        warnings.simplefilter("error")
        ss.open_scene(scene)[1]


def test_a_recording_without_poses_and_calibration(tmp_path):
    scene = tmp_path / "scene"
    shutil.copytree(ROOT / "crates/dataset/tests/data/folder/room", scene)
    (scene / "poses.txt").unlink()
    (scene / "camera.json").unlink()
    with pytest.raises(ValueError, match="the camera is not known"):
        ss.open_scene(scene)
    recording = ss.open_scene(scene, fx=144.5)
    assert not recording.has_poses and ss.open_scene(ROOM).has_poses
    assert [frame.camera_to_world for frame in recording] == [None] * 4
    np.testing.assert_array_equal(recording[0].K, [[144.5, 0, 79.5], [0, 144.5, 59.5], [0, 0, 1]])


def test_scores_are_those_of_the_command(tmp_path):
    out, scores = tmp_path / "out", tmp_path / "scores.json"
    assert command("run", ROOM, "--out", str(out), "--no-page").returncode == 0
    for protocol in ("paper", "strict"):
        flags = ["--protocol", protocol, "--json", str(scores), "--overwrite"]
        ended = command("eval", "--gt", ROOM, "--pred", str(out), *flags)
        assert ended.returncode == 0, ended.stderr
        expected = json.loads(scores.read_text())
        found = ss.evaluate(ROOM, out, protocol=protocol)
        assert (found.vsq, found.stq, found.aq, found.sq) == tuple(expected[key] for key in ("vsq", "stq", "aq", "sq"))
        assert {str(length): value for length, value in found.vsq_k.items()} == expected["vsq_k"]
        assert found.frames == 8
        vsq = "–" if found.vsq is None else f"{found.vsq:.1f}"
        assert repr(found) == f"<splatseg.Scores: VSQ {vsq}, STQ {found.stq:.1f}, 8 frames>"
    with pytest.raises(ValueError, match='expected "paper" or "strict"'):
        ss.evaluate(ROOM, out, protocol="exact")
    with pytest.raises(ValueError, match="without prediction.*; allow_missing=True scores them as empty"):
        ss.evaluate(ROOM.replace("frames=8", "frames=9"), out)
    assert (
        ss.evaluate(ROOM.replace("frames=8", "frames=9"), out, allow_missing=True).missing["missing_predictions"] == 1
    )
