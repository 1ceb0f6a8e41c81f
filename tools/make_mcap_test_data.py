#!/usr/bin/env python3
"""Writes small recordings of ROS 2 messages in MCAP files, for `crates/dataset/tests/it/mcap.rs` and others.

    pip install mcap==1.6.0 mcap-ros2-support==0.6.0 rosbags==0.11.9 numpy pillow lz4        # in a virtual environment
    python tools/make_mcap_test_data.py crates/dataset/tests/data/mcap

    room.mcap        the first frames of the built-in clip (crates/splatseg-cli/demo), as a robot's camera records them: JPEG,
                     compressedDepth, camera infos, /tf and /tf_static. Written by mcap-ros2-support, zstd.
    encodings.mcap   one tiny picture and its depth in every encoding that is read, each a topic. mcap-ros2-support, lz4.
    bag/             a folder as rosbag2 writes it, with odometry in place of /tf. Written by rosbags, not compressed.

The room's poses are put together from transforms whose chain, interpolated at the images' stamps, gives the clip's.
"""

import argparse
import io
import shutil
import struct
from pathlib import Path

import numpy
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer
from PIL import Image
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

CLIP = Path(__file__).parents[1] / "crates/splatseg-cli/demo"
FRAMES = 4
START = 1_700_000_000_000_000_000
FRAME_NS = 200_000_000
STORE = get_typestore(Stores.ROS2_HUMBLE)


def definition(name):
    """The definition of a type, as recordings carry it."""
    return STORE.generate_msgdef(name, ros_version=2)[0]


def stamp(time):
    return {"sec": time // 10**9, "nanosec": time % 10**9}


def header(time, frame):
    return {"stamp": stamp(time), "frame_id": frame}


def quaternion(rotation):
    """(x, y, z, w) of a rotation matrix."""
    matrix = numpy.array(
        [
            [rotation[0, 0] - rotation[1, 1] - rotation[2, 2], 0, 0, 0],
            [rotation[0, 1] + rotation[1, 0], rotation[1, 1] - rotation[0, 0] - rotation[2, 2], 0, 0],
            [rotation[0, 2] + rotation[2, 0], rotation[1, 2] + rotation[2, 1], 0, 0],
            [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1], 0],
        ]
    )
    matrix[2, 2] = rotation[2, 2] - rotation[0, 0] - rotation[1, 1]
    matrix[3, 3] = numpy.trace(rotation)
    _, vectors = numpy.linalg.eigh(matrix)
    return vectors[:, -1]


def rotation_about(axis, angle):
    x, y, z = numpy.array(axis) / numpy.linalg.norm(axis)
    cross = numpy.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return numpy.eye(3) + numpy.sin(angle) * cross + (1 - numpy.cos(angle)) * cross @ cross


def rigid(rotation, translation):
    transform = numpy.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, translation
    return transform


def transform_message(time, parent, child, transform):
    x, y, z, w = map(float, quaternion(transform[:3, :3]))
    tx, ty, tz = map(float, transform[:3, 3])
    return {
        "header": header(time, parent),
        "child_frame_id": child,
        "transform": {"translation": {"x": tx, "y": ty, "z": tz}, "rotation": {"x": x, "y": y, "z": z, "w": w}},
    }


def info_message(time, frame, size, camera, model="plumb_bob", coefficients=(0.0,) * 5):
    fx, fy, cx, cy = camera
    return {
        "header": header(time, frame),
        "height": size[1],
        "width": size[0],
        "distortion_model": model,
        "d": list(coefficients),
        "k": [fx, 0, cx, 0, fy, cy, 0, 0, 1],
        "r": [1, 0, 0, 0, 1, 0, 0, 0, 1],
        "p": [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }


class Recording:
    """A recording that mcap-ros2-support writes."""

    def __init__(self, path, compression, chunk_size):
        self.file = open(path, "wb")  # noqa: SIM115
        self.writer = Writer(self.file, chunk_size=chunk_size, compression=compression)
        self.schemas = {}

    def write(self, topic, kind, message, time):
        if kind not in self.schemas:
            self.schemas[kind] = self.writer.register_msgdef(kind, definition(kind))
        self.writer.write_message(topic, self.schemas[kind], message, log_time=time, publish_time=time)

    def close(self):
        self.writer.finish()
        self.file.close()


def camera_of_clip():
    matrix = numpy.loadtxt(CLIP / "intrinsic/intrinsic_color.txt")
    return tuple(float(matrix[at]) for at in [(0, 0), (1, 1), (0, 2), (1, 2)])


def write_room(path):
    camera, size = camera_of_clip(), Image.open(CLIP / "depth/0.png").size
    optical = "camera_color_optical_frame"
    map_from_odom = rigid(rotation_about([0, 0, 1], 0.3), [1.0, -2.0, 0.0])
    base_from_link = rigid(rotation_about([0, 1, 0], 0.1), [0.2, 0.0, 0.5])
    link_from_optical = rigid(numpy.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), [0.0, 0.015, 0.0])
    recording = Recording(path, CompressionType.ZSTD, 64 * 1024)
    fixed = [
        transform_message(START, "base_link", "camera_link", base_from_link),
        transform_message(START, "camera_link", optical, link_from_optical),
    ]
    recording.write("/tf_static", "tf2_msgs/msg/TFMessage", {"transforms": fixed}, START)
    for frame in range(FRAMES):
        time = START + frame * FRAME_NS
        pose = numpy.loadtxt(CLIP / f"pose/{frame}.txt")
        base = numpy.linalg.inv(map_from_odom) @ pose @ numpy.linalg.inv(base_from_link @ link_from_optical)
        transforms = [transform_message(time, "map", "odom", map_from_odom)]
        if frame % 2 == 0:
            transforms.append(transform_message(time, "odom", "base_link", base))
        else:
            # Halfway between these two the base is where it should be.
            for side in (-1, 1):
                turned = base[:3, :3] @ rotation_about([1, 2, 3], 0.02 * side)
                moved = base[:3, 3] + numpy.array([0.01, 0.02, -0.01]) * side
                earlier = time + side * 40_000_000
                transforms.append(transform_message(earlier, "odom", "base_link", rigid(turned, moved)))
        for transform in transforms:
            recording.write("/tf", "tf2_msgs/msg/TFMessage", {"transforms": [transform]}, time)
        color = {"header": header(time, optical), "format": "rgb8; jpeg compressed bgr8"}
        color["data"] = (CLIP / f"color/{frame}.jpg").read_bytes()
        recording.write("/camera/color/image_raw/compressed", "sensor_msgs/msg/CompressedImage", color, time)
        depth_time = time + 3_000_000
        depth = {"header": header(depth_time, optical), "format": "16UC1; compressedDepth png"}
        depth["data"] = bytes(12) + best_png(Image.open(CLIP / f"depth/{frame}.png"))
        topic = "/camera/aligned_depth_to_color/image_raw/compressedDepth"
        recording.write(topic, "sensor_msgs/msg/CompressedImage", depth, depth_time)
        for topic, at in [
            ("/camera/color/camera_info", time),
            ("/camera/aligned_depth_to_color/camera_info", depth_time),
        ]:
            recording.write(topic, "sensor_msgs/msg/CameraInfo", info_message(at, optical, size, camera), at)
    recording.close()


def best_png(image):
    file = io.BytesIO()
    image.save(file, "png", optimize=True)
    return file.getvalue()


def rvl(numbers):
    """Width and height, then RVL as Wilson describes it."""
    nibbles, previous, flat, at = [], 0, numbers.flatten().tolist(), 0

    def put(number):
        while True:
            part, number = number & 7, number >> 3
            nibbles.append(part | (8 if number else 0))
            if not number:
                return

    while at < len(flat):
        for is_zero in (True, False):
            end = at
            while end < len(flat) and (flat[end] == 0) == is_zero:
                end += 1
            put(end - at)
            if not is_zero:
                for number in flat[at:end]:
                    difference, previous = number - previous, number
                    put(((difference << 1) ^ (difference >> 31)) & 0xFFFFFFFF)
            at = end
    nibbles += [0] * (-len(nibbles) % 8)
    words = [
        sum(nibble << (28 - 4 * place) for place, nibble in enumerate(nibbles[word : word + 8]))
        for word in range(0, len(nibbles), 8)
    ]
    height, width = numbers.shape
    return struct.pack("<II", width, height) + struct.pack(f"<{len(words)}I", *words)


WIDTH, HEIGHT = 16, 12


def picture():
    """RGB: red grows to the right, green downwards."""
    rows, columns = numpy.mgrid[0:HEIGHT, 0:WIDTH]
    return numpy.stack([16 * columns, 20 * rows, 0 * rows + 9], axis=-1).astype(numpy.uint8)


def millimetres():
    rows, columns = numpy.mgrid[0:HEIGHT, 0:WIDTH]
    depth = (1000 + columns + 100 * rows).astype(numpy.uint16)
    depth[0, 0] = 0
    return depth


def raw_image(time, frame, encoding, rows, big_endian=0, padding=0):
    data = [row.tobytes() + bytes(padding) for row in rows]
    return {
        "header": header(time, frame),
        "height": len(rows),
        "width": WIDTH,
        "encoding": encoding,
        "is_bigendian": big_endian,
        "step": len(data[0]),
        "data": b"".join(data),
    }


def yuv(order):
    """Grey that grows to the right, as pairs of pixels."""
    grey = numpy.array([[16 + 10 * column for column in range(WIDTH)]] * HEIGHT, dtype=numpy.uint8)
    rows = numpy.full((HEIGHT, WIDTH, 2), 128, dtype=numpy.uint8)
    rows[:, :, order] = grey
    return rows


def inverse_depth(depth_metres):
    """The numbers of compressedDepth for 32FC1 with the transport's default parameters, and the parameters."""
    a = numpy.float32(100 * 101)
    b = numpy.float32(1 - a / 10)
    numbers = numpy.where(depth_metres > 0, a / numpy.maximum(depth_metres, 1e-3) + b, 0).astype(numpy.uint16)
    return numbers, struct.pack("<iff", 0, a, b)


def write_encodings(path):
    frame, time = "camera", START
    color, depth = picture(), millimetres()
    metres = (depth / 1000).astype(numpy.float32)
    alpha = numpy.dstack([color, numpy.full((HEIGHT, WIDTH), 77, numpy.uint8)])
    numbers, parameters = inverse_depth(metres)
    png8, png16 = best_png(Image.fromarray(color)), best_png(Image.fromarray(depth))
    images = {
        "/rgb8": raw_image(time, frame, "rgb8", color, padding=5),
        "/bgr8": raw_image(time, frame, "bgr8", color[:, :, ::-1]),
        "/rgba8": raw_image(time, frame, "rgba8", alpha),
        "/bgra8": raw_image(time, frame, "bgra8", alpha[:, :, [2, 1, 0, 3]], padding=1),
        "/mono8": raw_image(time, frame, "mono8", color[:, :, 0]),
        "/yuv422": raw_image(time, frame, "yuv422", yuv(1)),
        "/yuv422_yuy2": raw_image(time, frame, "yuv422_yuy2", yuv(0)),
        "/bayer": raw_image(time, frame, "bayer_rggb8", color[:, :, 0]),
        "/depth/16UC1": raw_image(time, frame, "16UC1", depth, padding=3),
        "/depth/16UC1_big": raw_image(time, frame, "16UC1", depth.byteswap(), big_endian=1),
        "/depth/mono16": raw_image(time, frame, "mono16", depth),
        "/depth/32FC1": raw_image(time, frame, "32FC1", metres),
        "/depth/32FC1_big": raw_image(time, frame, "32FC1", metres.byteswap(), big_endian=1),
    }
    files = {
        "/png": ("rgb8; png compressed bgr8", png8),
        "/png_plain": ("png", png8),
        "/depth/png": ("16UC1; png compressed ", png16),
        "/depth/compressed_png": ("16UC1; compressedDepth png", bytes(12) + png16),
        "/depth/compressed_old": ("16UC1; compressedDepth", bytes(12) + png16),
        "/depth/compressed_rvl": ("16UC1; compressedDepth rvl", bytes(12) + rvl(depth)),
        "/depth/inverse_png": ("32FC1; compressedDepth png", parameters + best_png(Image.fromarray(numbers))),
        "/depth/inverse_rvl": ("32FC1; compressedDepth rvl", parameters + rvl(numbers)),
    }
    recording = Recording(path, CompressionType.LZ4, 4096)
    transform = rigid(numpy.eye(3), [1, 2, 3])
    recording.write(
        "/tf_static", "tf2_msgs/msg/TFMessage", {"transforms": [transform_message(time, "map", frame, transform)]}, time
    )
    info = info_message(time, frame, (WIDTH, HEIGHT), (20.0, 20.0, 7.5, 5.5))
    recording.write("/camera_info", "sensor_msgs/msg/CameraInfo", info, time)
    for topic, message in images.items():
        recording.write(topic, "sensor_msgs/msg/Image", message, time)
    for topic, (kind, data) in files.items():
        message = {"header": header(time, frame), "format": kind, "data": data}
        recording.write(topic, "sensor_msgs/msg/CompressedImage", message, time)
    recording.write("/chatter", "std_msgs/msg/String", {"data": "hello"}, time)
    recording.close()


def write_bag(folder):
    """Three frames of the tiny picture; the robot drives along x and its camera looks forward."""
    shutil.rmtree(folder, ignore_errors=True)
    types = STORE.types

    def ros(name, *values):
        return types[name](*values)

    def ros_header(time, frame):
        return ros("std_msgs/msg/Header", ros("builtin_interfaces/msg/Time", time // 10**9, time % 10**9), frame)

    def vector(name, values):
        return ros(f"geometry_msgs/msg/{name}", *map(float, values))

    with BagWriter(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        kinds = {
            "/rgb/image_raw": "sensor_msgs/msg/Image",
            "/depth_to_rgb/image_raw": "sensor_msgs/msg/Image",
            "/rgb/camera_info": "sensor_msgs/msg/CameraInfo",
            "/odom": "nav_msgs/msg/Odometry",
            "/tf_static": "tf2_msgs/msg/TFMessage",
        }
        connections = {topic: writer.add_connection(topic, kind, typestore=STORE) for topic, kind in kinds.items()}

        def write(topic, message, time):
            writer.write(connections[topic], time, STORE.serialize_cdr(message, kinds[topic]))

        x, y, z, w = quaternion(numpy.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]))
        transform = ros(
            "geometry_msgs/msg/Transform", vector("Vector3", [0.5, 0, 1]), vector("Quaternion", [x, y, z, w])
        )
        fixed = ros("geometry_msgs/msg/TransformStamped", ros_header(START, "base_link"), "rgb_camera_link", transform)
        write("/tf_static", ros("tf2_msgs/msg/TFMessage", [fixed]), START)
        color, depth = picture(), millimetres()
        for frame in range(3):
            time = START + frame * FRAME_NS
            for topic, encoding, pixels in [
                ("/rgb/image_raw", "rgb8", color),
                ("/depth_to_rgb/image_raw", "16UC1", depth),
            ]:
                step = pixels.strides[0]
                data = numpy.frombuffer(pixels.tobytes(), numpy.uint8)
                image = (ros_header(time, "rgb_camera_link"), HEIGHT, WIDTH, encoding, 0, step, data)
                write(topic, ros("sensor_msgs/msg/Image", *image), time)
            array = numpy.array
            info = (ros_header(time, "rgb_camera_link"), HEIGHT, WIDTH, "rational_polynomial", array([0.0] * 8))
            k, p = array([20, 0, 7.5, 0, 20, 5.5, 0, 0, 1.0]), array([20, 0, 7.5, 0, 0, 20, 5.5, 0, 0, 0, 1.0, 0])
            roi = ros("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
            message = ros("sensor_msgs/msg/CameraInfo", *info, k, numpy.eye(3).flatten(), p, 0, 0, roi)
            write("/rgb/camera_info", message, time)
            pose = ros("geometry_msgs/msg/Pose", vector("Point", [frame, 0, 0]), vector("Quaternion", [0, 0, 0, 1]))
            pose = ros("geometry_msgs/msg/PoseWithCovariance", pose, numpy.zeros(36))
            twist = ros("geometry_msgs/msg/Twist", vector("Vector3", [5, 0, 0]), vector("Vector3", [0, 0, 0]))
            twist = ros("geometry_msgs/msg/TwistWithCovariance", twist, numpy.zeros(36))
            odometry = ros("nav_msgs/msg/Odometry", ros_header(time, "odom"), "base_link", pose, twist)
            write("/odom", odometry, time)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    write_room(folder / "room.mcap")
    write_encodings(folder / "encodings.mcap")
    write_bag(folder / "bag")


if __name__ == "__main__":
    main()
