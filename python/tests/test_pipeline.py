"""Methods, run frame by frame."""

import dataclasses
import json
import re
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import splatseg as ss
from conftest import ROOM, command, step
from PIL import Image


def read_ids(path):
    """An id image."""
    with Image.open(path) as image:
        return np.array(image).astype(np.uint16)


def saved_map(path):
    """The Gaussians of a saved map, and its state but the rooms: only a run looks for them at its end."""
    data = path.read_bytes()
    header = data.index(b"end_header\n")
    size = int(re.search(rb"^comment splatseg memory .* state (\d+)$", data[:header], re.MULTILINE)[1])
    state = {name: value for name, value in ss.read_state(path).items() if not name.startswith("history.rooms.")}
    return data[header : -4 - size], state


@pytest.mark.parametrize("settings", [{}, {"memory": {"kind": "features"}}, {"threads": 1, "seed": 3}])
def test_results_are_those_of_the_command(tmp_path, room, settings):
    flags = [f"--set=memory.kind={settings['memory']['kind']}"] if "memory" in settings else []
    flags += [f"--{name}={settings[name]}" for name in ("threads", "seed") if name in settings]
    out, saved = tmp_path / "out", tmp_path / "command.ply"
    ended = command("run", ROOM, "--out", str(out), "--save-memory", str(saved), "--no-page", "--online", *flags)
    assert ended.returncode == 0, ended.stderr
    pipeline = ss.FastSamSplat(**settings)
    for frame in room:
        result = step(pipeline, frame)
        assert result.ids.dtype == np.uint32
        np.testing.assert_array_equal(result.ids, read_ids(out / "segments" / f"{frame.name}.png"))
    pipeline.save(tmp_path / "python.ply")
    (gaussians, state), (expected, expected_state) = saved_map(tmp_path / "python.ply"), saved_map(saved)
    assert gaussians == expected
    np.testing.assert_equal(state, expected_state)
    listed = json.loads((out / "objects.json").read_text())["objects"]
    found = pipeline.objects()
    assert [entry.id for entry in found] == [entry["id"] for entry in listed]
    for entry, expected in zip(found, listed, strict=True):
        assert entry.confidence == expected["confidence"]
        assert (entry.shape is None) == (expected["shape"] is None)
        if entry.shape is not None:
            assert list(entry.centroid) == expected["shape"]["centroid"]
            assert list(entry.box[0]) == expected["shape"]["axis_aligned_box"]["min"]


@pytest.mark.parametrize(("working_pixels", "height"), [(76_800, 72), (1728, 36)])
def test_a_frame_can_be_looked_at_again(tmp_path, room, working_pixels, height):
    out = tmp_path / "out"
    ended = command("run", ROOM, "--out", str(out), "--no-page", "--set", f"working_pixels={working_pixels}")
    assert ended.returncode == 0, ended.stderr
    pipeline = ss.FastSamSplat(working_pixels=working_pixels)
    results = [step(pipeline, frame) for frame in room]
    assert results[0].ids.shape[0] == 72
    assert results[0].regions.shape[0] == height
    assert pipeline.settle()
    again = [pipeline.look_again(result) for result in results]
    for frame, ids in zip(room, again, strict=True):
        np.testing.assert_array_equal(ids, read_ids(out / "segments" / f"{frame.name}.png"))
    assert any((ids != result.ids).any() for ids, result in zip(again, results, strict=True))
    other = ss.FastSamSplat(memory={"kind": "features"})
    result = step(other, room[0])
    with pytest.raises(ValueError, match="cannot look at frames again"):
        other.look_again(result)
    assert not other.settle()


def test_a_frame_is_looked_at_from_its_corrected_pose(room):
    pipeline = ss.FastSamSplat(poses="track")
    results = [step(pipeline, frame) for frame in room]
    assert pipeline.settle()
    result, moved = results[1], np.eye(4)
    moved[:3, 3] = 0.2, 0.1, 0.0
    keyframe, then = result._anchor
    # As if the keyframe had been elsewhere when the frame was processed.
    before = (np.linalg.inv(moved) @ np.reshape(then, (4, 4))).ravel().tolist()
    again = pipeline.look_again(dataclasses.replace(result, _anchor=(keyframe, before)))
    from_there = dataclasses.replace(result, camera_to_world=moved @ result.camera_to_world, _anchor=None)
    np.testing.assert_array_equal(again, pipeline.look_again(from_there))
    assert (again != pipeline.look_again(result)).any()


def test_a_step_says_what_it_found(room):
    pipeline = ss.FastSamSplat(segmenter="graph")
    result = [step(pipeline, frame, timestamp=float(frame.index)) for frame in room][-1]
    height, width = room[0].depth.shape
    assert result.ids.shape == result.confidence.shape == (height, width)
    assert [sighting.id for sighting in result.objects] == sorted(set(result.ids[result.ids > 0].tolist()))
    assert result.masks.shape == (len(result.objects), height, width)
    for sighting, mask in zip(result.objects, result.masks, strict=True):
        rows, columns = np.nonzero(mask)
        x, y, box_width, box_height = sighting.bounding_box
        assert (x, y) == (columns.min(), rows.min())
        assert (x + box_width, y + box_height) == (columns.max() + 1, rows.max() + 1)
        assert sighting.area == mask.sum()
        assert sighting.confidence == pytest.approx(result.confidence[mask].mean(), abs=1e-5)
    assert result.times_ms["segment"] > 0
    assert pipeline.frames == len(room)
    assert pipeline.objects()[0].first_seen.time_s == 0.0


def test_the_memory_is_arrays(room):
    pipeline = ss.FastSamSplat(segmenter="graph")
    assert len(pipeline.memory) == 0 and pipeline.memory.means.shape == (0, 3)
    for frame in room:
        result = step(pipeline, frame)
    memory = pipeline.memory
    count = len(memory)
    assert count > 500
    assert memory.means.shape == memory.colors.shape == (count, 3)
    assert memory.radii.shape == memory.segment_ids.shape == memory.has_place.shape == (count,)
    assert memory.has_place.all(), "the room has depth everywhere"
    assert (memory.means.dtype, memory.colors.dtype, memory.segment_ids.dtype) == (np.float64, np.uint8, np.uint32)
    assert set(np.unique(result.ids)) <= set(np.unique(memory.segment_ids)) | {0}


def test_a_saved_memory_goes_on(tmp_path, room):
    whole = ss.FastSamSplat(segmenter="graph")
    expected = [step(whole, frame).ids for frame in room]
    first = ss.FastSamSplat(segmenter="graph")
    for frame in room[:5]:
        step(first, frame)
    first.save(tmp_path / "map.ply")
    with pytest.raises(FileExistsError, match="overwrite=True"):
        first.save(tmp_path / "map.ply")
    second = ss.FastSamSplat.load(tmp_path / "map.ply", segmenter="graph")
    assert isinstance(second, ss.FastSamSplat)
    for frame, ids in zip(room[5:], expected[5:], strict=True):
        np.testing.assert_array_equal(step(second, frame).ids, ids)
    (tmp_path / "bad.ply").write_bytes(b"ply\nformat binary_little_endian 1.0\n")
    with pytest.raises(ValueError, match=r"bad\.ply"):
        ss.FastSamSplat.load(tmp_path / "bad.ply")


def test_a_loaded_map_says_that_it_has_no_views(tmp_path, room):
    first = ss.FastSamSplat(segmenter="graph")
    for frame in room:
        step(first, frame)
    first.save(tmp_path / "map.ply")
    loaded = ss.FastSamSplat.load(tmp_path / "map.ply", segmenter="graph", keep_views=True)
    with pytest.raises(ValueError, match="objects have no view, because a saved map has none: pass frames"):
        loaded.name_objects(lambda *_: "thing")
    result = step(loaded, room[0])
    with pytest.warns(UserWarning, match="objects have no view.* they were not named"):
        assert loaded.name_objects(lambda *_: "thing") == len(result.objects)


def test_settings_are_keywords(tmp_path, room):
    pipeline = ss.FastSamSplat(seed=7, memory={"max_votes": np.float32(8)}, **{"memory.removal_frames": 5})
    settings = pipeline.settings
    assert (settings["seed"], settings["memory"]["max_votes"], settings["memory"]["removal_frames"]) == (7, 8.0, 5)
    for wrong, message in [
        ({"sed": 3}, "there is no setting sed, did you mean seed?"),
        ({"memory": {"max_votess": 3}}, "did you mean memory.max_votes?"),
        ({"memory": 3}, "memory is a section: choose one of its settings"),
        ({"seed": object()}, "seed is of type object, expected a number"),
    ]:
        with pytest.raises(TypeError, match=message.replace("?", r"\?")):
            ss.FastSamSplat(**wrong)
    for wrong, message in [
        ({"seed": "x"}, "seed is"),
        ({"memory": {"max_votes": -1}}, "memory.max_votes is -1"),
        ({"segmenter": "yolo"}, "expected affinity, graph, fastsam, masks or oracle"),
        ({"masks": "x"}, "masks is not used here"),
        ({"segmenter": "oracle"}, "segmenter = oracle"),
    ]:
        with pytest.raises(ValueError, match=message):
            ss.FastSamSplat(**wrong)
    (tmp_path / "run.toml").write_text("seed = 4\n[memory]\nmax_votes = 3\n")
    settings = ss.FastSamSplat(config=tmp_path / "run.toml", seed=5).settings
    assert (settings["seed"], settings["memory"]["max_votes"]) == (5, 3.0)
    assert ss.Pipeline("fastsam", segmenter=ss.Graph(min_area=50)).settings["graph"]["min_area"] == 50
    with pytest.raises(ValueError, match="has no memory"):
        _ = ss.Pipeline("fastsam").memory


def bad_frames(frame):
    """Wrong arguments of a step: the changes, the exception and a part of its text."""
    rgb, depth, pose = frame.rgb, frame.depth, frame.camera_to_world
    nan_pose = pose.copy()
    nan_pose[0, 3] = np.nan
    scaled = pose.copy()
    scaled[:3, :3] *= 2
    return [
        ({"rgb": rgb[..., ::-1]}, ValueError, "rgb is not contiguous"),
        ({"rgb": rgb.astype(np.float32)}, TypeError, "rgb is an array of float32, expected a NumPy array of uint8"),
        ({"rgb": rgb[..., :1]}, ValueError, r"rgb has shape \(72, 96, 1\)"),
        ({"rgb": rgb.tolist()}, TypeError, "rgb is of type list"),
        ({"rgb": None}, TypeError, "rgb is of type NoneType"),
        ({"rgb": rgb[:0]}, ValueError, r"rgb has shape \(0, 96, 3\)"),
        ({"depth": depth[:-1]}, ValueError, "colour is 96x72 but depth is 96x71"),
        ({"depth": depth.T}, ValueError, "depth is not contiguous"),
        ({"depth": depth.astype(np.uint16)}, TypeError, "depth is an array of uint16"),
        ({"depth": depth * 1000}, ValueError, "expected metres: pass depth_scale=1000 if it is in millimetres"),
        ({"depth": depth.astype(np.float64) * 1000}, ValueError, "pass depth_scale=1000"),
        ({"depth": depth, "depth_scale": -1}, ValueError, "depth_scale is -1"),
        ({"depth": depth, "depth_scale": 1e38}, ValueError, "depth_scale is 1"),
        ({"depth": np.ma.masked_less(depth, 1)}, TypeError, r"depth is a masked array.* pass depth\.filled\(0\)"),
        ({"K": np.ma.masked_array(frame.K)}, TypeError, r"pass K\.filled\(0\)"),
        ({"depth": depth[None]}, ValueError, r"depth has shape \(1, 72, 96\)"),
        ({"K": frame.K[:2]}, ValueError, r"K has shape \(2, 3\)"),
        ({"K": np.eye(3) * 0}, ValueError, "K is"),
        ({"K": frame.K.T}, ValueError, "K is"),
        ({"K": "K"}, TypeError, "K is of type str"),
        ({"camera_to_world": nan_pose}, ValueError, "camera_to_world contains NaN"),
        ({"camera_to_world": scaled}, ValueError, "not a rigid transform"),
        ({"camera_to_world": pose[:3]}, ValueError, r"camera_to_world has shape \(3, 4\)"),
        ({"camera_to_world": "no pose"}, TypeError, "camera_to_world"),
        ({"timestamp": -1.0}, ValueError, "timestamp is -1"),
        ({"timestamp": float("nan")}, ValueError, "timestamp is NaN"),
        ({"timestamp": 1.7e18}, ValueError, "not another unit"),
        ({"timestamp": "now"}, TypeError, "timestamp"),
    ]


def test_wrong_frames_are_told_and_change_nothing(room):
    pipeline, undisturbed = ss.FastSamSplat(segmenter="graph"), ss.FastSamSplat(segmenter="graph")
    for frame in room[:2]:
        np.testing.assert_array_equal(step(pipeline, frame).ids, step(undisturbed, frame).ids)
    frame = room[2]
    whole = {"rgb": frame.rgb, "depth": frame.depth, "K": frame.K, "camera_to_world": frame.camera_to_world}
    for change, error, message in bad_frames(frame):
        with pytest.raises(error, match=message):
            pipeline.step(**{**whole, **change})
    np.testing.assert_array_equal(step(pipeline, frame).ids, step(undisturbed, frame).ids)


def test_depth_may_be_of_other_types(room):
    frame = room[0]
    millimetres = np.round(frame.depth * 1000).astype(np.uint16)
    expected = ss.FastSamSplat().step(
        frame.rgb, (millimetres / np.float32(1000)).astype(np.float32), K=frame.K, camera_to_world=frame.camera_to_world
    )
    for depth, scale in [(millimetres, 1000), (millimetres.astype(np.float64), 1000), (millimetres / 1000, None)]:
        found = ss.FastSamSplat().step(
            frame.rgb, depth, K=frame.K.tolist(), camera_to_world=frame.camera_to_world.tolist(), depth_scale=scale
        )
        np.testing.assert_array_equal(found.ids, expected.ids)
    sky = frame.depth.copy()
    sky[:40] = 1e10
    far = ss.FastSamSplat(segmenter="graph").step(frame.rgb, frame.depth * 1000, K=frame.K, depth_scale=1)
    assert far.ids.shape == frame.depth.shape
    ss.FastSamSplat().step(frame.rgb, sky, K=frame.K, camera_to_world=frame.camera_to_world)
    masks, _ = ss.Graph()(frame.rgb, millimetres, frame.K, depth_scale=1000)
    np.testing.assert_array_equal(masks, ss.Graph()(frame.rgb, millimetres / 1000, frame.K)[0])
    holes = frame.depth.copy()
    holes[10:20] = np.nan
    ss.FastSamSplat().step(frame.rgb, holes, K=frame.K, camera_to_world=frame.camera_to_world)


def test_one_thread_at_a_time(room):
    started, go_on = threading.Event(), threading.Event()

    def slow(rgb, depth):
        started.set()
        assert go_on.wait(10), "the GIL is held while others should work"
        return np.zeros(depth.shape, np.uint8)

    pipeline = ss.FastSamSplat(segmenter=slow)
    thread = threading.Thread(target=step, args=(pipeline, room[0]))
    thread.start()
    assert started.wait(10)
    with pytest.raises(RuntimeError, match="one thread at a time"):
        step(pipeline, room[1])
    go_on.set()
    thread.join()
    step(pipeline, room[1])


def test_others_work_while_it_computes():
    frame = ss.open_scene("synthetic:frames=1,width=640,height=480")[0]
    pipeline = ss.FastSamSplat(segmenter="graph", threads=1)
    counted, over = 0, threading.Event()
    thread = threading.Thread(target=lambda: (step(pipeline, frame), over.set()))
    thread.start()
    while not over.is_set():
        counted += 1
        time.sleep(0.001)
    assert counted > 10


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_a_program():
    # A shell makes background processes ignore SIGINT, and their children inherit it.
    program = f"""
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
import splatseg as ss
pipeline = ss.FastSamSplat(segmenter="graph")
frame = ss.open_scene("{ROOM}")[0]
print("started", flush=True)
while True:
    pipeline.step(frame.rgb, frame.depth, K=frame.K, camera_to_world=frame.camera_to_world)
"""
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "started\n"
    time.sleep(0.3)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert "KeyboardInterrupt" in errors


def test_without_poses_the_camera_is_tracked() -> None:
    frames = list(ss.open_scene("synthetic:frames=8,width=160,height=120,speed=0.1"))
    pipeline = ss.FastSamSplat()
    for frame in frames:
        result = pipeline.step(frame.rgb, frame.depth, K=frame.K)
        assert result.pose_state == "tracked"
        true = np.linalg.inv(frames[0].camera_to_world) @ frame.camera_to_world
        np.testing.assert_allclose(result.camera_to_world, true, atol=0.02)
    given = pipeline.step(frame.rgb, frame.depth, K=frame.K, camera_to_world=frame.camera_to_world)
    assert given.pose_state == "given"
    np.testing.assert_allclose(given.camera_to_world, frame.camera_to_world, atol=1e-9)


def test_a_lens_is_corrected_as_in_a_recording(tmp_path):
    distortion = ("plumb_bob", [-0.3, 0.1, 0.001, -0.002, 0.02])
    rgb = np.random.default_rng(3).integers(0, 255, (48, 64, 3), np.uint8)
    depth = np.full((48, 64), 2000, np.uint16)
    depth[:, 40:] = 1500
    for name, picture in [("color", rgb), ("depth", depth)]:
        (tmp_path / name).mkdir()
        Image.fromarray(picture).save(tmp_path / name / "0.png")
    camera = {"fx": 60, "fy": 60, "cx": 31.5, "cy": 23.5, "width": 64, "height": 48, "depth_scale": 1000}
    lens = {"distortion_model": distortion[0], "distortion_coefficients": distortion[1]}
    (tmp_path / "camera.json").write_text(json.dumps(camera | lens))
    (recorded,) = ss.open_scene(tmp_path)
    pipeline = ss.FastSamSplat()
    K = [[60, 0, 31.5], [0, 60, 23.5], [0, 0, 1]]
    result = pipeline.step(rgb, depth, K=K, depth_scale=1000, distortion=distortion)
    assert (result.rgb != rgb).any()
    np.testing.assert_array_equal(result.rgb, recorded.rgb)
    np.testing.assert_array_equal(result.depth, recorded.depth)
    np.testing.assert_array_equal(pipeline.look_again(result).shape, (48, 64))
    without = ss.FastSamSplat().step(rgb, depth, K=K, depth_scale=1000, distortion=("plumb_bob", [0.0] * 5))
    np.testing.assert_array_equal(without.rgb, rgb)
    for wrong, text in [
        (("plum", [1.0]), "plum"),
        (("plumb_bob", [1.0]), "plumb_bob"),
        (("plumb_bob", [np.nan] * 5), "NaN"),
    ]:
        with pytest.raises(ValueError, match=f"distortion: .*{text}"):
            pipeline.step(rgb, depth, K=K, depth_scale=1000, distortion=wrong)
    for wrong, error, text in [
        ([0.1, 0, 0, 0, 0], TypeError, r"distortion is \[0.1, 0, 0, 0, 0\], expected a model and its coefficients"),
        ((1, [0.0] * 5), TypeError, "distortion is"),
        (("plumb_bob", None), ValueError, r"coefficients of distortion have shape \(\)"),
        (("plumb_bob", [[0.0] * 5]), ValueError, r"coefficients of distortion have shape \(1, 5\)"),
        (("plumb_bob", ["x"]), TypeError, "distortion is"),
    ]:
        with pytest.raises(error, match=text):
            pipeline.step(rgb, depth, K=K, depth_scale=1000, distortion=wrong)
    with pytest.raises(ValueError, match="depth"):
        pipeline.step(rgb, depth[:20], K=K, depth_scale=1000, distortion=distortion)
    assert pipeline.frames == 1


@pytest.fixture
def with_views(room):
    pipeline = ss.FastSamSplat(segmenter="graph", keep_views=True)
    for frame in room:
        step(pipeline, frame)
    return pipeline


def test_a_namer_may_return_a_score(with_views):
    assert with_views.name_objects(lambda *_: ("mug", np.float32(0.5))) > 3
    named = [entry for entry in with_views.objects() if entry.label]
    assert {(entry.label, entry.label_score) for entry in named} == {("mug", 0.5)}
    with_views.clear_names()
    assert with_views.name_objects(lambda *_: ("mug", np.ones(4))) > 3
    assert with_views.find(np.ones(4))[0].similarity == pytest.approx(1)


@pytest.mark.parametrize(
    ("returned", "error", "message"),
    [
        (("mug", 1.5), ValueError, "the score of the label 'mug' is 1.5, expected 0 to 1"),
        (("mug", float("nan")), ValueError, "the score of the label 'mug' is nan"),
        (0.9, ValueError, r"the embedding has shape \(\), expected a vector"),
        ((None, 0.9), ValueError, r"the embedding has shape \(\), expected a vector"),
        (np.ones((1, 5)), ValueError, r"the embedding has shape \(1, 5\), expected a vector"),
        (["mug"], TypeError, "the embedding is of type list, expected a vector of numbers"),
        (b"mug", TypeError, "the embedding is of type bytes"),
    ],
)
def test_wrong_names_are_told(with_views, returned, error, message):
    with pytest.raises(error, match=message):
        with_views.name_objects(lambda *_: returned)
    assert not any(entry.label for entry in with_views.objects())


def test_a_result_has_copies_of_the_buffers(room):
    buffers = np.empty_like(room[0].rgb), np.empty_like(room[0].depth), np.empty((3, 3))
    reused, plain = ss.FastSamSplat(), ss.FastSamSplat()
    found, expected = [], []
    for frame in room:
        for buffer, values in zip(buffers, (frame.rgb, frame.depth, frame.K), strict=True):
            buffer[:] = values
        found.append(reused.step(buffers[0], buffers[1], K=buffers[2], camera_to_world=frame.camera_to_world))
        expected.append(step(plain, frame))
    assert reused.settle() == plain.settle()
    for one, other, frame in zip(found, expected, room, strict=True):
        np.testing.assert_array_equal(one.rgb, frame.rgb)
        np.testing.assert_array_equal(one.depth, frame.depth)
        np.testing.assert_array_equal(one.K, frame.K)
        np.testing.assert_array_equal(reused.look_again(one), plain.look_again(other))


def test_with_strict_input_a_contradiction_is_an_error():
    frames = list(ss.open_scene("synthetic:frames=12,width=96,height=72,speed=0.2"))

    def run(pipeline):
        for frame in frames:
            step(pipeline, frame, camera_to_world=np.linalg.inv(frame.camera_to_world))

    with pytest.warns(UserWarning, match="pose"):
        run(ss.FastSamSplat(segmenter="graph"))
    with pytest.raises(ValueError, match=r"pose.*strict_input ends the run"):
        run(ss.FastSamSplat(segmenter="graph", strict_input=True))


def test_numpy_bools_are_settings():
    assert ss.FastSamSplat(online=np.True_).settings["online"] is True
    for value in (True, np.True_):
        with pytest.raises(ValueError, match="memory.max_votes is true"):
            ss.FastSamSplat(memory={"max_votes": value})


def test_a_method_of_its_own_takes_no_other():
    with pytest.raises(TypeError, match=r"FastSamSplat is the method fastsam-splat: use ss\.Pipeline\('fastsam'\)"):
        ss.FastSamSplat(method="fastsam")
    with pytest.raises(TypeError, match="Sam2Splat is the method sam2-splat"):
        ss.Sam2Splat("weights.pt", method="sam2")
