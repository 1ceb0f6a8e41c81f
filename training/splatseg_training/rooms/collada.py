"""Reads COLLADA files: triangles, texture coordinates, colours.

Blender 4.5's own importer silently omits the geometry of files from Autodesk's FBX exporter, and Blender 5 has no
importer.
"""

import os
from xml.etree import ElementTree

import numpy as np

from .meshes import Finish, SourceMesh


def read_collada(path):
    """The meshes of a file's scene as one SourceMesh, in metres, z up."""
    tree = ElementTree.parse(path).getroot()
    for element in tree.iter():
        element.tag = element.tag.rpartition("}")[2]  # without the namespace
    document = Document(tree, os.path.dirname(path))
    parts = []
    for scene in tree.iter("visual_scene"):
        for node in scene.findall("node"):
            document.add_node(node, document.axes(), parts)
    if not parts:
        raise ValueError("no triangles")
    return SourceMesh.join(parts, document.finishes)


class Document:
    """A parsed file; collects the finishes of the materials used by its geometry."""

    def __init__(self, tree, folder):
        self.tree, self.folder = tree, folder
        self.by_id = {element.get("id"): element for element in tree.iter() if element.get("id")}
        self.finishes, self.slots = [], {}

    def axes(self):
        """File to world: [4, 4], scaled to metres and rotated to z up."""
        unit = self.tree.find("asset/unit")
        matrix = np.eye(4) * (1.0 if unit is None else float(unit.get("meter", 1)))
        up = self.tree.findtext("asset/up_axis", "Y_UP").strip()
        if up == "Y_UP":
            matrix = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]) @ matrix
        matrix[3] = 0, 0, 0, 1
        return matrix

    def add_node(self, node, world_from_parent, parts):
        """Appends (vertices, faces, coordinates, slots) of a node and its children."""
        world = world_from_parent
        for element in node.findall("matrix"):
            world = world @ _numbers(element).reshape(4, 4)
        for instance in node.findall("instance_geometry"):
            bound = {i.get("symbol"): i.get("target")[1:] for i in instance.iter("instance_material")}
            for group in self.by_id[instance.get("url")[1:]].findall("mesh/*"):
                if group.tag in ("triangles", "polylist"):
                    slot = self.slot(bound.get(group.get("material")))
                    vertices, faces, coordinates = self.read_group(group)
                    vertices = vertices @ world[:3, :3].T + world[:3, 3]
                    parts.append((vertices, faces, coordinates, np.full(len(faces), slot)))
        for child in node.findall("node"):
            self.add_node(child, world, parts)

    def read_group(self, group):
        """Vertices [V, 3], faces [F, 3] and texture coordinates [F, 3, 2] of a polygon group."""
        inputs = {}
        for item in group.findall("input"):
            inputs.setdefault(item.get("semantic"), (int(item.get("offset")), item.get("source")[1:]))
        stride = 1 + max(int(item.get("offset")) for item in group.findall("input"))
        indices = _numbers(group.find("p"), int).reshape(-1, stride)
        sizes = _numbers(group.find("vcount"), int) if group.tag == "polylist" else np.full(len(indices) // 3, 3)
        corners = _fans(sizes)
        offset, name = inputs["VERTEX"]
        position = next(i for i in self.by_id[name].findall("input") if i.get("semantic") == "POSITION")
        vertices = self.read_source(position.get("source")[1:])[:, :3]
        coordinates = np.zeros((len(corners), 3, 2))
        if "TEXCOORD" in inputs:
            column, source = inputs["TEXCOORD"]
            coordinates = self.read_source(source)[:, :2][indices[corners, column]]
        return vertices, indices[corners, offset], coordinates

    def read_source(self, name):
        source = self.by_id[name]
        stride = int(source.find("technique_common/accessor").get("stride", 1))
        return _numbers(source.find("float_array")).reshape(-1, stride)

    def slot(self, material):
        """Number of a material's finish."""
        if material not in self.slots:
            self.slots[material] = len(self.finishes)
            self.finishes.append(self.finish(material))
        return self.slots[material]

    def finish(self, material):
        if material not in self.by_id:
            return Finish((0.6, 0.6, 0.6), None)
        effect = self.by_id[self.by_id[material].find("instance_effect").get("url")[1:]]
        diffuse = effect.find(".//diffuse")
        colour = None if diffuse is None else diffuse.find("color")
        texture = None if diffuse is None else diffuse.find("texture")
        rgb = (0.6, 0.6, 0.6) if colour is None else tuple(_numbers(colour)[:3])
        return Finish(rgb, None if texture is None else self.image(effect, texture.get("texture")))

    def image(self, effect, name):
        """Path of a texture's image, through the sampler and its surface or named directly; None if it is missing."""
        params = {param.get("sid"): param for param in effect.iter("newparam")}
        for tag in ("source", "init_from"):
            if name in params and params[name].find(f".//{tag}") is not None:
                name = params[name].find(f".//{tag}").text.strip()
        path = self.by_id[name].findtext("init_from", "").strip() if name in self.by_id else ""
        path = os.path.normpath(os.path.join(self.folder, path.removeprefix("file://")))
        return path if os.path.isfile(path) else None


def _numbers(element, kind=float):
    return np.array((element.text or "").split(), dtype=kind)


def _fans(sizes):
    """Corner numbers [F, 3] that split polygons with the given numbers of corners into triangles."""
    starts = np.cumsum(sizes) - sizes
    fans = [
        np.stack([starts[sizes > k + 1], starts[sizes > k + 1] + k, starts[sizes > k + 1] + k + 1], 1)
        for k in range(1, max(sizes, default=0) - 1)
    ]
    return np.concatenate(fans) if fans else np.zeros((0, 3), int)
