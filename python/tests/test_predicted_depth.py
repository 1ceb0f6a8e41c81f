"""Depth predictors of Python."""

import numpy as np
import pytest
import splatseg as ss
from conftest import ROOT, step


def test_a_function_predicts_depth_in_place_of_the_sensors(room):
    frame = room[0]
    asked = []

    def predictor(rgb):
        asked.append(rgb.shape)
        return frame.depth * 1.5, np.ones(rgb.shape[:2])

    seg = ss.FastSamSplat(depth_predictor=predictor, predicted_depth="all")
    step(seg, frame)
    measured = ss.FastSamSplat()
    step(measured, frame)
    assert asked == [frame.rgb.shape]
    farthest = [
        np.linalg.norm(each.memory.means - frame.camera_to_world[:3, 3], axis=1).max() for each in (seg, measured)
    ]
    assert farthest[0] == pytest.approx(1.5 * farthest[1], rel=0.05)


def test_wrong_results_and_settings_are_told(room):
    frame = room[0]
    seg = ss.FastSamSplat(depth_predictor=lambda rgb: np.ones((3, 4)), predicted_depth="all")
    with pytest.raises(ValueError, match=r"depth predictor's result has shape \(3, 4\)"):
        step(seg, frame)
    ones, shape = np.ones(frame.depth.shape), frame.depth.shape
    for returned, use, message in [
        (-ones, "holes", "result contains -1, expected depth, 0 where nothing is predicted"),
        (ones * 1500, "all", "result has a median of 1500, expected metres"),
        ((ones, ones * 255), "holes", "confidence contains 255, expected 0 to 1"),
        ((ones, -ones), "all", "confidence contains -1, expected 0 to 1"),
    ]:
        seg = ss.FastSamSplat(depth_predictor=lambda rgb, returned=returned: returned, predicted_depth=use)
        with pytest.raises(ValueError, match=message):
            step(seg, frame)
    # Holes are filled with depth of any unit.
    step(ss.FastSamSplat(depth_predictor=lambda rgb: np.full(shape, 1500.0)), frame)
    settings = ss.FastSamSplat(depth_predictor=lambda rgb: rgb, predicted_depth="all").settings
    assert (settings["depth_predictor"], settings["predicted_depth"]) == ("python", "all")
    with pytest.raises(ValueError, match="expected holes or all"):
        ss.FastSamSplat(depth_predictor=lambda rgb: rgb, predicted_depth="some")
    with pytest.raises(ValueError, match='output is "metres"'):
        ss.depth("nothing.pth", output="metres")
    with pytest.raises(ValueError, match="nothing.pth"):
        ss.depth("nothing.pth")


def test_a_scene_without_depth_needs_a_predictor_of_all_depth():
    images = ROOT / "crates/splatseg-cli/demo/color"
    with pytest.warns(UserWarning, match="camera: not known.*fx=PIXELS"):
        scene = ss.open_scene(images, max_frames=2)
    guess = scene.guessed_camera
    assert guess["from"] < guess["fx"] < guess["to"] and not guess["estimated"]
    assert ss.open_scene(images, fx=289).guessed_camera is None
    assert not scene.has_depth and ss.open_scene(images.parent).has_depth

    def predictor(rgb):
        return np.full(rgb.shape[:2], 2.0)

    for settings in ({}, {"depth_predictor": predictor}):
        with pytest.raises(ValueError, match='without depth.*predicted_depth="all"'):
            ss.FastSamSplat(**settings).run(scene)
    seg = ss.FastSamSplat(depth_predictor=predictor, predicted_depth="all")
    results = list(seg.run(images, max_frames=2))
    assert len(results) == 2 and seg.memory.means.size > 0


def test_a_live_session_without_depth_needs_a_predictor():
    with pytest.raises(ValueError, match="--depth-weights"):
        ss.Live(dataset={"depth": "none"})


def test_a_live_session_has_the_segmenter_and_no_functions():
    with ss.Live(segmenter=ss.Graph(min_area=50)) as live:
        for timeout in (-1, float("nan"), 1e300):
            with pytest.raises(ValueError, match="timeout is .*, expected 0 to 1000000000 seconds"):
                live.messages(timeout)
        assert live.messages() == []
    with pytest.raises(ValueError, match="graph.min_area is -1"):
        ss.Live(segmenter="graph", graph={"min_area": -1})
    for functions in ({"segmenter": lambda rgb, depth: None}, {"depth_predictor": lambda rgb: None}):
        with pytest.raises(TypeError, match="a live session calls no functions"):
            ss.Live(**functions)
