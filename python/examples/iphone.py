"""Objects from an iPhone with LiDAR and the app Record3D over USB (pip install record3d), with ARKit's poses. python iphone.py home.ply"""

import sys
import threading

import numpy as np
import splatseg as ss
from record3d import Record3DStream

FLIP = np.diag([1.0, -1, -1, 1])  # ARKit's camera looks along -z, with y up


def main(map_file: str, frames: int = 10**9) -> ss.Pipeline:
    phone, ready, segmenter = Record3DStream(), threading.Event(), ss.FastSamSplat()
    phone.on_new_frame = ready.set  # only the newest frame is read
    phone.connect(Record3DStream.get_connected_devices()[0])
    try:
        for _ in range(frames):
            ready.wait()
            ready.clear()
            depth, pixels, p = phone.get_depth_frame(), phone.get_rgb_frame(), phone.get_camera_pose()
            i = phone.get_intrinsic_mat()
            step = pixels.shape[1] / depth.shape[1]  # depth has fewer pixels
            rows, columns = ((step * (np.arange(n) + 0.5)).astype(int) for n in depth.shape)
            K = np.array([[i.fx, 0, i.tx], [0, i.fy, i.ty], [0, 0, step]]) / step
            x, y, z, w = p.qx, p.qy, p.qz, p.qw
            turn = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), p.tx]]
            turn += [[2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), p.ty]]
            turn += [[2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), p.tz], [0, 0, 0, 1]]
            pixels = np.ascontiguousarray(pixels[np.ix_(rows, columns)])
            result = segmenter.step(pixels, np.nan_to_num(depth), K=K, camera_to_world=np.array(turn) @ FLIP)
            print(f"{len(result.objects)} objects", end="\r")
    except KeyboardInterrupt:
        pass
    segmenter.save(map_file)
    return segmenter


if __name__ == "__main__":
    main(sys.argv[1])
