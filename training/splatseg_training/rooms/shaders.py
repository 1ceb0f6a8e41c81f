"""Procedural textures as Blender's shader nodes. Colours are linear RGB."""

import bpy
import numpy as np

FLAT = ("checker", "brick", "tile", "plank", "dots", "plaid", "terrazzo")  # mapped onto surfaces; others are solid


class Shader:
    """Builds the nodes of a new material."""

    def __init__(self, name):
        self.material = bpy.data.materials.new(name)
        self.material.use_nodes = True
        self.nodes, self.links = self.material.node_tree.nodes, self.material.node_tree.links
        self.surface = self.nodes["Principled BSDF"]

    def node(self, kind, source=None, into="Vector", **inputs):
        """Adds a node, connects an output to its input `into`, and sets inputs (underscores replace spaces in
        names)."""
        node = self.nodes.new("ShaderNode" + kind)
        if source:
            self.links.new(source, node.inputs[into])
        for name, value in inputs.items():
            node.inputs[name.replace("_", " ")].default_value = value
        return node

    def ramp(self, factor, low, high, colours, mode="LINEAR"):
        """Maps a factor to colours: the first up to `low`, the second from `high` on."""
        node = self.node("ValToRGB", factor, "Fac")
        node.color_ramp.interpolation = mode
        for element, position, colour in zip(node.color_ramp.elements, (low, high), colours):
            element.position, element.color = position, (*colour, 1)
        return node.outputs["Color"]

    def place(self, texture, scale, turn, location):
        """Texture coordinates, in metres times `scale`."""
        space = "Generated" if texture == "image" else "UV" if texture in FLAT else "Object"
        coordinates = self.node("TexCoord").outputs[space]
        mapping = self.node("Mapping", coordinates, Scale=scale, Rotation=(0, 0, turn), Location=location)
        return mapping.outputs["Vector"]

    def waves(self, at, colours, texture):
        """Wood grain, stripes or plaid."""
        if texture == "wood":
            wave = self.node("TexWave", at, Scale=1, Distortion=5, Detail=2, Detail_Scale=1.3)
            return self.ramp(wave.outputs["Fac"], 0, 1, colours)
        if texture == "stripes":
            return self.ramp(self.node("TexWave", at, Scale=1).outputs["Fac"], 0, 0.5, colours, "CONSTANT")
        across, along = self.node("TexWave", at, Scale=1), self.node("TexWave", at, Scale=1)
        along.bands_direction = "Y"
        mean = self.node("Mix", across.outputs["Fac"], "A", Factor=0.5)
        self.links.new(along.outputs["Fac"], mean.inputs["B"])
        return self.ramp(mean.outputs["Result"], 0.25, 0.6, colours)

    def bricks(self, at, colours, mortar, width, gap, offset):
        first, second = ((*colour, 1) for colour in colours)
        node = self.node("TexBrick", at, Scale=1, Color1=first, Color2=second, Mortar=(*mortar, 1))
        node.inputs["Mortar Size"].default_value = gap
        node.inputs["Brick Width"].default_value = width
        node.inputs["Row Height"].default_value = 1
        node.offset = offset
        return node.outputs["Color"]

    def cells(self, at, colours, texture):
        """Dots or terrazzo."""
        if texture == "dots":
            node = self.node("TexVoronoi", at, Scale=1, Randomness=0)
            node.voronoi_dimensions = "2D"
            return self.ramp(node.outputs["Distance"], 0, 0.3, colours, "CONSTANT")
        return self.ramp(self.node("TexVoronoi", at, Scale=1).outputs["Color"], 0.3, 0.7, colours)

    def picture(self, at, pixels):
        """An image [H, W, 3] in 0..1 over the bounding rectangle in x and z."""
        split = self.node("SeparateXYZ", at)
        plane = self.node("CombineXYZ", split.outputs["X"], "X")
        self.links.new(split.outputs["Z"], plane.inputs["Y"])
        node = self.node("TexImage", plane.outputs[0])
        height, width = pixels.shape[:2]
        node.image = new_image(np.dstack([pixels[::-1], np.ones((height, width))]))
        return node.outputs["Color"]

    def mapped_picture(self, image):
        """An image mapped by the mesh's texture coordinates; `image` is a path or pixels [H, W, 4] uint8, bottom row
        first."""
        node = self.node("TexImage")
        if isinstance(image, str):
            node.image = bpy.data.images.load(image, check_existing=True)
        else:
            node.image = new_image(image.astype(np.float32) / 255)
        return node.outputs["Color"]

    def finish(self, colour, texture, rough, metal, glow):
        """Sets the surface; returns the input for its emission strength, None without emission."""
        inputs = self.surface.inputs
        inputs["Roughness"].default_value, inputs["Metallic"].default_value = rough, metal
        inputs["Specular IOR Level"].default_value = 0.5 if rough < 0.5 else 0.25
        for name in ("Base Color", "Emission Color")[: 1 + bool(glow)]:
            inputs[name].default_value = (*colour, 1)
            if texture:
                self.links.new(texture, inputs[name])
        if not glow:
            return None
        self.material.cycles.emission_sampling = "NONE"
        return inputs["Emission Strength"]


def new_image(pixels):
    """Creates a Blender image from pixels [H, W, 4] in 0..1, bottom row first."""
    height, width = pixels.shape[:2]
    image = bpy.data.images.new("art", width, height)
    image.pixels.foreach_set(pixels.astype(np.float32).ravel())
    image.update()
    return image
