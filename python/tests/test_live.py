"""A live session, fed with messages in CDR as rclpy's raw subscriptions give them, and the node on a fake of rclpy."""

import json
import struct
import sys
import threading
import time
from types import ModuleType, SimpleNamespace
from typing import ClassVar

import pytest
import splatseg as ss

COLOR, DEPTH, INFO = "/camera/color/image_raw", "/camera/depth/image_raw", "/camera/color/camera_info"
IMAGE, CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
START = 1_700_000_000


class Cdr:
    """Writes a message in CDR, little endian."""

    def __init__(self):
        self.data = bytearray()

    def put(self, kind, *values):
        size = struct.calcsize(kind)
        for value in values:
            self.data += bytes(-len(self.data) % size) + struct.pack(f"<{kind}", value)
        return self

    def text(self, text):
        self.put("I", len(text) + 1)
        self.data += text.encode() + b"\0"
        return self

    def header(self, index):
        return self.put("i", START + index // 10).put("I", index % 10 * 100_000_000).text("camera")

    def image(self, index, pixels, encoding):
        self.header(index).put("I", *pixels.shape[:2]).text(encoding).put("B", 0)
        self.put("I", pixels.strides[0], pixels.nbytes)
        self.data += pixels.tobytes()
        return self.bytes()

    def info(self, index, frame):
        height, width = frame.depth.shape
        self.header(index).put("I", height, width).text("plumb_bob").put("I", 0)
        k, r = frame.K.ravel(), [float(at % 4 == 0) for at in range(9)]
        self.put("d", *k, *r, *k[:3], 0, *k[3:6], 0, *k[6:], 0)
        return self.put("I", 0, 0, 0, 0, 0, 0).put("B", 0).bytes()

    def bytes(self):
        return b"\0\1\0\0" + bytes(self.data)


@pytest.fixture
def messages():
    """Topic, type and bytes of the messages of 12 frames."""
    frames = list(ss.open_scene("synthetic:frames=12,width=96,height=72,objects=6"))
    found = []
    for index, frame in enumerate(frames):
        millimetres = (1000 * frame.depth).round().astype("<u2")
        found.append((INFO, CAMERA_INFO, Cdr().info(index, frame)))
        found.append((COLOR, IMAGE, Cdr().image(index, frame.rgb, "rgb8")))
        found.append((DEPTH, IMAGE, Cdr().image(index, millimetres, "16UC1")))
    return found


TOPICS = {"dataset.color": COLOR, "dataset.depth": DEPTH, "dataset.pose": "none"}


def test_messages_in_objects_out(messages, tmp_path):
    path = tmp_path / "home.ply"
    with ss.Live(map=path, every_frame=True, **TOPICS) as live:
        live.subscribe("ids", "objects")
        assert live.wants(COLOR, IMAGE) and not live.wants("/chatter", "std_msgs/msg/String")
        ids = []
        for message in messages:
            live.feed(*message)
            ids += [data for output, data in live.messages() if output.name == "ids"]
        live.close(finish=True)
        last = {output.topic: data for output, data in live.messages()}
    assert ids and all(b"16UC1" in data for data in ids)
    assert live.frames == 12 and "12 frames" in live.status and len(live.sources) == 3
    (count,) = struct.unpack_from("<I", last["~/objects"], 4 + 8 + 4 + len("world") + 1 + 2)
    saved = ss.FastSamSplat.load(path)
    # Messages have the objects that count; the saved list has tentative ones apart.
    listed = json.loads(path.with_suffix(".objects.json").read_text())
    shown = [entry for entry in listed["objects"] if entry["shape"] is not None]
    assert count == len(shown) >= 3 and listed["not_counted"]
    with ss.Live(map=path, every_frame=True, **TOPICS) as again:
        assert {entry.id for entry in again.objects()} == {entry.id for entry in saved.objects()}
        assert again.pause() == "paused" and again.pause(False) == "running"


def test_mistakes_are_explained(tmp_path):
    with pytest.raises(TypeError, match="colour"):
        ss.Live(colour=COLOR)
    with pytest.raises(ValueError, match="save_interval"):
        ss.Live(save_interval=-1)
    with ss.Live() as live:
        with pytest.raises(ValueError, match="object"):
            live.subscribe("object")
        live.feed(COLOR, IMAGE, b"nonsense")
        with pytest.raises(RuntimeError, match="no file"):
            live.save()
    with pytest.raises(RuntimeError, match="ended"):
        live.reset()


class FakeNode:
    """The part of rclpy's Node that the node uses."""

    parameters: ClassVar = {}
    offered: ClassVar = {}

    def __init__(self, name, **options):
        self.subscriptions, self.published, self.services = {}, {}, {}

    def get_parameters_by_prefix(self, prefix):
        return {name: SimpleNamespace(value=value) for name, value in self.parameters.items()}

    def get_name(self):
        return "splatseg"

    def get_namespace(self):
        return "/"

    def get_logger(self):
        return SimpleNamespace(info=print, warning=print)

    def create_publisher(self, kind, topic, quality):
        messages = self.published.setdefault(topic, [])
        return SimpleNamespace(publish=messages.append, get_subscription_count=lambda: 1)

    def create_subscription(self, kind, topic, callback, quality, raw):
        assert raw
        self.subscriptions[topic] = (callback, quality)
        return topic

    def destroy_subscription(self, topic):
        del self.subscriptions[topic]

    def create_service(self, kind, name, callback):
        self.services[name] = callback

    def create_timer(self, seconds, callback):
        self.timer = callback

    def get_topic_names_and_types(self):
        return [(topic, [kind]) for topic, (kind, _) in self.offered.items()]

    def get_publishers_info_by_topic(self, topic):
        profile = SimpleNamespace(reliability=self.offered[topic][1], durability="VOLATILE")
        return [SimpleNamespace(qos_profile=profile, node_name="camera", node_namespace="/")]

    def destroy_node(self):
        pass


@pytest.fixture
def node_class(monkeypatch):
    policies = {
        "QoSProfile": lambda **policies: SimpleNamespace(**{"reliability": "RELIABLE", **policies}),
        "ReliabilityPolicy": SimpleNamespace(RELIABLE="RELIABLE", BEST_EFFORT="BEST_EFFORT"),
        "DurabilityPolicy": SimpleNamespace(VOLATILE="VOLATILE", TRANSIENT_LOCAL="TRANSIENT_LOCAL"),
    }
    modules = {
        "rclpy": {},
        "rclpy.node": {"Node": FakeNode},
        "rclpy.qos": policies,
        "std_srvs": {},
        "std_srvs.srv": {"SetBool": object, "Trigger": object},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"Image": object, "CameraInfo": object},
    }
    for name, contents in modules.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "splatseg.ros2_node", raising=False)
    from splatseg import ros2_node

    return ros2_node.SplatsegNode


def test_node(node_class, messages, tmp_path, monkeypatch):
    path = tmp_path / "home.ply"
    parameters = {"map": str(path), "color": COLOR, "depth": DEPTH, "pose": "none", "use_sim_time": False}
    monkeypatch.setattr(FakeNode, "parameters", {**parameters, "memory.max_votes": 6})
    offered = {COLOR: (IMAGE, "BEST_EFFORT"), DEPTH: (IMAGE, "RELIABLE"), INFO: (CAMERA_INFO, "RELIABLE")}
    monkeypatch.setattr(FakeNode, "offered", {**offered, "/chatter": ("std_msgs/msg/String", "RELIABLE")})
    node = node_class()
    node.timer()
    assert {topic: quality.reliability for topic, (_, quality) in node.subscriptions.items()} == {
        topic: reliability for topic, (_, reliability) in offered.items()
    }
    threads = threading.active_count()
    for topic, _, data in messages:
        node.subscriptions[topic][0](data)
        time.sleep(0.02)
    deadline = time.monotonic() + 10
    while not node.published["~/ids"] and time.monotonic() < deadline:
        time.sleep(0.02)
    assert node.published["~/ids"] and b"16UC1" in node.published["~/ids"][0]
    reply = node.services["~/save"](None, SimpleNamespace())
    assert reply.success and path.exists(), reply.message
    assert node.services["~/pause"](SimpleNamespace(data=True), SimpleNamespace()).message == "paused"
    node.destroy_node()
    assert threading.active_count() < threads
