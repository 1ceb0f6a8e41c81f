"""Display in notebooks, supervision and Rerun."""

import struct
import threading
import time

import numpy as np
import pytest
import splatseg as ss
from conftest import command, step
from PIL import Image


def test_results_show_themselves(tmp_path, room):
    pipeline = ss.FastSamSplat(segmenter="graph")
    for frame in room:
        result = step(pipeline, frame)
    png = result._repr_png_()
    assert png.startswith(b"\x89PNG") and struct.unpack(">II", png[16:24]) == (96, 72)
    picture = result.plot()
    assert (picture.shape, picture.dtype) == ((72, 96, 3), np.uint8)
    assert (picture != result.rgb).any(axis=2).mean() > 0.5
    result.save(tmp_path / "frame.png")
    with pytest.raises(ValueError, match=r"x\.jpg: ends in \.jpg, expected \.png"):
        result.save(tmp_path / "x.jpg")
    assert not (tmp_path / "x.jpg").exists()
    with Image.open(tmp_path / "frame.png") as saved:
        np.testing.assert_array_equal(np.asarray(saved), picture)
    table = pipeline._repr_html_()
    assert table.count("<tr>") == len(pipeline.objects()) + 1
    assert f"{len(pipeline.objects())} objects of splatseg.FastSamSplat: fastsam-splat, 8 frames" in table
    assert repr(pipeline) == "<splatseg.FastSamSplat: fastsam-splat, 8 frames>"


def test_supervision(room):
    supervision = pytest.importorskip("supervision")
    pipeline = ss.FastSamSplat(segmenter="graph")
    for frame in room[:3]:
        result = step(pipeline, frame)
    detections = result.to_supervision()
    assert isinstance(detections, supervision.Detections) and len(detections) == len(result.objects)
    assert detections.tracker_id.tolist() == [sighting.id for sighting in result.objects]
    np.testing.assert_array_equal(detections.mask, result.masks)
    # Annotators colour by class unless told otherwise: each object has a colour of its own all the same.
    black = np.zeros_like(result.rgb)
    annotated = supervision.MaskAnnotator(opacity=1.0).annotate(black, detections)
    colors = {tuple(annotated[mask][0].tolist()) for mask in result.masks}
    assert len(colors) == len(result.objects) >= 3
    np.testing.assert_array_equal(detections.area, [sighting.area for sighting in result.objects])
    empty = step(ss.FastSamSplat(segmenter=lambda rgb, depth: np.zeros(depth.shape, np.uint8)), room[0])
    assert len(empty.to_supervision()) == 0


def entities(path):
    """The entities of a Rerun recording."""
    from rerun.chunk import RrdReader

    return {str(chunk.entity_path) for chunk in RrdReader(path).stream()}


def test_rerun(tmp_path, room):
    rr = pytest.importorskip("rerun")
    pipeline = ss.FastSamSplat(segmenter="graph")
    stream = rr.RecordingStream("test")
    stream.save(tmp_path / "test.rrd")
    for frame in room:
        ss.rerun.log(step(pipeline, frame, timestamp=float(frame.index)), pipeline, recording=stream)
    ss.rerun.log_map(pipeline, recording=stream)
    stream.flush()
    del stream
    image = "/world/camera/image"
    expected = {
        "/world/camera",
        image,
        f"{image}/rgb",
        f"{image}/depth",
        f"{image}/ids",
        f"{image}/boxes",
        "/world/map",
    }
    assert expected | {"/world/boxes"} <= entities(tmp_path / "test.rrd")


def test_a_slow_viewer_delays_no_frame(tmp_path, room, monkeypatch):
    rr = pytest.importorskip("rerun")
    pipeline = ss.FastSamSplat(segmenter="graph")
    stream = rr.RecordingStream("test")
    stream.save(tmp_path / "test.rrd")
    # The viewer takes the first frame, and nothing more until all others have come.
    may_go_on, log_frame, frames = threading.Event(), ss.rerun._log_frame, []

    def slow(result, frame, recording):
        frames.append(frame)
        log_frame(result, frame, recording)
        assert may_go_on.wait(20)

    monkeypatch.setattr(ss.rerun, "_log_frame", slow)
    with ss.rerun.Logger(stream) as logger:
        for frame in room:
            logger.log(step(pipeline, frame), pipeline)
            while not frames:
                time.sleep(0.001)
        may_go_on.set()
    assert frames == [0, len(room) - 1] and logger.dropped == len(room) - 2
    stream.flush()
    del stream
    assert {"/world/camera/image/ids", "/world/map", "/world/boxes"} <= entities(tmp_path / "test.rrd")


def test_an_error_of_the_viewer_is_raised(room, monkeypatch):
    rr = pytest.importorskip("rerun")
    result = step(ss.FastSamSplat(segmenter="graph"), room[0])

    def broken(*_):
        raise OSError("viewer is gone")

    monkeypatch.setattr(ss.rerun, "_log_frame", broken)
    logger = ss.rerun.Logger(rr.RecordingStream("test"))
    logger.log(result)
    with pytest.raises(OSError, match="viewer is gone"):
        logger.close()
    with pytest.raises(OSError, match="viewer is gone"):
        logger.log(result)
    logger.close()


def test_view(tmp_path):
    pytest.importorskip("rerun")
    from splatseg.view import view

    out = tmp_path / "out"
    assert command("run", "synthetic:frames=3,width=96,height=72", "--out", str(out), "--no-page").returncode == 0
    view(out, tmp_path / "run.rrd")
    assert {"/world/camera/image/overlay", "/world/path"} <= entities(tmp_path / "run.rrd")
    with pytest.raises(ValueError, match="has no summary.json"):
        view(tmp_path)
