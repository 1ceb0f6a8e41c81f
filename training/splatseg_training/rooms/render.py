"""Renders a room's colours with Blender's Cycles on the CPU."""

import math
import os
import tempfile
from typing import NamedTuple

import bpy
import numpy as np
from mathutils import Matrix
from PIL import Image

from .meshes import quiet

# Few samples and bounces, and a denoiser: 2 s per frame of 320 × 240 on one core.
CYCLES = {
    "use_adaptive_sampling": False,
    "use_light_tree": False,
    "light_sampling_threshold": 0.05,
    "use_denoising": True,
    "denoiser": "OPENIMAGEDENOISE",
    "denoising_input_passes": "RGB_ALBEDO_NORMAL",
    "denoising_prefilter": "NONE",
    "denoising_quality": "BALANCED",
    "max_bounces": 2,
    "diffuse_bounces": 2,
    "glossy_bounces": 1,
    "transmission_bounces": 0,
    "transparent_max_bounces": 2,
    "caustics_reflective": False,
    "caustics_refractive": False,
    "sample_clamp_indirect": 4,
    "blur_glossy": 1,
    "filter_width": 1.5,
}


class Quality(NamedTuple):
    samples: int
    threads: int


def empty_scene():
    """Removes everything from Blender."""
    bpy.ops.wm.read_factory_settings(use_empty=True)


class Renderer:
    """Renders the scene, which contains a finished room, with a Camera of `cast`."""

    def __init__(self, room, camera, quality):
        self.room, self.camera, self.scene = room, camera, bpy.context.scene
        self._set_up(quality)

    def _set_up(self, quality):
        scene, render = self.scene, self.scene.render
        render.engine, scene.cycles.device = "CYCLES", "CPU"
        render.resolution_x, render.resolution_y = self.camera.width, self.camera.height
        render.resolution_percentage = 100
        render.threads_mode, render.threads, render.use_persistent_data = "FIXED", quality.threads, True
        scene.cycles.samples = quality.samples
        for name, value in CYCLES.items():
            setattr(scene.cycles, name, value)
        scene.view_settings.view_transform, scene.view_settings.look = "AgX", "AgX - Medium High Contrast"
        scene.world = bpy.data.worlds.new("world")
        scene.world.color = (0, 0, 0)
        lens = bpy.data.cameras.new("camera")
        lens.sensor_fit, lens.sensor_width, lens.clip_start = "HORIZONTAL", 36, 0.01
        lens.lens = self.camera.focal * 36 / self.camera.width
        scene.camera = bpy.data.objects.new("camera", lens)
        scene.collection.objects.link(scene.camera)

    def expose(self, poses):
        """Sets the exposure from a few small noisy renders, as a camera would, and scales visible emitters to it."""
        scene, samples = self.scene, self.scene.cycles.samples
        scene.render.resolution_percentage, scene.cycles.samples, scene.cycles.use_denoising = 20, 8, False
        glow = self.room.paint.glow
        for strength, _ in glow:
            strength.default_value = 0
        light = np.concatenate([self._luminance(pose) for pose in poses])
        exposure = self.room.paint.uniform(0.16, 0.26) / np.exp(np.mean(np.log(light + 1e-3)))
        scene.view_settings.exposure = math.log2(exposure)
        for strength, value in glow:
            strength.default_value = value / exposure
        scene.render.resolution_percentage, scene.cycles.samples, scene.cycles.use_denoising = 100, samples, True

    def _luminance(self, pose):
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "view.exr")
            self._render(pose, path, "OPEN_EXR")
            image = bpy.data.images.load(path)
            values = np.array(image.pixels[:]).reshape(-1, 4)[:, :3].mean(1)
            bpy.data.images.remove(image)
        return values

    def colours(self, pose, rng):
        """Renders the view from a pose with camera noise: [H, W, 3] uint8 RGB."""
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "view.png")
            self._render(pose, path, "PNG")
            pixels = np.asarray(Image.open(path).convert("RGB")).astype(float)
        pixels += rng.normal(size=pixels.shape) * 1.2 + rng.normal(size=(*pixels.shape[:2], 1)) * 1.2
        return np.clip(pixels + 0.5, 0, 255).astype(np.uint8)

    def _render(self, pose, path, file_format):
        # Blender's cameras look along -z with y up.
        self.scene.camera.matrix_world = Matrix((pose @ np.diag([1, -1, -1, 1])).tolist())
        self.scene.render.image_settings.file_format, self.scene.render.filepath = file_format, path
        with quiet():
            bpy.ops.render.render(write_still=True)
