"""Objects from an Orbbec camera (pip install pyorbbecsdk2). The camera is tracked: it gives no poses. python orbbec.py home.ply"""

import sys

import numpy as np
import splatseg as ss
from pyorbbecsdk import AlignFilter, Config, OBFormat, OBSensorType, OBStreamType, Pipeline


def main(map_file, frames=10**9):
    camera, config, segmenter = Pipeline(), Config(), ss.FastSamSplat()
    colors, depths = map(camera.get_stream_profile_list, (OBSensorType.COLOR_SENSOR, OBSensorType.DEPTH_SENSOR))
    config.enable_stream(colors.get_video_stream_profile(640, 0, OBFormat.RGB, 30))
    config.enable_stream(depths.get_default_video_stream_profile())
    camera.enable_frame_sync()
    camera.start(config)
    align = AlignFilter(align_to_stream=OBStreamType.COLOR_STREAM)
    i = camera.get_camera_param().rgb_intrinsic
    K = np.array([[i.fx, 0, i.cx], [0, i.fy, i.cy], [0, 0, 1]])
    try:
        for _ in range(frames):
            pair = camera.wait_for_frames(100)
            pair = pair and align.process(pair).as_frame_set()
            if not pair or not (color := pair.get_color_frame()) or not (depth := pair.get_depth_frame()):
                continue
            size = (color.get_height(), color.get_width())
            pixels = np.frombuffer(color.get_data(), np.uint8).reshape(*size, 3)
            units = np.frombuffer(depth.get_data(), np.uint16).reshape(size)
            scale = 1000 / depth.get_depth_scale()  # units per metre; the SDK's scale is millimetres per unit
            result = segmenter.step(pixels, units, K=K, depth_scale=scale, timestamp=color.get_timestamp() / 1e3)
            print(f"{len(result.objects)} objects, camera {result.pose_state}", end="\r")
    except KeyboardInterrupt:
        pass
    camera.stop()
    segmenter.save(map_file)
    return segmenter


if __name__ == "__main__":
    main(sys.argv[1])
