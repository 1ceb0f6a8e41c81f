"""Objects from an OAK camera (pip install "depthai>=3"). The camera is tracked: it gives no poses. python oak.py home.ply"""

import sys

import depthai as dai
import numpy as np
import splatseg as ss

SIZE = (640, 400)


def main(map_file, frames=10**9):
    segmenter, socket = ss.FastSamSplat(), dai.CameraBoardSocket.CAM_A
    with dai.Pipeline() as camera:
        center = camera.create(dai.node.Camera).build(socket)
        color = center.requestOutput(SIZE, dai.ImgFrame.Type.RGB888i, fps=15, enableUndistortion=True)
        stereo = camera.create(dai.node.StereoDepth).build(autoCreateCameras=True, size=SIZE, fps=15)
        align, pair = camera.create(dai.node.ImageAlign), camera.create(dai.node.Sync)
        stereo.depth.link(align.input)
        color.link(align.inputAlignTo)
        color.link(pair.inputs["color"])
        align.outputAligned.link(pair.inputs["depth"])
        newest = pair.out.createOutputQueue(maxSize=1, blocking=False)
        K = np.array(camera.getDefaultDevice().readCalibration().getCameraIntrinsics(socket, *SIZE))
        camera.start()
        try:
            for _ in range(frames):
                images = newest.get()
                pixels, millimetres = images["color"].getFrame(), images["depth"].getFrame()
                time = images["color"].getTimestamp().total_seconds()
                result = segmenter.step(pixels, millimetres, K=K, depth_scale=1000, timestamp=time)
                print(f"{len(result.objects)} objects, camera {result.pose_state}", end="\r")
        except KeyboardInterrupt:
            pass
    segmenter.save(map_file)
    return segmenter


if __name__ == "__main__":
    main(sys.argv[1])
