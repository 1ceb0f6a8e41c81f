"""Reads third-party furniture meshes: complete DAE, glTF, GLB, FBX and OBJ files, as triangles with colours."""

import contextlib
import os
import sys
from typing import NamedTuple

import bpy
import numpy as np

ENDINGS = (".dae", ".glb", ".gltf", ".fbx", ".obj")
MOST_TRIANGLES = 60_000  # limit, so that building a room takes only seconds


class Finish(NamedTuple):
    """A material's colour (linear RGB), and its texture: the path of an image, its pixels [H, W, 4] uint8, or None."""

    colour: tuple
    image: str | np.ndarray | None


class SourceMesh(NamedTuple):
    """A mesh as stored in its file: z up, in metres, or in the file's units if it does not state them."""

    vertices: np.ndarray  # [V, 3]
    faces: np.ndarray  # [F, 3] vertex numbers
    coordinates: np.ndarray  # [F, 3, 2] texture coordinates
    slots: np.ndarray  # [F] number of the finish
    finishes: list

    @staticmethod
    def join(parts, finishes):
        """Joins a list of (vertices, faces, coordinates, slots) to one mesh."""
        starts = np.cumsum([0] + [len(part[0]) for part in parts])
        faces = [part[1] + start for part, start in zip(parts, starts)]
        vertices, _, coordinates, slots = (np.concatenate(values) for values in zip(*parts))
        return SourceMesh(vertices, np.concatenate(faces), coordinates, slots, finishes)


def read_mesh(path):
    """Reads a file; raises ValueError if it has no triangles or too many, RuntimeError or OSError if it is invalid."""
    if path.lower().endswith(".dae"):
        from .collada import read_collada  # which imports this module

        mesh = read_collada(path)
    else:
        mesh = _import(path)
    if not 4 <= len(mesh.faces) <= MOST_TRIANGLES:
        raise ValueError(f"{len(mesh.faces)} triangles; 4 to {MOST_TRIANGLES} are taken")
    if not np.isfinite(mesh.vertices).all() or np.ptp(mesh.vertices, axis=0).max() <= 0:
        raise ValueError("no size")
    return mesh


@contextlib.contextmanager
def quiet():
    """Discards Blender's output; its importers and renderer have no setting for that."""
    sys.stdout.flush()
    saved, null = [(fd, os.dup(fd)) for fd in (1, 2)], os.open(os.devnull, os.O_WRONLY)
    for fd, _ in saved:
        os.dup2(null, fd)
    try:
        yield
    finally:
        sys.stdout.flush()
        for fd, copy in saved:
            os.dup2(copy, fd)
            os.close(copy)
        os.close(null)


def _import(path):
    """Reads a file with Blender's importer, then removes everything that the importer added to Blender's data."""
    importer = {
        ".glb": bpy.ops.import_scene.gltf,
        ".gltf": bpy.ops.import_scene.gltf,
        ".fbx": bpy.ops.import_scene.fbx,
        ".obj": bpy.ops.wm.obj_import,
    }[os.path.splitext(path)[1].lower()]
    before = _all_data()
    try:
        with quiet():
            importer(filepath=path)
        bpy.context.view_layer.update()
        return _extract([item for item in bpy.context.scene.objects if item.type == "MESH" and item not in before])
    finally:
        bpy.data.batch_remove(_all_data() - before)


def _all_data():
    collections = (bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.images, bpy.data.cameras)
    collections += (bpy.data.lights, bpy.data.actions, bpy.data.armatures, bpy.data.collections)
    return {item for collection in collections for item in collection}


def _extract(objects):
    """Returns the triangles of Blender's mesh objects as one SourceMesh."""
    parts, finishes, slots = [], [], {}
    for item in objects:
        mesh = item.data
        mesh.calc_loop_triangles()
        count = len(mesh.loop_triangles)
        if not count:
            continue
        vertices = _column(mesh.vertices, "co", 3, np.float32)
        matrix = np.array(item.matrix_world)
        faces = _column(mesh.loop_triangles, "vertices", 3, np.int32)
        loops = _column(mesh.loop_triangles, "loops", 3, np.int32)
        coordinates = np.zeros((count, 3, 2))
        if mesh.uv_layers.active:
            coordinates = _column(mesh.uv_layers.active.uv, "vector", 2, np.float32)[loops]
        numbers = []
        for material in list(mesh.materials) or [None]:
            if material not in slots:
                slots[material] = len(finishes)
                finishes.append(_finish(material))
            numbers.append(slots[material])
        own = np.minimum(_column(mesh.loop_triangles, "material_index", 1, np.int32)[:, 0], len(numbers) - 1)
        parts.append((vertices @ matrix[:3, :3].T + matrix[:3, 3], faces, coordinates, np.array(numbers)[own]))
    if not parts:
        raise ValueError("no triangles")
    return SourceMesh.join(parts, finishes)


def _column(items, name, width, kind):
    values = np.zeros(len(items) * width, kind)
    items.foreach_get(name, values)
    return values.reshape(-1, width)


def _finish(material):
    if material is None:
        return Finish((0.6, 0.6, 0.6), None)
    shader = None
    if material.use_nodes:
        shader = next((node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED"), None)
    if shader is None:
        return Finish(tuple(material.diffuse_color[:3]), None)
    colour = shader.inputs["Base Color"]
    image = None
    if colour.is_linked:
        node = colour.links[0].from_node
        while node.type != "TEX_IMAGE" and any(socket.is_linked for socket in node.inputs):
            node = next(socket for socket in node.inputs if socket.is_linked).links[0].from_node
        image = _pixels(node.image) if node.type == "TEX_IMAGE" and node.image else None
    return Finish(tuple(colour.default_value[:3]), image)


def _pixels(image):
    width, height = image.size
    if not width or not height:
        return None
    values = np.zeros(width * height * 4, np.float32)
    image.pixels.foreach_get(values)
    return np.clip(values * 255 + 0.5, 0, 255).astype(np.uint8).reshape(height, width, 4)
