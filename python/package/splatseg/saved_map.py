"""A saved map: its objects, floor plan and mesh."""

from __future__ import annotations

import json
import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _splatseg
from .command import PROGRAM
from .files import require_new
from .floor_plan import FloorPlan
from .forking import use_threads
from .objects import Objects, parse
from .scene_graph import SceneGraph, graph_of


@dataclass(frozen=True, repr=False)
class Mesh:
    """A triangle mesh of a map's surfaces."""

    vertices: NDArray[np.float64]
    """World coordinates, metres, ``(vertices, 3)``."""
    colors: NDArray[np.uint8]
    """Colours of the vertices, sRGB, ``(vertices, 3)``."""
    ids: NDArray[np.uint32]
    """The object of each vertex, ``(vertices,)``; 0 for none."""
    triangles: NDArray[np.uint32]
    """Vertices of each triangle, ``(triangles, 3)``, counter-clockwise as seen from outside."""

    def triangle_ids(self) -> NDArray[np.uint32]:
        """The object of each triangle: that of at least two of its vertices, or of the first one."""
        first, second, third = (self.ids[self.triangles[:, corner]] for corner in range(3))
        return np.where(second == third, second, first)

    def __repr__(self) -> str:
        return f"<splatseg.Mesh: {len(self.vertices)} vertices, {len(self.triangles)} triangles>"


class SavedMap:
    """A map that was saved by ``seg.save("map.ply")``, ``splatseg run --save-memory`` or ``splatseg live --map``.

    ::

        home = ss.SavedMap("map.ply")
        plan = home.floor_plan()
        print([(room.id, room.name, room.area_m2) for room in plan.rooms])
        way = plan.route(plan.rooms[0].middle, 15)

    Raises ``ValueError`` if the file cannot be read.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        use_threads()
        self._compiled = _splatseg.SavedMap(path)

    @property
    def _map(self) -> _splatseg.SavedMap:
        """The compiled part."""
        use_threads()
        return self._compiled

    @property
    def path(self) -> Path:
        """The file that it was loaded from."""
        return self._path

    def objects(self) -> Objects:
        """The objects that count. A map does not tell in which frames they were seen."""
        return Objects(parse(entry) for entry in json.loads(self._map.objects())["objects"])

    def scene_graph(self) -> SceneGraph:
        """Rooms, objects, and their relations."""
        return graph_of(json.loads(self._map.scene_graph()))

    def floor_plan(
        self,
        *,
        resolution: float = 0.05,
        min_height: float = 0.1,
        max_height: float = 1.8,
        max_range: float = 5.0,
        free_path: float = 0.0,
    ) -> FloorPlan:
        """Makes the floor plan: free space, rooms and footprints, as ``splatseg export --as occupancy`` does.

        ``resolution`` is the side of a cell. Things between ``min_height`` and ``max_height`` above the floor are obstacles.
        Depth beyond ``max_range`` is not used. Cells within ``free_path`` of the camera's path are taken as free if nothing was
        seen there. All are metres.

        Raises ``ValueError`` if the map has no keyframes, shows no floor, or a number is out of range.
        """
        return FloorPlan(self._map.floor_plan(resolution, min_height, max_height, max_range, free_path))

    def mesh(self, *, voxel: float | None = None) -> Mesh:
        """Makes a triangle mesh of the surfaces that the keyframes show and the map still holds.

        ``voxel`` is the side of a voxel, metres: by default 0.015, or larger if that does not fit into the memory limit.

        Raises ``ValueError`` if the map has no keyframes with depth, or the voxels take too much memory.
        """
        return Mesh(*self._map.mesh(voxel))

    def name_object(self, id: int, label: str | None) -> None:
        """Gives an object a label, or takes it away with ``None``. :meth:`save` keeps it."""
        self._map.name_object(id, label)

    def name_room(self, plan: FloorPlan, number: int, name: str | None) -> None:
        """Gives a room of a plan of this map a name, or takes it away with ``None``. :meth:`save` keeps it.

        The name belongs to the place of the room, so that it stays when numbers change. ``plan`` has it from then on.
        """
        self._map.name_room(plan._plan, number, name)

    def save(self, path: str | os.PathLike[str] | None = None, *, overwrite: bool = False) -> None:
        """Writes the map with its names, by default to the file that it was loaded from.

        Raises ``FileExistsError`` if another file exists, unless ``overwrite``.
        """
        if path is not None and not (os.path.exists(path) and self._path.exists() and self._path.samefile(path)):
            require_new(path, overwrite)
        self._map.save(self._path if path is None else path)

    def export(self, out: str | os.PathLike[str], form: str, *, overwrite: bool = False, **options: Any) -> None:
        """Writes the map for other programs, as ``splatseg export map.ply --as FORM --out OUT`` does.

        ``form`` is ``gaussians``, ``points``, ``mesh``, ``occupancy`` or ``scene-graph``. Other keywords are options of the
        command, with ``_`` for ``-``: ``voxel=0.03``, ``color="id"``, ``id=[3, 7]``. The file that was loaded is exported, so
        :meth:`save` names first.

        Raises ``ValueError`` for options or files that cannot be used, and ``RuntimeError`` if a file cannot be written.
        """
        arguments = ["--as", form, "--out", os.fspath(out)]
        if overwrite:
            arguments.append("--overwrite")
        for name, value in options.items():
            option = f"--{name.replace('_', '-')}"
            values = value if isinstance(value, (list, tuple)) else [value]
            if value is True:
                arguments.append(option)
            elif value is not False and value is not None:
                arguments += [f"{option}={one}" for one in values]
        command = [*PROGRAM, "--quiet", "export", *arguments, "--", os.fspath(self._path)]
        ended = subprocess.run(command, check=False, capture_output=True, encoding="utf-8", errors="replace")
        if ended.returncode:
            problem = _as_arguments(ended.stderr.strip().removeprefix("error: "))
            raise ValueError(problem) if ended.returncode == 2 else RuntimeError(problem)

    def __repr__(self) -> str:
        return f"<splatseg.SavedMap {os.fspath(self._path)!r}>"


def _as_arguments(problem: str) -> str:
    """The command's error in a line, with options as the arguments of :meth:`SavedMap.export`."""
    text = problem.partition("\n\nUsage:")[0].partition("\n\nFor more information")[0]
    text = " ".join(text.split()).replace("give --overwrite", "pass overwrite=True")

    def argument(option: re.Match[str]) -> str:
        name = option[1].replace("-", "_")
        return "form" if name == "as" else name

    return re.sub(r"(?<![\w./-])--([a-z][a-z-]*)(?: <[^>]*>)?", argument, text)
