#!/usr/bin/env python3
"""Writes a scene in the layout of 7-Scenes as a recording of ROS 2 messages, as a camera would have recorded it.

    pip install mcap==1.6.0 mcap-ros2-support==0.6.0 rosbags==0.11.9 numpy pillow lz4        # in a virtual environment
    python tools/record_scene.py redkitchen_dense kitchen.mcap --rate 10
    splatseg live kitchen.mcap --map home.ply

Colour is rgb8, depth 16UC1 in millimetres, both with a camera info for colour, and the poses are in /tf.
"""

import argparse
from pathlib import Path

import numpy
from make_mcap_test_data import START, Recording, header, info_message, transform_message
from mcap.writer import CompressionType
from PIL import Image

OPTICAL = "camera_color_optical_frame"


def image_message(time, pixels, encoding):
    height, width = pixels.shape[:2]
    data = pixels.tobytes()
    return {
        "header": header(time, OPTICAL),
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": len(data) // height,
        "data": data,
    }


def write_frame(recording, stem, time, camera):
    color = numpy.asarray(Image.open(f"{stem}.color.jpg").convert("RGB"))
    depth = numpy.asarray(Image.open(f"{stem}.depth.png")).astype("<u2")
    # 65535 stands for no depth in 7-Scenes.
    depth = numpy.where(depth == 65535, 0, depth).astype("<u2")
    pose = transform_message(time, "map", OPTICAL, numpy.loadtxt(f"{stem}.pose.txt"))
    info = info_message(time, OPTICAL, (color.shape[1], color.shape[0]), camera)
    recording.write("/tf", "tf2_msgs/msg/TFMessage", {"transforms": [pose]}, time)
    recording.write("/camera/color/camera_info", "sensor_msgs/msg/CameraInfo", info, time)
    recording.write("/camera/color/image_raw", "sensor_msgs/msg/Image", image_message(time, color, "rgb8"), time)
    recording.write(
        "/camera/aligned_depth_to_color/image_raw", "sensor_msgs/msg/Image", image_message(time, depth, "16UC1"), time
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, help="folder with frame-000000.color.jpg and so on")
    parser.add_argument("recording", type=Path, help="file to write")
    parser.add_argument("--rate", type=float, default=30, help="frames per second")
    parser.add_argument("--frames", type=int, help="at most this many")
    arguments = parser.parse_args()
    matrix = numpy.loadtxt(arguments.scene / "camera-intrinsics.txt")
    camera = tuple(float(matrix[at]) for at in [(0, 0), (1, 1), (0, 2), (1, 2)])
    recording = Recording(arguments.recording, CompressionType.NONE, 1024 * 1024)
    for number, color in enumerate(sorted(arguments.scene.glob("*.color.jpg"))[: arguments.frames]):
        stem = str(color).removesuffix(".color.jpg")
        write_frame(recording, stem, START + int(number * 1e9 / arguments.rate), camera)
    recording.close()


if __name__ == "__main__":
    main()
