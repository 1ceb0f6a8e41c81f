"""``python -m splatseg.camera``, and the example of a phone: on RealSense's SDK with a device in software, and on fakes
with the signatures of the other SDKs."""

import inspect
import json
import re
import sys
import time
from datetime import timedelta
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import splatseg as ss
from splatseg.camera import PACKAGES
from splatseg.camera.__main__ import main as command
from splatseg.camera.png import encode, encode_ids
from test_examples import example

FRAMES = 6
SCENE = f"synthetic:frames={FRAMES},width=96,height=72,objects=6"


@pytest.fixture
def frames():
    return list(ss.open_scene(SCENE))


@pytest.fixture
def module(monkeypatch):
    def install(name, **contents):
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
        # Read anew, with this module.
        for own in [name for name in sys.modules if re.fullmatch(r"splatseg\.camera\.(realsense|orbbec|oak)", name)]:
            monkeypatch.delitem(sys.modules, own)

    return install


def units(frame, per_metre):
    return np.round(frame.depth * per_metre).astype(np.uint16)


def check(camera, frames, per_metre, folder, capsys, distortion=None):
    """Records the camera and reads the folder, then goes on with a map of it and writes ids."""
    recorded = folder / "recorded"
    assert command([camera, "--record", str(recorded), "--frames", str(FRAMES)]) == 0
    assert capsys.readouterr().out == f"{recorded}: {FRAMES} frames: splatseg run {recorded} --out out\n"
    written = json.loads((recorded / "camera.json").read_text())
    assert written.pop("depth_scale") == pytest.approx(per_metre)
    assert (written.pop("distortion_model", None), written.pop("distortion_coefficients", None)) == (
        distortion or (None, None)
    )
    if distortion is None:
        for found, expected in zip(ss.open_scene(recorded), frames, strict=True):
            assert (found.rgb == expected.rgb).all()
            assert (units(found, per_metre) == units(expected, per_metre)).all()
            assert np.allclose(found.K, expected.K) and found.camera_to_world is None
        times = [frame.timestamp for frame in ss.open_scene(recorded)]
        assert np.allclose(np.diff(times), 1 / 30, atol=1e-5)
    map_file, ids = folder / "map.ply", folder / "ids"
    arguments = [camera, "--map", str(map_file), "--frames", "3"]
    assert command(arguments) == 0
    assert capsys.readouterr().out.startswith("3 frames, ")
    assert command([*arguments, "--ids", str(ids)]) == 0
    assert sorted(path.name for path in ids.iterdir()) == [f"{number:06}.png" for number in range(3)]
    assert len(ss.FastSamSplat.load(map_file).objects()) >= 3


class Clock:
    """The time of each frame, 30 in a second, from 100 s on."""

    def __init__(self, frames):
        self.frames, self.number = frames, 0

    def next(self):
        frame = self.frames[self.number % len(self.frames)]
        self.number += 1
        return frame, 100 + self.number / 30


def orbbec(frames, distortion=None):
    """The module ``pyorbbecsdk``."""
    clock = Clock(frames)

    def picture(array, at, **more):
        height, width = array.shape[:2]
        fx, fy, cx, cy = frames[0].K[[0, 1, 0, 1], [0, 1, 2, 2]]
        none = dict.fromkeys(["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"], 0.0)
        video = SimpleNamespace(
            get_intrinsic=lambda: SimpleNamespace(fx=fx, fy=fy, cx=cx, cy=cy, width=width, height=height),
            get_distortion=lambda: SimpleNamespace(**(distortion or {**none, "model": "none"})),
        )
        return SimpleNamespace(
            get_height=lambda: height,
            get_width=lambda: width,
            get_data=lambda: array.reshape(-1).view(np.uint8),
            get_timestamp_us=lambda: round(at * 1e6),
            get_stream_profile=lambda: SimpleNamespace(as_video_stream_profile=lambda: video),
            **more,
        )

    def pair(timeout_ms):
        pair.calls += 1
        # A camera that has no pair in time now and then.
        if pair.calls % 3 == 0:
            return None
        frame, at = clock.next()
        color = picture(frame.rgb, at)
        depth = picture(units(frame, 2000), at, get_depth_scale=lambda: 0.5)
        images = SimpleNamespace(get_color_frame=lambda: color, get_depth_frame=lambda: depth)
        return SimpleNamespace(as_frame_set=lambda: images)

    pair.calls = 0

    class Pipeline:
        def get_stream_profile_list(self, sensor):
            return SimpleNamespace(
                get_video_stream_profile=lambda width=0, height=0, format=None, fps=0: (width, height, format, fps),
                get_default_video_stream_profile=lambda: sensor,
            )

        def enable_frame_sync(self): ...

        def start(self, config):
            assert config.streams == [(640, 0, "RGB", 30), "depth"] and config.mode == "full"

        def stop(self): ...

        wait_for_frames = staticmethod(pair)

    class Config:
        def __init__(self):
            self.streams = []

        def enable_stream(self, profile):
            self.streams.append(profile)

        def set_frame_aggregate_output_mode(self, mode):
            self.mode = mode

    class AlignFilter:
        def __init__(self, align_to_stream):
            assert align_to_stream == "color"

        def process(self, pair):
            return pair

    return {
        "AlignFilter": AlignFilter,
        "Config": Config,
        "OBCameraDistortionModel": SimpleNamespace(NONE="none", KANNALA_BRANDT4="fisheye", BROWN_CONRADY_K6="k6"),
        "OBFormat": SimpleNamespace(RGB="RGB"),
        "OBFrameAggregateOutputMode": SimpleNamespace(FULL_FRAME_REQUIRE="full"),
        "OBSensorType": SimpleNamespace(COLOR_SENSOR="color", DEPTH_SENSOR="depth"),
        "OBStreamType": SimpleNamespace(COLOR_STREAM="color"),
        "Pipeline": Pipeline,
    }


def test_orbbec(frames, module, tmp_path, capsys):
    module("pyorbbecsdk", **orbbec(frames))
    check("orbbec", frames, 2000, tmp_path, capsys)


def test_a_distorted_lens_is_recorded(frames, module, tmp_path, capsys):
    lens = {"k1": 0.1, "k2": 0.2, "k3": 0.3, "k4": 0.4, "k5": 0.5, "k6": 0.6, "p1": 0.01, "p2": 0.02, "model": "k6"}
    module("pyorbbecsdk", **orbbec(frames, lens))
    expected = ("rational_polynomial", [0.1, 0.2, 0.01, 0.02, 0.3, 0.4, 0.5, 0.6])
    check("orbbec", frames, 2000, tmp_path, capsys, expected)


def oak(frames):
    """The module ``depthai``, version 3."""
    clock = Clock(frames)
    port = SimpleNamespace(link=lambda other: None)

    class Camera:
        def build(self, boardSocket):
            return self

        def requestOutput(self, size, type, *, fps, enableUndistortion):
            assert (size, type, fps, enableUndistortion) == ((640, 400), "RGB888i", 15, True)
            return port

    class StereoDepth:
        depth = port

        def build(self, *, autoCreateCameras, fps):
            return self

    class ImageAlign:
        input = inputAlignTo = outputAligned = port

    class Sync:
        def __init__(self):
            self.inputs = {"color": port, "depth": port}

        @property
        def out(self):
            return SimpleNamespace(createOutputQueue=lambda maxSize, blocking: SimpleNamespace(get=self.get))

        def get(self):
            frame, at = clock.next()
            time = timedelta(seconds=at)
            image = lambda array: SimpleNamespace(getFrame=lambda: array, getTimestamp=lambda: time)
            return {"color": image(frame.rgb), "depth": image(units(frame, 1000))}

    class Pipeline:
        def __enter__(self):
            return self

        def __exit__(self, *_): ...

        def create(self, kind):
            return kind()

        def start(self): ...

        def getDefaultDevice(self):
            intrinsics = lambda cameraId, resizeWidth, resizeHeight: frames[0].K.tolist()
            calibration = SimpleNamespace(getCameraIntrinsics=intrinsics)
            return SimpleNamespace(readCalibration=lambda: calibration)

    return {
        "CameraBoardSocket": SimpleNamespace(CAM_A="A"),
        "ImgFrame": SimpleNamespace(Type=SimpleNamespace(RGB888i="RGB888i")),
        "Pipeline": Pipeline,
        "node": SimpleNamespace(Camera=Camera, ImageAlign=ImageAlign, StereoDepth=StereoDepth, Sync=Sync),
    }


def test_oak(frames, module, tmp_path, capsys):
    module("depthai", **oak(frames))
    check("oak", frames, 1000, tmp_path, capsys)


def names_of(fake, path=""):
    """The names of a fake's classes, their methods and constants."""
    for name, value in vars(fake).items() if not isinstance(fake, dict) else fake.items():
        if name.startswith("__"):
            continue
        yield f"{path}{name}"
        if inspect.isclass(value) or isinstance(value, SimpleNamespace):
            yield from names_of(value, f"{path}{name}.")


@pytest.mark.parametrize(("name", "fake"), [("pyorbbecsdk", orbbec), ("depthai", oak)])
def test_the_fakes_have_names_of_the_sdk(name, fake, frames):
    real = pytest.importorskip(name, exc_type=ImportError)
    # What only the fakes have, or objects have and classes do not.
    own = {"streams", "mode", "get", "inputs", "link"}
    missing = []
    for path in names_of(fake(frames)):
        *parents, last = path.split(".")
        value = real
        try:
            for part in parents:
                value = getattr(value, part)
            getattr(value, last)
        except AttributeError:
            missing.append(path)
    assert [path for path in missing if path.split(".")[-1] not in own] == []


def software_device(rs, frames, file):
    """Records frames as a RealSense camera, with its own SDK. Colour and depth have the same place."""
    height, width = frames[0].depth.shape
    lens = rs.intrinsics()
    lens.width, lens.height, lens.model, lens.coeffs = width, height, rs.distortion.none, [0] * 5
    lens.fx, lens.fy, lens.ppx, lens.ppy = (float(value) for value in frames[0].K[[0, 1, 0, 1], [0, 1, 2, 2]])
    device = rs.software_device()
    sensors, profiles = [device.add_sensor("Stereo Module"), device.add_sensor("RGB Camera")], []
    kinds = [(rs.stream.depth, 2, rs.format.z16), (rs.stream.color, 3, rs.format.rgb8)]
    for number, (sensor, (kind, bytes_per_pixel, form)) in enumerate(zip(sensors, kinds, strict=True)):
        video = rs.video_stream()
        video.type, video.index, video.uid, video.width, video.height = kind, 0, number, width, height
        video.fps, video.bpp, video.fmt, video.intrinsics = 30, bytes_per_pixel, form, lens
        profiles.append(sensor.add_video_stream(video))
    sensors[0].add_read_only_option(rs.option.depth_units, 1 / 4000)
    same = rs.extrinsics()
    same.rotation, same.translation = [1, 0, 0, 0, 1, 0, 0, 0, 1], [0, 0, 0]
    profiles[0].register_extrinsics_to(profiles[1], same)
    recorder = rs.recorder(str(file), device)
    queue = rs.frame_queue(50)
    for sensor, profile in zip(recorder.query_sensors(), profiles, strict=True):
        sensor.open(profile)
        sensor.start(queue)
    for number, frame in enumerate(frames):
        for sensor, profile, pixels in zip(sensors, profiles, [units(frame, 4000), frame.rgb], strict=True):
            image = rs.software_video_frame()
            image.bpp, image.stride = pixels.nbytes // (width * height), pixels.nbytes // height
            image.timestamp, image.domain = 1000 + number * 1000 / 30, rs.timestamp_domain.system_time
            image.frame_number, image.profile = number + 1, profile.as_video_stream_profile()
            if image.bpp == 2:
                image.depth_units = 1 / 4000
            image.pixels = np.ascontiguousarray(pixels)
            sensor.on_video_frame(image)
        time.sleep(0.05)
    time.sleep(0.3)
    for sensor in recorder.query_sensors():
        sensor.stop()
        sensor.close()


def test_realsense(frames, monkeypatch, tmp_path, capsys):
    rs = pytest.importorskip("pyrealsense2", exc_type=ImportError)
    file = tmp_path / "device.db3"
    software_device(rs, frames, file)

    class PlayedConfig(rs.config):
        """Takes the recording for the first camera, again and again."""

        def __init__(self):
            super().__init__()
            self.enable_device_from_file(str(file), True)

    monkeypatch.setattr(rs, "config", PlayedConfig)
    recorded = tmp_path / "recorded"
    size = ["--size", "96x72"]
    assert command(["realsense", "--record", str(recorded), "--frames", "30", *size]) == 0
    capsys.readouterr()
    found = list(ss.open_scene(recorded))
    assert len(found) >= 3
    assert json.loads((recorded / "camera.json").read_text())["depth_scale"] == 4000
    for frame in found:
        same = [expected for expected in frames if (expected.rgb == frame.rgb).all()]
        assert len(same) == 1 and np.allclose(frame.K, same[0].K)
        differs = units(frame, 4000) != units(same[0], 4000)
        # The SDK's alignment loses pixels at edges.
        assert differs.mean() < 0.05
    map_file = tmp_path / "map.ply"
    assert command(["realsense", "--map", str(map_file), "--frames", "4", *size]) == 0
    assert len(ss.FastSamSplat.load(map_file).objects()) >= 3


def refused(arguments, capsys):
    code = command(arguments)
    found = capsys.readouterr()
    assert found.out == "" and found.err.count("\n") == 1 and found.err.startswith("error: ")
    return code, found.err


@pytest.mark.parametrize("camera", PACKAGES)
def test_a_missing_package_is_named(camera, monkeypatch, capsys):
    name, package = PACKAGES[camera]
    monkeypatch.setitem(sys.modules, name, None)
    monkeypatch.delitem(sys.modules, f"splatseg.camera.{camera}", raising=False)
    found = refused([camera], capsys)
    assert found == (2, f"error: the package {name} is missing: pip install {package}\n")


def test_failures_are_one_line(frames, module, tmp_path, capsys):
    def unplugged():
        raise RuntimeError("no camera")

    module("pyorbbecsdk", **{**orbbec(frames), "Pipeline": unplugged})
    assert refused(["orbbec"], capsys) == (1, "error: orbbec: no camera\n")
    module("pyorbbecsdk", **orbbec(frames))
    (tmp_path / "mine").write_text("mine")
    code, text = refused(["orbbec", "--record", str(tmp_path)], capsys)
    assert code == 2 and text.endswith("exists: choose another folder for the recording\n")
    code, text = refused(["orbbec", "--map", str(tmp_path / "mine"), "--frames", "1"], capsys)
    assert code == 2 and "mine" in text
    for wrong in (["--size", "640"], ["--frames", "0"], ["--record", "x", "--view"], ["--map", "no/such/map.ply"]):
        with pytest.raises(SystemExit) as exit:
            command(["orbbec", *wrong])
        assert exit.value.code == 2
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_a_camera_that_is_unplugged_leaves_its_map(frames, module, tmp_path, capsys):
    fake = orbbec(frames)
    wait = fake["Pipeline"].wait_for_frames

    def unplugged(timeout_ms):
        if wait.calls > 4:
            raise RuntimeError("device disconnected")
        return wait(timeout_ms)

    fake["Pipeline"].wait_for_frames = staticmethod(unplugged)
    module("pyorbbecsdk", **fake)
    assert command(["orbbec", "--map", str(tmp_path / "map.ply")]) == 1
    assert capsys.readouterr().err == "error: orbbec: device disconnected\n"
    assert len(ss.FastSamSplat.load(tmp_path / "map.ply").objects()) >= 3


def test_frames_are_shown_in_rerun(frames, module, tmp_path, monkeypatch, capsys):
    rr = pytest.importorskip("rerun", exc_type=ImportError)
    started = []

    def init(name, *, spawn):
        started.append((name, spawn))
        rr.set_global_data_recording(rr.RecordingStream(name))
        rr.save(tmp_path / "view.rrd")

    monkeypatch.setattr(rr, "init", init)
    module("pyorbbecsdk", **orbbec(frames))
    assert command(["orbbec", "--view", "--frames", "3"]) == 0
    rr.disconnect()
    assert started == [("splatseg", True)]
    assert (tmp_path / "view.rrd").stat().st_size > 10_000


def test_images_are_the_same_after_writing(tmp_path):
    image = pytest.importorskip("PIL.Image")
    random = np.random.default_rng(3)
    color = random.integers(0, 256, (7, 5, 3), np.uint8)
    (tmp_path / "color.png").write_bytes(encode(color))
    assert (np.asarray(image.open(tmp_path / "color.png")) == color).all()
    depth = random.integers(0, 65536, (7, 5), np.uint16)
    (tmp_path / "depth.png").write_bytes(encode(depth))
    assert (np.asarray(image.open(tmp_path / "depth.png")) == depth).all()
    ids = depth.astype(np.uint32) + 10 * 65536
    (tmp_path / "ids.png").write_bytes(encode_ids(ids))
    parts = np.asarray(image.open(tmp_path / "ids.png")).astype(np.uint32)
    assert (parts @ np.array([1, 256, 65536], np.uint32) == ids).all()


class Phone:
    """Colour has twice the pixels of depth in each direction, as much as the example has to undo."""

    def __init__(self):
        self.index = -1

    @staticmethod
    def get_connected_devices():
        return ["phone"]

    def connect(self, device):
        self._next()

    def _next(self):
        if self.index + 1 < FRAMES:
            self.index += 1
            self.on_new_frame()

    def get_depth_frame(self):
        return self.frames[self.index].depth

    def get_rgb_frame(self):
        return self.frames[self.index].rgb.repeat(2, 0).repeat(2, 1)

    def get_intrinsic_mat(self):
        K = 2 * self.frames[self.index].K
        fx, fy, tx, ty = K[[0, 1, 0, 1], [0, 1, 2, 2]]
        self._next()
        return SimpleNamespace(fx=fx, fy=fy, tx=tx, ty=ty)

    def get_camera_pose(self):
        pose = self.frames[self.index].camera_to_world @ np.diag([1.0, -1, -1, 1])
        w = np.sqrt(max(0, 1 + np.trace(pose[:3, :3]))) / 2
        if w > 1e-3:
            x, y, z = ((pose[k, j] - pose[j, k]) / (4 * w) for j, k in ((1, 2), (2, 0), (0, 1)))
        else:
            _, vectors = np.linalg.eigh(pose[:3, :3] + pose[:3, :3].T)
            (x, y, z), w = vectors[:, -1], 0.0
        tx, ty, tz = pose[:3, 3]
        return SimpleNamespace(qx=x, qy=y, qz=z, qw=w, tx=tx, ty=ty, tz=tz)


def test_iphone(frames, module, tmp_path):
    Phone.frames = frames
    module("record3d", Record3DStream=Phone)
    pipeline = example("iphone").main(tmp_path / "map.ply", FRAMES)
    assert pipeline.frames == FRAMES and len(pipeline.objects()) >= 3
    assert len(ss.FastSamSplat.load(tmp_path / "map.ply").objects()) >= 3
    expected = ss.FastSamSplat()
    for frame in frames:
        expected.step(frame.rgb, frame.depth, K=frame.K, camera_to_world=frame.camera_to_world)
    assert len(pipeline.objects()) == len(expected.objects())
    for found, wanted in zip(pipeline.objects(), expected.objects(), strict=True):
        np.testing.assert_allclose(found.shape.centroid, wanted.shape.centroid, atol=0.01)
