"""A ROS 2 node with rclpy, for computers with ROS: any middleware, parameters, remapping, launch files.

    python -m splatseg.ros2_node --ros-args -p map:=home.ply -p world_frame:=map

``splatseg ros2`` is the same node without ROS. Messages pass through as bytes.
"""

from __future__ import annotations

import importlib
import threading
from functools import partial
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import SetBool, Trigger

from .live import OUTPUTS, Live, Output

DISCOVERY_S = 0.5
"""Seconds between two looks at the topics."""
IMAGES, OTHERS = 5, 100
"""Messages kept of a topic with images, and of one with other messages."""
RCLPY = {"start_type_description_service", "use_sim_time"}
"""Parameters of rclpy itself."""


def message_class(type_name: str) -> Any | None:
    """The class of a type such as ``sensor_msgs/msg/Image``; None if its package is not installed."""
    package, _, name = type_name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        return None


class SplatsegNode(Node):  # type: ignore[misc]  # rclpy has no types
    """Feeds a :class:`Live` session with the topics that it may use, and publishes its results."""

    def __init__(self, name: str = "splatseg", **options: Any) -> None:
        super().__init__(name, automatically_declare_parameters_from_overrides=True, **options)
        given = {
            name: parameter.value
            for name, parameter in self.get_parameters_by_prefix("").items()
            if name not in RCLPY and not name.startswith("qos_overrides.")
        }
        # Every parameter that is not one of these is a setting.
        named = {key: given.pop(key) for key in ("map", "save_interval", "config", "lag") if key in given}
        dataset = ("color", "depth", "camera_info", "depth_camera_info", "pose", "world_frame")
        self.live = Live(**named, **{f"dataset.{key}" if key in dataset else key: given[key] for key in given})
        self._inputs: dict[tuple[str, str], tuple[Any, tuple[bool, bool]]] = {}
        self._missing: set[str] = set()
        self._outputs = {output: publisher for output in OUTPUTS.values() if (publisher := self._publisher(output))}
        for request, call in (("save", self.live.save), ("load", self.live.load), ("reset", self.live.reset)):
            self.create_service(Trigger, f"~/{request}", partial(self._answer, lambda _, call=call: call()))
        self.create_service(SetBool, "~/pause", partial(self._answer, lambda request: self.live.pause(request.data)))
        self.create_timer(DISCOVERY_S, self._discover)
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._publish, name="publish", daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """Ends the session, which saves the map, and the node."""
        try:
            self.live.close()
        finally:
            self._is_over.set()
            self._thread.join()
            super().destroy_node()

    def _class(self, type_name: str) -> Any | None:
        kind = message_class(type_name)
        if kind is None and type_name not in self._missing:
            self._missing.add(type_name)
            self.get_logger().warning(f"{type_name}: not installed, so its topics are left out")
        return kind

    def _publisher(self, output: Output) -> Any | None:
        kind = self._class(output.type)
        durability = DurabilityPolicy.TRANSIENT_LOCAL if output.latched else DurabilityPolicy.VOLATILE
        return kind and self.create_publisher(kind, output.topic, QoSProfile(depth=1, durability=durability))

    def _discover(self) -> None:
        """Subscribes to topics that may be used, with the best quality of service that all publishers offer."""
        for topic, types in self.get_topic_names_and_types():
            for type_name in types:
                key = (topic, type_name)
                if not self.live.wants(*key):
                    if known := self._inputs.pop(key, None):
                        self.destroy_subscription(known[0])
                    continue
                own = (self.get_name(), self.get_namespace())
                offered = [
                    info.qos_profile
                    for info in self.get_publishers_info_by_topic(topic)
                    if (info.node_name, info.node_namespace) != own
                ]
                if offered and (kind := self._class(type_name)):
                    self._subscribe(key, kind, offered)
        self.live.subscribe(
            *(output.name for output, publisher in self._outputs.items() if publisher.get_subscription_count())
        )

    def _subscribe(self, key: tuple[str, str], kind: Any, offered: list[QoSProfile]) -> None:
        topic, type_name = key
        is_image = type_name.endswith("Image")
        reliable = all(profile.reliability != ReliabilityPolicy.BEST_EFFORT for profile in offered)
        latched = not is_image and all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in offered)
        known = self._inputs.get(key)
        if known and known[1] == (reliable, latched):
            return
        if known:
            self.destroy_subscription(known[0])
        quality = QoSProfile(
            depth=IMAGES if is_image else OTHERS,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        feed = partial(self.live.feed, topic, type_name)
        self._inputs[key] = self.create_subscription(kind, topic, feed, quality, raw=True), (reliable, latched)
        self.get_logger().info(f"{topic}: {type_name}, {'reliable' if reliable else 'best effort'}")

    def _publish(self) -> None:
        while not self._is_over.is_set():
            for output, message in self.live.messages(timeout=0.1):
                if publisher := self._outputs.get(output):
                    publisher.publish(message)

    def _answer(self, call: Any, request: Any, response: Any) -> Any:
        try:
            response.success, response.message = True, call(request)
        except RuntimeError as error:
            response.success, response.message = False, str(error)
        return response


def main() -> None:
    """Runs the node until it is interrupted."""
    rclpy.init()
    node = SplatsegNode()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        print(node.live.status)
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
