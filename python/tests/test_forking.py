"""Processes that are started by fork."""

import os
import subprocess
import sys

import pytest
from conftest import ROOM, ROOT

RECORDED = str(ROOT / "crates/dataset/tests/data/folder/room")

PROGRAM = f"""
import multiprocessing
import splatseg as ss

seg, scene, segmenter = ss.FastSamSplat(segmenter="graph"), ss.open_scene({ROOM!r}), ss.Graph()
recorded = ss.open_scene({RECORDED!r})

def work():
    frame = scene[0]
    result = seg.step(frame.rgb, frame.depth, K=frame.K)
    assert len(result.objects) > 0 and segmenter(frame.rgb, frame.depth)[0].any()

def fails():
    calls = [
        lambda: scene[0],
        lambda: next(iter(scene)),
        lambda: ss.open_scene({ROOM!r}),
        lambda: ss.FastSamSplat(),
        lambda: seg.step(frame.rgb, frame.depth, K=frame.K),
        lambda: seg.objects(),
        lambda: next(seg.run([frame])),
        lambda: segmenter(frame.rgb, frame.depth),
        lambda: result.plot(),
        lambda: ss.Live(),
        lambda: ss.evaluate({ROOM!r}, "nowhere"),
    ]
    for number, call in enumerate(calls):
        try:
            call()
        except RuntimeError as error:
            assert "use the start method 'spawn'" in str(error), error
        else:
            raise AssertionError(number)
    repr(seg), seg.settings, repr(scene)
    # As workers do that load training data.
    assert len(list(recorded)) == len(recorded) and recorded[0].rgb.any()

def run(function):
    process = multiprocessing.get_context("fork").Process(target=function, daemon=True)
    process.start()
    process.join(30)
    assert process.exitcode == 0, process.exitcode

run(work)
frame = scene[0]
result = seg.step(frame.rgb, frame.depth, K=frame.K)
run(fails)
assert len(seg.step(frame.rgb, frame.depth, K=frame.K).objects) > 0
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_process_started_by_fork_works_or_says_why_not():
    ended = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False, timeout=60)
    assert ended.returncode == 0, ended.stderr
