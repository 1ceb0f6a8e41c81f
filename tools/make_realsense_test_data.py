#!/usr/bin/env python3
"""Writes a small recording with RealSense's own SDK, for `crates/dataset/tests/it/realsense.rs`.

    pip install pyrealsense2==2.56.5.9235 numpy        # in a virtual environment; needs libusb-1.0
    python tools/make_realsense_test_data.py crates/dataset/tests/data/recordings/realsense_2.56.bag
    pip install pyrealsense2==2.58.1.10581
    python tools/make_realsense_test_data.py crates/dataset/tests/data/recordings/realsense_2.58.db3
    pip install pyrealsense2==2.59.1.11053
    python tools/make_realsense_test_data.py crates/dataset/tests/data/recordings/realsense_2.59.db3

A software device has a depth and a colour camera, 15 mm apart and turned by 0.02 about y. Depth is in units of 0.5 mm.
Versions up to 2.57 write ROS 1, later ones SQLite: 2.58 raw images, and camera infos and extrinsics as text; 2.59 PNG, and
ROS's messages for them.
"""

import argparse
import time

import numpy
import pyrealsense2 as rs

COLOR, DEPTH = (32, 24), (24, 16)
FRAMES = 3
UNIT_M = 0.0005


def intrinsics(size, focal):
    camera = rs.intrinsics()
    camera.width, camera.height = size
    camera.fx = camera.fy = focal
    camera.ppx, camera.ppy = (size[0] - 1) / 2, (size[1] - 1) / 2
    camera.model, camera.coeffs = rs.distortion.none, [0] * 5
    return camera


def stream(sensor, kind, number, size, bytes_per_pixel, pixel_format, focal):
    video = rs.video_stream()
    video.type, video.index, video.uid = kind, 0, number
    video.width, video.height = size
    video.fps, video.bpp, video.fmt = 30, bytes_per_pixel, pixel_format
    video.intrinsics = intrinsics(size, focal)
    return sensor.add_video_stream(video)


def extrinsics():
    turn = numpy.array([[numpy.cos(0.02), 0, numpy.sin(0.02)], [0, 1, 0], [-numpy.sin(0.02), 0, numpy.cos(0.02)]])
    between = rs.extrinsics()
    between.rotation = [float(value) for value in turn.T.flatten()]
    between.translation = [0.015, 0.002, -0.001]
    return between


def send(sensor, profile, number, at_ms, pixels):
    frame = rs.software_video_frame()
    frame.bpp = pixels.nbytes // (pixels.shape[0] * pixels.shape[1])
    frame.stride = frame.bpp * pixels.shape[1]
    frame.timestamp, frame.domain, frame.frame_number = at_ms, rs.timestamp_domain.system_time, number + 1
    frame.profile = profile.as_video_stream_profile()
    if frame.bpp == 2:
        frame.depth_units = UNIT_M
    frame.pixels = pixels
    sensor.on_video_frame(frame)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("recording")
    device = rs.software_device()
    depth_sensor, color_sensor = device.add_sensor("Depth"), device.add_sensor("Color")
    depth = stream(depth_sensor, rs.stream.depth, 0, DEPTH, 2, rs.format.z16, 20.0)
    color = stream(color_sensor, rs.stream.color, 1, COLOR, 3, rs.format.rgb8, 30.0)
    depth_sensor.add_read_only_option(rs.option.depth_units, UNIT_M)
    depth.register_extrinsics_to(color, extrinsics())
    recorder = rs.recorder(parser.parse_args().recording, device)
    queue = rs.frame_queue(50)
    sensors = recorder.query_sensors()
    for sensor, profile in zip(sensors, [depth, color], strict=True):
        sensor.open(profile)
        sensor.start(queue)
    for number in range(FRAMES):
        rows, columns = numpy.mgrid[0 : DEPTH[1], 0 : DEPTH[0]]
        pixels = (2000 + 10 * columns + 20 * rows + 50 * number).astype(numpy.uint16)
        send(depth_sensor, depth, number, 1000 + 33.0 * number, pixels)
        rows, columns = numpy.mgrid[0 : COLOR[1], 0 : COLOR[0]]
        pixels = numpy.stack([8 * columns, 10 * rows, 0 * rows + 9 + number], axis=-1).astype(numpy.uint8)
        send(color_sensor, color, number, 1001 + 33.0 * number, pixels)
        # Messages have the time at which they were recorded.
        time.sleep(0.05)
    time.sleep(0.3)
    for sensor in sensors:
        sensor.stop()
        sensor.close()


if __name__ == "__main__":
    main()
