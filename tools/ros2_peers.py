#!/usr/bin/env python3
"""ROS 2 peers from PyPI for `splatseg ros2`: a camera that publishes a scene in the layout of 7-Scenes, and a reader that
measures latency and compares boxes with objects.json and free space with an exported grid. No ROS is needed; see docs/LIVE.md for the measurements.

    pip install cyclonedds==11.0.1 numpy pillow                      # one virtual environment: cyclone, watch
    pip install ros-rclpy==9.1.2 ros-rmw-fastrtps-cpp ros-sensor-msgs numpy pillow   # another one: rclpy
    tools/ros2_peers.py cyclone SCENE --rate 10        # images, camera info, /tf, from Cyclone DDS
    tools/ros2_peers.py rclpy SCENE --rate 10          # images and camera info, from rclpy (its wheels lack tf2_msgs)
    tools/ros2_peers.py watch --seconds 40 --objects home.objects.json
    tools/ros2_peers.py services                       # calls save, pause and get_parameters (rclpy)
"""

import argparse
import json
import os
import time
from pathlib import Path

import numpy
from PIL import Image as Picture

OPTICAL = "camera_color_optical_frame"
COLOR = "/camera/color/image_raw"
DEPTH = "/camera/aligned_depth_to_color/image_raw"
INFO = "/camera/color/camera_info"
# Cyclone DDS on loopback only.
LOOPBACK = (
    '<CycloneDDS><Domain><General><Interfaces><NetworkInterface name="lo" multicast="true"/></Interfaces></General>'
    "</Domain></CycloneDDS>"
)


def frames(scene, count, width):
    """Colour, depth (millimetres) and camera-to-world of each frame."""
    for color in sorted(scene.glob("frame-*.color.jpg"))[:count]:
        stem = str(color).removesuffix(".color.jpg")
        image = Picture.open(color).convert("RGB")
        depth = Picture.open(f"{stem}.depth.png")
        if width:
            size = (width, image.height * width // image.width)
            image, depth = image.resize(size), depth.resize(size, Picture.Resampling.NEAREST)
        depth = numpy.asarray(depth).astype("<u2")
        # 65535 stands for no depth in 7-Scenes.
        yield (
            numpy.asarray(image),
            numpy.where(depth == 65535, 0, depth).astype("<u2"),
            numpy.loadtxt(f"{stem}.pose.txt"),
        )


def intrinsics(scene, scale):
    matrix = numpy.loadtxt(scene / "camera-intrinsics.txt")[:3, :3] * scale
    matrix[2, 2] = 1
    return matrix


def quaternion(rotation):
    """x, y, z, w of a rotation matrix."""
    trace = numpy.trace(rotation)
    if trace > 0:
        s = 2 * numpy.sqrt(trace + 1)
        parts = [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
        return [part / s for part in parts] + [s / 4]
    i = int(numpy.argmax(numpy.diag(rotation)))
    j, k = (i + 1) % 3, (i + 2) % 3
    s = 2 * numpy.sqrt(1 + rotation[i, i] - rotation[j, j] - rotation[k, k])
    turn = [0.0] * 4
    turn[i], turn[j], turn[k] = s / 4, (rotation[j, i] + rotation[i, j]) / s, (rotation[k, i] + rotation[i, k]) / s
    turn[3] = (rotation[k, j] - rotation[j, k]) / s
    return turn


def paced(items, rate):
    """Gives an item and its stamp at a rate; (stamps in seconds and nanoseconds)."""
    due = time.monotonic()
    for item in items:
        yield item, divmod(time.time_ns(), 10**9)
        due += 1 / rate
        time.sleep(max(0, due - time.monotonic()))


def repeated(prepared, arguments):
    """Frames in the order in which they are published."""
    for time_around in range(arguments.repeat):
        yield from reversed(prepared) if arguments.back_and_forth and time_around % 2 else prepared


def cyclone(arguments):
    import ros2_peer_types as types

    os.environ["CYCLONEDDS_URI"] = LOOPBACK
    node = types.Peer()
    images = {"reliable": not arguments.best_effort, "depth": 5}
    color, depth = (node.writer(topic, types.Image, **images) for topic in (COLOR, DEPTH))
    info, tf = node.writer(INFO, types.CameraInfo, **images), node.writer("/tf", types.TFMessage, depth=100)
    prepared = []
    for rgb, millimetres, pose in frames(arguments.scene, arguments.frames, arguments.width):
        height, width = millimetres.shape
        matrix = intrinsics(arguments.scene, width / 640)
        messages = [
            (tf, types.tf_message("map", OPTICAL, pose[:3, 3], quaternion(pose[:3, :3])), 8),
            (info, types.camera_info(OPTICAL, width, height, matrix), 4),
            (color, types.image(OPTICAL, rgb, "rgb8"), 4),
            (depth, types.image(OPTICAL, millimetres, "16UC1"), 4),
        ]
        # Cyclone's Python takes 60 ms to serialise a frame; a camera's driver does not.
        prepared.append([(writer, types.Serialized(message, at)) for writer, message, at in messages])
    print(f"{len(prepared)} frames", flush=True)
    time.sleep(2)
    for messages, stamp in paced(repeated(prepared, arguments), arguments.rate):
        for writer, message in messages:
            writer.write(message.at(stamp))
    time.sleep(2)


def rclpy(arguments):
    from array import array

    import rclpy
    from rclpy.qos import QoSProfile, ReliabilityPolicy
    from sensor_msgs.msg import CameraInfo, Image

    rclpy.init()
    node = rclpy.create_node("camera")
    reliability = ReliabilityPolicy.BEST_EFFORT if arguments.best_effort else ReliabilityPolicy.RELIABLE
    quality = QoSProfile(depth=5, reliability=reliability)
    publishers = [
        node.create_publisher(kind, topic, quality)
        for topic, kind in ((INFO, CameraInfo), (COLOR, Image), (DEPTH, Image))
    ]
    prepared = []
    for rgb, millimetres, _ in frames(arguments.scene, arguments.frames, arguments.width):
        height, width = millimetres.shape
        matrix = intrinsics(arguments.scene, width / 640)
        info = CameraInfo(height=height, width=width, distortion_model="plumb_bob", d=[0.0] * 5)
        info.k, info.r = [float(number) for number in matrix.ravel()], [float(i % 4 == 0) for i in range(9)]
        info.p = [float(number) for number in numpy.hstack([matrix, numpy.zeros((3, 1))]).ravel()]
        images = []
        for pixels, encoding in ((rgb, "rgb8"), (millimetres, "16UC1")):
            image = Image(height=height, width=width, encoding=encoding, step=pixels.strides[0])
            image.data = array("B", pixels.tobytes())
            images.append(image)
        prepared.append([info, *images])
    print(f"{len(prepared)} frames", flush=True)
    time.sleep(2)
    for messages, (seconds, nanoseconds) in paced(repeated(prepared, arguments), arguments.rate):
        for publisher, message in zip(publishers, messages, strict=True):
            message.header.frame_id = OPTICAL
            message.header.stamp.sec, message.header.stamp.nanosec = seconds, nanoseconds
            publisher.publish(message)
    time.sleep(2)


def watch(arguments):
    import ros2_peer_types as types

    os.environ["CYCLONEDDS_URI"] = LOOPBACK
    node = types.Peer()
    objects = node.reader("/splatseg/objects", types.Detection3DArray, latched=True, depth=1)
    maps = node.reader("/splatseg/map", types.OccupancyGrid, latched=True, depth=1)
    ids = node.reader("/splatseg/ids", types.Image)
    diagnostics = node.reader("/diagnostics", types.DiagnosticArray)
    latencies, latest, status, grids = [], None, None, []
    end = time.monotonic() + arguments.seconds
    while time.monotonic() < end:
        for message in types.taken(ids):
            stamp = message.header.stamp
            latencies.append((time.time_ns() - stamp.sec * 10**9 - stamp.nanosec) / 1e6)
        latest = (types.taken(objects) or [latest])[-1]
        grids += types.taken(maps)
        status = (types.taken(diagnostics) or [status])[-1]
        time.sleep(0.001)
    if latencies:
        median, late, longest = numpy.percentile(latencies, [50, 95, 100])
        print(
            f"{len(latencies)} id images; from stamp to receipt: median {median:.0f} ms, 95 % {late:.0f} ms, "
            f"longest {longest:.0f} ms"
        )
    if status:
        print("; ".join(f"{value.key} {value.value}" for value in status.status[0].values))
    if grids:
        print(f"{len(grids)} maps, the last one in {grids[-1].header.frame_id} of {len(grids[-1].data)} cells")
        if arguments.grid:
            compare_grid(grids[-1], arguments.grid)
    if latest and arguments.objects:
        listed = json.loads(arguments.objects.read_text())
        compare(latest, listed["objects"])


def compare(message, objects):
    """Boxes read from the topic and from objects.json."""
    boxes = {}
    for item in objects:
        if item.get("shape"):
            box = item["shape"]["oriented_box"]
            boxes[str(item["id"])] = [*box["center"], *box["size"], *box["rotation"]]
    received = {}
    for item in message.detections:
        place, turn, size = item.bbox.center.position, item.bbox.center.orientation, item.bbox.size
        received[item.id] = [place.x, place.y, place.z, size.x, size.y, size.z, turn.x, turn.y, turn.z, turn.w]
    same = [key for key in boxes if key in received and numpy.allclose(boxes[key], received[key], atol=1e-6)]
    print(f"{len(received)} boxes received, {len(boxes)} in the file, {len(same)} equal")


def compare_grid(message, pgm):
    """Cells read from the topic and from the image of `export --as occupancy`."""
    pixels = numpy.asarray(Picture.open(pgm))[::-1]
    cells = numpy.select([pixels == 254, pixels == 0], [0, 100], -1)
    received = numpy.array(message.data).reshape(message.info.height, message.info.width)
    same = received.shape == cells.shape and (received == cells).all()
    counts = [int((received == value).sum()) for value in (0, 100, -1)]
    print(f"the map is {'equal to' if same else 'NOT'} that of {pgm}; free, occupied, unknown: {counts}")


def services(_):
    import rclpy
    from rcl_interfaces.srv import GetParameters
    from std_srvs.srv import SetBool, Trigger

    rclpy.init()
    node = rclpy.create_node("caller")

    def call(kind, name, request):
        client = node.create_client(kind, f"/splatseg/{name}")
        if not client.wait_for_service(timeout_sec=5):
            raise SystemExit(f"/splatseg/{name}: not there")
        started, future = time.monotonic(), client.call_async(request)
        rclpy.spin_until_future_complete(node, future, timeout_sec=25)
        print(f"{name}: {(time.monotonic() - started) * 1e3:.0f} ms, {future.result()}")

    call(Trigger, "save", Trigger.Request())
    for data in (True, False):
        call(SetBool, "pause", SetBool.Request(data=data))
    call(GetParameters, "get_parameters", GetParameters.Request(names=["memory.max_gaussians", "use_sim_time"]))
    print("nodes:", node.get_node_names(), "topics:", [name for name, _ in node.get_topic_names_and_types()])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for name, command in (("cyclone", cyclone), ("rclpy", rclpy)):
        peer = commands.add_parser(name)
        peer.set_defaults(command=command)
        peer.add_argument("scene", type=Path, help="folder with frame-000000.color.jpg and so on")
        peer.add_argument("--rate", type=float, default=10, help="frames per second")
        peer.add_argument("--frames", type=int, help="at most this many")
        peer.add_argument("--repeat", type=int, default=1, help="publish them this many times")
        peer.add_argument("--back-and-forth", action="store_true", help="every second time in reverse, without a jump")
        peer.add_argument("--width", type=int, help="resize the images to this width")
        peer.add_argument("--best-effort", action="store_true", help="offer images and camera info as best effort")
    reader = commands.add_parser("watch")
    reader.set_defaults(command=watch)
    reader.add_argument("--seconds", type=float, default=30)
    reader.add_argument("--grid", type=Path, help="compare the last map with this PGM file")
    reader.add_argument("--objects", type=Path, help="compare the last boxes with this file")
    commands.add_parser("services").set_defaults(command=services)
    arguments = parser.parse_args()
    arguments.command(arguments)


if __name__ == "__main__":
    main()
