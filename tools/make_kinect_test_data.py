#!/usr/bin/env python3
"""Writes recordings as those of an Azure Kinect, for `crates/dataset/tests/it/kinect.rs`.

    pip install av==18.1.0 numpy opencv-python-headless     # in a virtual environment; needs mkvmerge (mkvtoolnix)
    python tools/make_kinect_test_data.py crates/dataset/tests/data/recordings

    kinect_nfov.mkv    narrow depth, 16:9 colour as JPEG, and infrared
    kinect_wfov.mkv    wide depth, and 4:3 colour as NV12

mkvmerge writes them with the library that k4arecorder uses, with the same codecs, tags and attachment.

With `--scene SCENE` it writes a scene in the layout of ScanNet, or of this project's folders, as SCENE.mkv instead: its colour
and depth as the two cameras of a Kinect would see them from one place, with twice its focal lengths.

A slanted wall and a ball, whose colour is a smooth function of the place, are seen by the two cameras of a Kinect: 32 mm
apart and turned by 5.9 degrees, each with its lens. All lengths are in metres and in the frame of the depth camera.
"""

import argparse
import json
import subprocess
import tempfile
from pathlib import Path

import av
import cv2
import numpy

FRAMES = 3
FRAME_NS = 33_333_000
# Depth is exposed after colour, by so much.
DEPTH_DELAY_NS = 160_000
MODEL = "CALIBRATION_LensDistortionModelBrownConrady"
# cx, cy, fx, fy, k1 to k6, two that are not used, p2, p1: about those of real devices.
DEPTH = [0.5032, 0.5027, 0.4924, 0.4926, 6.0841, 4.3755, 0.2362, 6.4087, 6.4183, 1.2203, 0, 0, 6.5e-5, -5.5e-5]
COLOR = [0.4987, 0.5021, 0.4782, 0.6374, 0.5844, -2.4942, 1.3603, 0.4648, -2.3362, 1.3012, 0, 0, -1.765e-4, 6.531e-4]
TILT = 0.1027
# Of the cameras that see a scene of another camera.
ZOOM = 2
# Colour from depth: x' = R x + t.
ROTATION = numpy.array([[1, 0, 0], [0, numpy.cos(TILT), numpy.sin(TILT)], [0, -numpy.sin(TILT), numpy.cos(TILT)]])
TRANSLATION = numpy.array([-0.03202, -0.00208, 0.00393])


class Camera:
    """A camera of the device in a mode."""

    def __init__(self, parameters, sensor, start, size):
        cx, cy, fx, fy = parameters[:4]
        self.focal = numpy.array([fx * sensor[0], fy * sensor[1]])
        self.center = numpy.array([cx * sensor[0] - start[0] - 0.5, cy * sensor[1] - start[1] - 0.5])
        self.lens = parameters[4:]
        self.size = size

    def distort(self, points):
        k1, k2, k3, k4, k5, k6, _, _, p2, p1 = self.lens
        x, y = points[..., 0], points[..., 1]
        square = x * x + y * y
        factor = (1 + square * (k1 + square * (k2 + square * k3))) / (1 + square * (k4 + square * (k5 + square * k6)))
        return numpy.stack(
            [
                x * factor + 2 * p1 * x * y + p2 * (square + 2 * x * x),
                y * factor + 2 * p2 * x * y + p1 * (square + 2 * y * y),
            ],
            axis=-1,
        )

    def rays(self):
        """Directions of all pixels, z = 1; NaN where the lens shows nothing."""
        columns, rows = numpy.meshgrid(numpy.arange(self.size[0]), numpy.arange(self.size[1]))
        wanted = (numpy.stack([columns, rows], axis=-1) - self.center) / self.focal
        radii = numpy.linspace(0, 1.9, 4000)
        seen = self.distort(numpy.stack([radii, 0 * radii], axis=-1))[..., 0]
        last = int(numpy.argmax(numpy.append(numpy.diff(seen) <= 0, True)))
        length = numpy.linalg.norm(wanted, axis=-1)
        radius = numpy.interp(length, seen[: last + 1], radii[: last + 1], right=numpy.nan)
        points = wanted * (radius / numpy.maximum(length, 1e-12))[..., None]
        for _ in range(20):
            error = self.distort(points) - wanted
            step = 1e-6
            across = (self.distort(points + [step, 0]) - self.distort(points)) / step
            down = (self.distort(points + [0, step]) - self.distort(points)) / step
            determinant = across[..., 0] * down[..., 1] - across[..., 1] * down[..., 0]
            points = points - numpy.stack(
                [
                    (error[..., 0] * down[..., 1] - error[..., 1] * down[..., 0]) / determinant,
                    (error[..., 1] * across[..., 0] - error[..., 0] * across[..., 1]) / determinant,
                ],
                axis=-1,
            )
        points[numpy.linalg.norm(self.distort(points) - wanted, axis=-1) > 1e-6] = numpy.nan
        return numpy.concatenate([points, numpy.ones_like(points[..., :1])], axis=-1)


def depth_camera(size):
    """NFOV for the shape 10:9, WFOV for squares."""
    if size[0] == size[1]:
        return Camera(DEPTH, (size[0], size[0]), (0, 0), size)
    side = 1024 * size[0] / 640
    return Camera(DEPTH, (side, side), (192 * size[0] / 640, 180 * size[0] / 640), size)


def color_camera(size):
    height = size[0] * 3 / 4
    return Camera(COLOR, (size[0], height), (0, (height - size[1]) / 2), size)


def calibration():
    def camera(parameters, location, purpose, size, rotation, translation):
        return {
            "Intrinsics": {"ModelParameterCount": 14, "ModelParameters": parameters, "ModelType": MODEL},
            "Location": f"CALIBRATION_CameraLocation{location}",
            "Purpose": f"CALIBRATION_CameraPurpose{purpose}",
            "MetricRadius": 1.74 if location == "D0" else 0,
            "Rt": {"Rotation": [float(value) for value in rotation.flatten()], "Translation": list(translation)},
            "SensorHeight": size[1],
            "SensorWidth": size[0],
        }

    cameras = [
        camera(DEPTH, "D0", "Depth", (1024, 1024), numpy.eye(3), [0, 0, 0]),
        camera(COLOR, "PV0", "PhotoVideo", (4096, 3072), ROTATION, TRANSLATION.tolist()),
    ]
    return json.dumps({"CalibrationInformation": {"Cameras": cameras, "InertialSensors": []}}).encode()


def surfaces(origin, directions, number):
    """Distances along rays to the wall and the ball: the nearest."""
    wall = (2.2 + 0.3 * origin[0] - origin[2]) / (directions[..., 2] - 0.3 * directions[..., 0])
    wall = numpy.where(wall > 0, wall, numpy.inf)
    between = origin - numpy.array([0.15 + 0.05 * number, 0.1, 1.3])
    square = (directions**2).sum(axis=-1)
    half = (directions * between).sum(axis=-1)
    root = half * half - square * (between @ between - 0.3**2)
    ball = (-half - numpy.sqrt(numpy.maximum(root, 0))) / square
    return numpy.where((root > 0) & (ball > 0), numpy.minimum(ball, wall), wall)


def color_of(points):
    """Colour of places on the surfaces, RGB."""
    phases = numpy.stack([3 * points[..., 0], 3 * points[..., 1] + 1, 2 * points[..., 2]], axis=-1)
    return numpy.clip(numpy.nan_to_num(128 + 100 * numpy.sin(phases)), 0, 255).astype(numpy.uint8)


def render(number, depth, color):
    rays = depth.rays()
    z = surfaces(numpy.zeros(3), rays, number)
    millimetres = numpy.nan_to_num(numpy.round(1000 * z), posinf=0)
    millimetres[millimetres > 8000] = 0
    origin = -ROTATION.T @ TRANSLATION
    directions = color.rays() @ ROTATION
    points = origin + directions * surfaces(origin, directions, number)[..., None]
    return color_of(points), millimetres.astype(numpy.uint16)


def jpeg(image):
    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 92])[1].tobytes()


def infrared(depth):
    return (60000 // numpy.maximum(depth, 100)).astype(">u2").tobytes()


TAGS = {
    "K4A_COLOR_MODE": "MJPG_720P",
    "K4A_DEPTH_MODE": "NFOV_UNBINNED",
    "K4A_DEPTH_DELAY_NS": str(DEPTH_DELAY_NS),
    "K4A_WIRED_SYNC_MODE": "STANDALONE",
    "K4A_DEVICE_SERIAL_NUMBER": "000123456789",
    "K4A_CALIBRATION_FILE": "calibration.json",
    "K4A_START_OFFSET_NS": "0",
}


def write_avi(path, size, four_cc, images):
    """Writes images as a track that mkvmerge takes over as it is."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mjpeg" if four_cc == "MJPG" else "rawvideo", rate=30)
        stream.width, stream.height = size
        stream.pix_fmt = {"MJPG": "yuvj420p", "NV12": "nv12", "b16g": "gray16be"}[four_cc]
        stream.codec_context.codec_tag = four_cc
        for number, data in enumerate(images):
            packet = av.Packet(data)
            packet.stream, packet.pts, packet.dts = stream, number, number
            packet.is_keyframe = True
            container.mux(packet)
    # The muxer knows raw pixels without a format only.
    written = bytearray(path.read_bytes())
    header = written.index(b"strf") + 8
    written[header + 16 : header + 20] = four_cc.encode()
    path.write_bytes(written)


def write_with_mkvmerge(path, tracks, tags):
    """Writes tracks: name, size, format, images, and the time of the first one, nanoseconds."""
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        (folder / "calibration.json").write_bytes(calibration())
        simple = "".join(
            f"<Simple><Name>{name}</Name><String>{value}</String></Simple>" for name, value in tags.items()
        )
        (folder / "tags.xml").write_text(f"<Tags><Tag>{simple}</Tag></Tags>")
        command = ["mkvmerge", "--quiet", "--deterministic", "kinect", "--output", str(path)]
        command += ["--timestamp-scale", "1000", "--cluster-length", "3", "--disable-track-statistics-tags"]
        command += ["--no-date", "--title", "Azure Kinect", "--global-tags", str(folder / "tags.xml")]
        command += ["--attachment-name", "calibration.json", "--attachment-mime-type", "application/octet-stream"]
        command += ["--attach-file", str(folder / "calibration.json")]
        for name, size, four_cc, images, start in tracks:
            images = list(images)
            write_avi(folder / f"{name}.avi", size, four_cc, images)
            times = "\n".join(f"{(start + FRAME_NS * number) * 1e-6:.3f}" for number in range(len(images)))
            (folder / f"{name}.txt").write_text(f"# timestamp format v2\n{times}\n")
            command += ["--timestamps", f"0:{folder}/{name}.txt", "--track-name", f"0:{name}", f"{folder}/{name}.avi"]
        subprocess.run(command, check=True)


def nv12(image):
    """Luma from 16 to 235, and chroma of every second pixel (BT.601)."""
    planes = cv2.cvtColor(image, cv2.COLOR_RGB2YUV_I420)
    height, width = image.shape[:2]
    luma, chroma = planes[:height].tobytes(), planes[height:].reshape(2, height // 2, width // 2)
    return luma + numpy.ascontiguousarray(numpy.moveaxis(chroma, 0, -1)).tobytes()


def write_tests(folder):
    size, color_size = (80, 72), (160, 90)
    pairs = [render(number, depth_camera(size), color_camera(color_size)) for number in range(FRAMES)]
    tracks = [
        ("COLOR", color_size, "MJPG", [jpeg(color) for color, _ in pairs], 1_000_000),
        ("DEPTH", size, "b16g", [depth.astype(">u2").tobytes() for _, depth in pairs], 1_000_000 + DEPTH_DELAY_NS),
        ("IR", size, "b16g", [infrared(depth) for _, depth in pairs], 1_000_000 + DEPTH_DELAY_NS),
    ]
    write_with_mkvmerge(folder / "kinect_nfov.mkv", tracks, TAGS)
    size, color_size = (64, 64), (80, 60)
    pairs = [render(number, depth_camera(size), color_camera(color_size)) for number in range(FRAMES)]
    tracks = [
        ("COLOR", color_size, "NV12", [nv12(color) for color, _ in pairs], 0),
        ("DEPTH", size, "b16g", [depth.astype(">u2").tobytes() for _, depth in pairs], 0),
    ]
    tags = TAGS | {"K4A_COLOR_MODE": "NV12_1536P", "K4A_DEPTH_MODE": "WFOV_UNBINNED", "K4A_DEPTH_DELAY_NS": "0"}
    write_with_mkvmerge(folder / "kinect_wfov.mkv", tracks, tags)


def scene_files(scene):
    """Intrinsics fx, fy, cx, cy and the pairs of files of a scene."""
    camera = scene / "camera.json"
    if camera.exists():
        stated = json.loads(camera.read_text())
        intrinsics = [stated[name] for name in ("fx", "fy", "cx", "cy")]
    else:
        matrix = numpy.loadtxt(scene / "intrinsic" / "intrinsic_depth.txt")
        intrinsics = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]
    depths = {file.stem: file for file in (scene / "depth").iterdir()}
    colors = {file.stem: file for file in (scene / "color").iterdir()}
    names = sorted(colors.keys() & depths.keys(), key=lambda name: (len(name), name))
    return intrinsics, [(colors[name], depths[name]) for name in names]


def write_scene(folder, scene):
    """The cameras are at one place here: what one of them sees, nothing hides from the other. They see a part of the image."""
    global TRANSLATION
    TRANSLATION = numpy.zeros(3)
    for parameters in DEPTH, COLOR:
        parameters[2:4] = [ZOOM * focal for focal in parameters[2:4]]
    (fx, fy, cx, cy), files = scene_files(scene)
    depth_view, color_view = depth_camera((640, 576)), color_camera((1280, 720))

    def places(rays):
        with numpy.errstate(invalid="ignore", divide="ignore"):
            columns, rows = fx * rays[..., 0] / rays[..., 2] + cx, fy * rays[..., 1] / rays[..., 2] + cy
        behind = ~(rays[..., 2] > 0)
        columns[behind], rows[behind] = -9, -9
        return columns.astype(numpy.float32), rows.astype(numpy.float32)

    depth_rays, color_rays = depth_view.rays(), color_view.rays()
    # The scene's camera is the colour camera without its lens.
    turned = depth_rays @ ROTATION.T
    depth_at, color_at = places(turned), places(color_rays)

    def images():
        for color_file, depth_file in files:
            color = cv2.imread(str(color_file))
            depth = cv2.imread(str(depth_file), cv2.IMREAD_UNCHANGED).astype(numpy.float32)
            depth[depth == 65535] = 0
            scale = [depth.shape[1] / color.shape[1], depth.shape[0] / color.shape[0]]
            color = cv2.resize(color, (depth.shape[1], depth.shape[0])) if scale != [1, 1] else color
            seen = cv2.remap(color, *color_at, cv2.INTER_LINEAR)
            z = cv2.remap(depth, *depth_at, cv2.INTER_NEAREST) / turned[..., 2]
            z = numpy.nan_to_num(z, posinf=0, neginf=0).clip(0, 65535)
            yield jpeg(seen[..., ::-1]), numpy.round(z).astype(">u2").tobytes()

    pairs = list(images())
    tracks = [
        ("COLOR", color_view.size, "MJPG", [color for color, _ in pairs], 0),
        ("DEPTH", depth_view.size, "b16g", [depth for _, depth in pairs], DEPTH_DELAY_NS),
    ]
    write_with_mkvmerge(folder / f"{scene.name}.mkv", tracks, TAGS)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--scene", type=Path, help="a scene to write as a recording")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    if arguments.scene is None:
        write_tests(arguments.folder)
    else:
        write_scene(arguments.folder, arguments.scene)


if __name__ == "__main__":
    main()
