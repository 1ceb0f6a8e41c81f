"""Shared fixtures and helpers of the tests."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
import splatseg as ss

ROOM = "synthetic:frames=8,width=96,height=72,objects=6,noise=kinect"
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def room():
    """The frames of a small room."""
    return list(ss.open_scene(ROOM))


def step(pipeline, frame, **more):
    """Passes a frame to a pipeline."""
    arguments = {"K": frame.K, "camera_to_world": frame.camera_to_world, "name": frame.name, **more}
    return pipeline.step(frame.rgb, frame.depth, **arguments)


def command(*arguments):
    """Runs the command of the package."""
    return subprocess.run([sys.executable, "-m", "splatseg", *arguments], check=False, capture_output=True, text=True)


def wait_for(path):
    """Waits until a file exists."""
    deadline = time.monotonic() + 30
    while not path.exists():
        assert time.monotonic() < deadline, f"{path} does not appear"
        time.sleep(0.01)
