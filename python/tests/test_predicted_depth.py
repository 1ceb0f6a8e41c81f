"""Depth predictors of Python."""

import numpy as np
import pytest
import splatseg as ss
from conftest import step


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
    with pytest.raises(ValueError, match="expected holes or all"):
        ss.FastSamSplat(depth_predictor=lambda rgb: rgb, predicted_depth="some")
    with pytest.raises(ValueError, match='output is "metres"'):
        ss.depth("nothing.pth", output="metres")
    with pytest.raises(ValueError, match="nothing.pth"):
        ss.depth("nothing.pth")
