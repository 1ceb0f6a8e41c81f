#!/usr/bin/env python3
"""Writes the same few messages in every container of recordings, for `crates/dataset/tests/it/containers.rs`.

    pip install rosbags==0.11.9 numpy pillow        # in a virtual environment
    python tools/make_bag_test_data.py crates/dataset/tests/data/recordings

    room.mcap        as rosbag2 writes it, not compressed
    room.db3         SQLite of rosbag2
    db3_file/        compressed as a file: room.db3.zstd
    db3_message/     each message compressed
    db3_split/       in two files
    room.bag         ROS 1, not compressed
    room_lz4.bag, room_bz2.bag

With `--scene SCENE` it writes a scene in the layout of ScanNet instead, as kitchen.mcap, kitchen.db3 and kitchen.bag, with
colour as stored. `SPLATSEG_SCENE=SCENE SPLATSEG_RECORDINGS=FOLDER cargo test -p splatseg-dataset --test it containers` then
compares their frames with those of the scene.

All are written by the package rosbags, in ROS 2's types of Humble and ROS 1's of Noetic. A camera moves on a circle; it is in
/tf, and as odometry, poses, a transform and a path in topics of their own.
"""

import argparse
import io
import shutil
from pathlib import Path

import numpy
from make_mcap_test_data import FRAME_NS, START, quaternion, rigid, rotation_about
from PIL import Image
from rosbags.rosbag1 import Writer as BagWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Bag2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

WIDTH, HEIGHT = 48, 36
FRAMES = 4
OPTICAL = "camera_color_optical_frame"
TF = "tf2_msgs/msg/TFMessage"
STORES = {1: get_typestore(Stores.ROS1_NOETIC), 2: get_typestore(Stores.ROS2_HUMBLE)}
STORES[1].register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", TF))


class Messages:
    """Makes messages of ROS 1 or ROS 2."""

    def __init__(self, version):
        self.version = version
        self.store = STORES[version]

    def make(self, name, *values):
        return self.store.types[name](*values)

    def header(self, time, frame):
        stamp = self.make("builtin_interfaces/msg/Time", int(time // 10**9), int(time % 10**9))
        sequence = [7] if self.version == 1 else []
        return self.make("std_msgs/msg/Header", *sequence, stamp, frame)

    def vector(self, name, values):
        return self.make(f"geometry_msgs/msg/{name}", *map(float, values))

    def transform(self, time, parent, child, matrix):
        turn = self.vector("Quaternion", quaternion(matrix[:3, :3]))
        transform = self.make("geometry_msgs/msg/Transform", self.vector("Vector3", matrix[:3, 3]), turn)
        return self.make("geometry_msgs/msg/TransformStamped", self.header(time, parent), child, transform)

    def tf(self, *transforms):
        return self.make(TF, list(transforms))

    def pose(self, matrix):
        turn = self.vector("Quaternion", quaternion(matrix[:3, :3]))
        return self.make("geometry_msgs/msg/Pose", self.vector("Point", matrix[:3, 3]), turn)

    def pose_with_covariance(self, matrix):
        return self.make("geometry_msgs/msg/PoseWithCovariance", self.pose(matrix), numpy.arange(36.0))

    def odometry(self, time, matrix):
        zero = self.vector("Vector3", [0, 0, 0])
        twist = self.make("geometry_msgs/msg/Twist", zero, zero)
        twist = self.make("geometry_msgs/msg/TwistWithCovariance", twist, numpy.zeros(36))
        pose = self.pose_with_covariance(matrix)
        return self.make("nav_msgs/msg/Odometry", self.header(time, "map"), OPTICAL, pose, twist)

    def info(self, time, size, camera, model="plumb_bob", lens=(0.0,) * 5):
        fx, fy, cx, cy = camera
        k = numpy.array([fx, 0, cx, 0, fy, cy, 0, 0, 1.0])
        p = numpy.array([fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1.0, 0])
        roi = self.make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False)
        start = (self.header(time, OPTICAL), size[1], size[0], model, numpy.array(lens, dtype=float))
        return self.make("sensor_msgs/msg/CameraInfo", *start, k, numpy.eye(3).flatten(), p, 0, 0, roi)

    def image(self, time, pixels, encoding):
        data = numpy.frombuffer(pixels.tobytes(), numpy.uint8)
        size = (pixels.shape[0], pixels.shape[1])
        return self.make(
            "sensor_msgs/msg/Image", self.header(time, OPTICAL), *size, encoding, 0, len(data) // size[0], data
        )

    def compressed(self, time, kind, data):
        data = numpy.frombuffer(data, numpy.uint8)
        return self.make("sensor_msgs/msg/CompressedImage", self.header(time, OPTICAL), kind, data)


def pictures(frame):
    rows, columns = numpy.mgrid[0:HEIGHT, 0:WIDTH]
    color = numpy.stack([5 * columns, 7 * rows, 0 * rows + 9 + frame], axis=-1).astype(numpy.uint8)
    depth = (1000 + columns + 50 * rows + 100 * frame).astype(numpy.uint16)
    depth[0, 0] = 0
    return color, depth


def png(pixels):
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "png", optimize=True)
    return file.getvalue()


def pose_of(frame):
    angle = 0.1 * frame
    return rigid(rotation_about([1, 2, 3], angle), [numpy.cos(angle), numpy.sin(angle), 0.5])


def messages(make, frames):
    """Yields the topic, the message and the time of each message."""
    camera = (40.0, 41.0, 23.5, 17.25)
    at = START
    fixed = make.transform(at, "base", OPTICAL, rigid(rotation_about([0, 1, 0], 0.3), [0.1, 0, 0.2]))
    yield "/tf_static", make.tf(fixed), at
    base = numpy.linalg.inv(rigid(rotation_about([0, 1, 0], 0.3), [0.1, 0, 0.2]))
    for frame in frames:
        time, pose = START + frame * FRAME_NS, pose_of(frame)
        color, depth = pictures(frame)
        moving = [make.transform(time, "map", "base", pose @ base), make.transform(time, "map", "tag", numpy.eye(4))]
        yield "/tf", make.tf(*moving), time
        yield "/odom", make.odometry(time, pose), time
        stamped = make.make("geometry_msgs/msg/PoseStamped", make.header(time, "map"), make.pose(pose))
        yield "/pose", stamped, time
        covariance = make.pose_with_covariance(pose)
        name = "geometry_msgs/msg/PoseWithCovarianceStamped"
        yield "/pose_with_covariance", make.make(name, make.header(time, "map"), covariance), time
        yield "/transform", make.transform(time, "map", OPTICAL, pose), time
        yield "/path", make.make("nav_msgs/msg/Path", make.header(time, "map"), [stamped]), time
        yield "/camera/color/camera_info", make.info(time, (WIDTH, HEIGHT), camera), time
        yield "/camera/color/image_raw", make.image(time, color, "rgb8"), time
        yield "/camera/color/image_raw/compressed", make.compressed(time, "rgb8; png compressed bgr8", png(color)), time
        late = time + 3_000_000
        yield "/camera/depth/camera_info", make.info(late, (WIDTH, HEIGHT), camera), late
        yield "/camera/depth/image_raw", make.image(late, depth, "16UC1"), late
        yield "/chatter", make.make("std_msgs/msg/String", "hello"), late
        yield "/number", make.make("std_msgs/msg/Float64", 0.5), late


def scene_messages(make, scene):
    """As `messages`, of a scene in the layout of ScanNet."""
    matrix = numpy.loadtxt(scene / "intrinsic/intrinsic_color.txt")
    camera = tuple(float(matrix[at]) for at in [(0, 0), (1, 1), (0, 2), (1, 2)])
    stems = sorted((int(path.stem), path) for path in (scene / "color").iterdir())
    for frame, path in stems:
        time = START + frame * FRAME_NS
        depth = numpy.asarray(Image.open(scene / f"depth/{frame}.png")).astype(numpy.uint16)
        pose = numpy.loadtxt(scene / f"pose/{frame}.txt")
        yield "/tf", make.tf(make.transform(time, "map", OPTICAL, pose)), time
        yield "/camera/camera_info", make.info(time, (depth.shape[1], depth.shape[0]), camera), time
        yield "/camera/color/compressed", make.compressed(time, "jpeg", path.read_bytes()), time
        yield "/camera/depth", make.image(time, depth, "16UC1"), time


def write_all(writer, make, stream):
    connections = {}
    for topic, message, time in stream:
        kind = message.__msgtype__
        if topic not in connections:
            connections[topic] = writer.add_connection(topic, kind, typestore=make.store)
        serialize = make.store.serialize_ros1 if make.version == 1 else make.store.serialize_cdr
        writer.write(connections[topic], time, serialize(message, kind))


def write_rosbag2(folder, plugin, stream, mode=None):
    shutil.rmtree(folder, ignore_errors=True)
    writer = Bag2Writer(folder, version=9, storage_plugin=plugin)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        write_all(writer, Messages(2), stream)
    return folder


def write_bag(path, stream, compression=None):
    path.unlink(missing_ok=True)
    writer = BagWriter(path)
    if compression is not None:
        writer.set_compression(compression)
    writer.chunk_threshold = 16 * 1024
    with writer:
        write_all(writer, Messages(1), stream)


def move_out(folder, ending, to):
    """Keeps only the file of a recording in a folder."""
    (found,) = folder.glob(f"*{ending}")
    found.replace(to)
    shutil.rmtree(folder)


def write_split(folder):
    first = write_rosbag2(folder.with_name("first"), StoragePlugin.SQLITE3, messages(Messages(2), range(2)))
    later = (part for part in messages(Messages(2), range(2, FRAMES)) if part[0] != "/tf_static")
    second = write_rosbag2(folder.with_name("second"), StoragePlugin.SQLITE3, later)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for number, part in enumerate([first, second]):
        (part / "metadata.yaml").replace(folder / "metadata.yaml")
        move_out(part, ".db3", folder / f"db3_split_{number}.db3")


def write_tests(folder):
    def stream(version):
        return messages(Messages(version), range(FRAMES))

    move_out(write_rosbag2(folder / "tmp", StoragePlugin.MCAP, stream(2)), ".mcap", folder / "room.mcap")
    move_out(write_rosbag2(folder / "tmp", StoragePlugin.SQLITE3, stream(2)), ".db3", folder / "room.db3")
    write_rosbag2(folder / "db3_file", StoragePlugin.SQLITE3, stream(2), CompressionMode.FILE)
    write_rosbag2(folder / "db3_message", StoragePlugin.SQLITE3, stream(2), CompressionMode.MESSAGE)
    write_split(folder / "db3_split")
    formats = BagWriter.CompressionFormat
    write_bag(folder / "room.bag", stream(1))
    write_bag(folder / "room_lz4.bag", stream(1), formats.LZ4)
    write_bag(folder / "room_bz2.bag", stream(1), formats.BZ2)


def write_scene(folder, scene):
    for plugin, ending in [(StoragePlugin.MCAP, ".mcap"), (StoragePlugin.SQLITE3, ".db3")]:
        written = write_rosbag2(folder / "tmp", plugin, scene_messages(Messages(2), scene))
        move_out(written, ending, folder / f"kitchen{ending}")
    write_bag(folder / "kitchen.bag", scene_messages(Messages(1), scene), BagWriter.CompressionFormat.LZ4)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scene", type=Path, help="a scene in the layout of ScanNet, to write as recordings")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.scene is None:
        write_tests(arguments.folder)
    else:
        write_scene(arguments.folder, arguments.scene)


if __name__ == "__main__":
    main()
