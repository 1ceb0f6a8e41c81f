"""Objects from a RealSense camera (pip install pyrealsense2). The camera is tracked: it gives no poses. python realsense.py home.ply"""

import sys

import numpy as np
import pyrealsense2 as rs
import splatseg as ss


def main(map_file, frames=10**9):
    camera, config = rs.pipeline(), rs.config()
    config.enable_stream(rs.stream.color, 640, 480, rs.format.rgb8, 30)
    config.enable_stream(rs.stream.depth, 640, 480, rs.format.z16, 30)
    device = camera.start(config).get_device()
    scale = 1 / device.first_depth_sensor().get_depth_scale()  # units per metre
    align, segmenter = rs.align(rs.stream.color), ss.FastSamSplat()
    try:
        for _ in range(frames):
            # The SDK keeps the newest frames only, so a slow frame drops others.
            pair = align.process(camera.wait_for_frames())
            color, depth = pair.get_color_frame(), pair.get_depth_frame()
            if not (color and depth):
                continue
            i = color.profile.as_video_stream_profile().intrinsics
            K = np.array([[i.fx, 0, i.ppx], [0, i.fy, i.ppy], [0, 0, 1]])
            pixels, z = np.asarray(color.get_data()), np.asarray(depth.get_data())
            result = segmenter.step(pixels, z, K=K, depth_scale=scale, timestamp=color.get_timestamp() / 1e3)
            print(f"{len(result.objects)} objects, camera {result.pose_state}", end="\r")
    except KeyboardInterrupt:
        pass
    camera.stop()
    segmenter.save(map_file)
    return segmenter


if __name__ == "__main__":
    main(sys.argv[1])
