"""Tests of the package's command."""

import signal
import subprocess
import sys

import pytest
import splatseg as ss
from conftest import ROOM, command, wait_for


def test_it_is_the_command():
    ended = command("--version")
    assert (ended.returncode, ended.stdout) == (0, f"splatseg {ss.__version__}\n")
    ended = command("run", "nowhere", "--out", "out")
    assert (ended.returncode, ended.stderr) == (2, "error: nowhere: does not exist\n")
    ended = command("walk")
    assert ended.returncode == 2 and "unrecognized subcommand 'walk'" in ended.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_keeps_what_is_done(tmp_path):
    out = tmp_path / "out"
    program = [sys.executable, "-m", "splatseg", "run", ROOM.replace("frames=8", "frames=4000"), "--out", str(out)]
    process = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_for(out / "segments/frame-000002.png")
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert process.returncode == 130 and "interrupted by SIGINT" in errors, errors
    assert (out / "summary.json").exists() and "KeyboardInterrupt" not in errors
