"""The camera examples run, on fakes with the signatures of their SDKs."""

import sys
from datetime import timedelta
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
import splatseg as ss
from test_examples import example

FRAMES = 6


@pytest.fixture
def frames():
    return list(ss.open_scene(f"synthetic:frames={FRAMES},width=96,height=72,objects=6"))


@pytest.fixture
def module(monkeypatch):
    def install(name, **contents):
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)

    return install


def check(pipeline, path):
    assert pipeline.frames == FRAMES and len(pipeline.objects()) >= 3
    assert len(ss.FastSamSplat.load(path).objects()) >= 3


def picture(array, **more):
    """An image of RealSense or Orbbec."""
    height, width = array.shape[:2]
    size = {"get_height": lambda: height, "get_width": lambda: width}
    return SimpleNamespace(get_data=lambda: array, get_timestamp=lambda: 1000.0, **size, **more)


def units(frame, per_metre):
    return np.round(frame.depth * per_metre).astype(np.uint16)


def test_realsense(frames, module, tmp_path):
    def pair(frame):
        fx, fy, ppx, ppy = frame.K[[0, 1, 0, 1], [0, 1, 2, 2]]
        lens = SimpleNamespace(intrinsics=SimpleNamespace(fx=fx, fy=fy, ppx=ppx, ppy=ppy))
        color = picture(frame.rgb, profile=SimpleNamespace(as_video_stream_profile=lambda: lens))
        depth = picture(units(frame, 4000))
        return SimpleNamespace(get_color_frame=lambda: color, get_depth_frame=lambda: depth)

    waiting, streams = iter(frames), []
    sensor = SimpleNamespace(get_depth_scale=lambda: 1 / 4000)
    profile = SimpleNamespace(get_device=lambda: SimpleNamespace(first_depth_sensor=lambda: sensor))
    module(
        "pyrealsense2",
        pipeline=lambda: SimpleNamespace(
            start=lambda config: profile,
            wait_for_frames=lambda: pair(next(waiting)),
            stop=lambda: streams.append("stop"),
        ),
        config=lambda: SimpleNamespace(enable_stream=lambda *stream: streams.append(stream)),
        align=lambda stream: SimpleNamespace(process=lambda pair: pair),
        stream=SimpleNamespace(color="color", depth="depth"),
        format=SimpleNamespace(rgb8="rgb8", z16="z16"),
    )
    check(example("realsense").main(tmp_path / "map.ply", FRAMES), tmp_path / "map.ply")
    assert [stream[0] for stream in streams[:2]] == ["color", "depth"] and streams[-1] == "stop"


def test_orbbec(frames, module, tmp_path):
    def pair(frame):
        color = picture(frame.rgb)
        depth = picture(units(frame, 2000), get_depth_scale=lambda: 0.5)
        images = SimpleNamespace(get_color_frame=lambda: color, get_depth_frame=lambda: depth)
        return SimpleNamespace(as_frame_set=lambda: images)

    # A camera that has no pair in time now and then.
    waiting = iter([None, *map(pair, frames)])
    fx, fy, cx, cy = frames[0].K[[0, 1, 0, 1], [0, 1, 2, 2]]
    profiles = SimpleNamespace(
        get_video_stream_profile=lambda width, height, kind, rate: "color",
        get_default_video_stream_profile=lambda: "depth",
    )
    camera = SimpleNamespace(
        get_stream_profile_list=lambda sensor: profiles,
        enable_frame_sync=lambda: None,
        start=lambda config: None,
        get_camera_param=lambda: SimpleNamespace(rgb_intrinsic=SimpleNamespace(fx=fx, fy=fy, cx=cx, cy=cy)),
        wait_for_frames=lambda milliseconds: next(waiting),
        stop=lambda: None,
    )
    module(
        "pyorbbecsdk",
        AlignFilter=lambda align_to_stream: SimpleNamespace(process=lambda pair: pair),
        Config=lambda: SimpleNamespace(enable_stream=lambda profile: None),
        OBFormat=SimpleNamespace(RGB="RGB"),
        OBSensorType=SimpleNamespace(COLOR_SENSOR="color", DEPTH_SENSOR="depth"),
        OBStreamType=SimpleNamespace(COLOR_STREAM="color"),
        Pipeline=lambda: camera,
    )
    check(example("orbbec").main(tmp_path / "map.ply", FRAMES + 1), tmp_path / "map.ply")


class OakPipeline:
    """Makes nodes that link to anything."""

    def __init__(self, frames):
        self.frames = iter(frames)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def create(self, kind):
        return kind(self)

    def start(self):
        pass

    def getDefaultDevice(self):
        calibration = SimpleNamespace(getCameraIntrinsics=lambda socket, width, height: self.K.tolist())
        return SimpleNamespace(readCalibration=lambda: calibration)

    def next(self):
        frame = next(self.frames)
        images = {"color": frame.rgb, "depth": units(frame, 1000)}
        time = timedelta(seconds=1)
        image = lambda array: SimpleNamespace(getFrame=lambda: array, getTimestamp=lambda: time)
        return {name: image(array) for name, array in images.items()}


def test_oak(frames, module, tmp_path):
    port = SimpleNamespace(link=lambda other: None)

    def camera(pipeline):
        outputs = lambda size, type, fps, enableUndistortion: port
        return SimpleNamespace(build=lambda socket: SimpleNamespace(requestOutput=outputs))

    def stereo(pipeline):
        return SimpleNamespace(build=lambda autoCreateCameras, size, fps: SimpleNamespace(depth=port))

    def sync(pipeline):
        queue = SimpleNamespace(get=pipeline.next)
        out = SimpleNamespace(createOutputQueue=lambda maxSize, blocking: queue)
        return SimpleNamespace(inputs={"color": port, "depth": port}, out=out)

    align = lambda pipeline: SimpleNamespace(input=port, inputAlignTo=port, outputAligned=port)
    OakPipeline.K = frames[0].K
    module(
        "depthai",
        Pipeline=lambda: OakPipeline(frames),
        CameraBoardSocket=SimpleNamespace(CAM_A="A"),
        ImgFrame=SimpleNamespace(Type=SimpleNamespace(RGB888i="RGB888i")),
        node=SimpleNamespace(Camera=camera, StereoDepth=stereo, ImageAlign=align, Sync=sync),
    )
    check(example("oak").main(tmp_path / "map.ply", FRAMES), tmp_path / "map.ply")


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
    check(pipeline, tmp_path / "map.ply")
    expected = ss.FastSamSplat()
    for frame in frames:
        expected.step(frame.rgb, frame.depth, K=frame.K, camera_to_world=frame.camera_to_world)
    assert len(pipeline.objects()) == len(expected.objects())
    for found, wanted in zip(pipeline.objects(), expected.objects(), strict=True):
        np.testing.assert_allclose(found.shape.centroid, wanted.shape.centroid, atol=0.01)
