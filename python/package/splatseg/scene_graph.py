"""The scene graph of a map: rooms, their objects, and the relations between them."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_FORMAT = "splatseg-scene-graph"
_VERSION = 1


@dataclass(frozen=True)
class Relation:
    """A relation between two objects that is certain from geometry."""

    subject: int
    """Id of the object that is on, in, under or beside the other."""
    relation: str
    """``on``, ``in``, ``under`` or ``beside``."""
    object: int
    """Id of the other object."""


@dataclass(frozen=True)
class LastSeen:
    """When and where an object was last seen."""

    frame: int | None
    """Number of the frame, from 0, counted over all runs of the map; ``None`` if unknown."""
    time_s: float | None
    """Its time, seconds; ``None`` if unknown, as in maps of earlier versions."""
    position: tuple[float, float, float] | None
    """Centre of the object, world coordinates, metres; ``None`` if it has no place."""


@dataclass(frozen=True, repr=False)
class SceneObject:
    """An object of a scene graph."""

    id: int
    """Its id, which stays the same while the map is continued."""
    label: str | None
    """Its label."""
    room: int | None
    """Id of the room that it is in; ``None`` if it is in none."""
    color: tuple[int, int, int] | None
    """Mean sRGB colour."""
    box: dict[str, list[float]] | None
    """The tightest box: ``center`` and ``size``, metres, and ``rotation``, a quaternion x, y, z, w."""
    last_seen: LastSeen
    """When and where it was last seen."""

    def __repr__(self) -> str:
        name = f" {self.label!r}" if self.label else ""
        return f"<splatseg.SceneObject {self.id}{name}>"


@dataclass(frozen=True)
class SceneRoom:
    """A room of a scene graph."""

    id: int
    """Its number."""
    name: str | None
    """Its name."""
    objects: tuple[int, ...]
    """Ids of the objects in it."""
    name_source: str | None = None
    """Who gave the name: ``by_hand`` for a person, ``derived`` for its objects; ``None`` without a name."""


@dataclass(frozen=True, repr=False)
class SceneGraph:
    """Rooms, objects and relations of a map. ``docs/scene_graph.schema.json`` is the schema of the file."""

    up: tuple[float, float, float] | None
    """Unit vector that points up, in world coordinates; ``None`` if unknown."""
    frames: int
    """Number of frames that the map was made from, of all runs together."""
    rooms: tuple[SceneRoom, ...]
    """The rooms: one without a name if rooms are not known."""
    objects: dict[int, SceneObject]
    """The objects by id."""
    relations: tuple[Relation, ...]
    """The relations, by subject."""

    def of(self, id: int) -> list[Relation]:
        """The relations in which an object is the subject or the other one."""
        return [one for one in self.relations if id in (one.subject, one.object)]

    def __repr__(self) -> str:
        counts = f"{len(self.rooms)} rooms, {len(self.objects)} objects, {len(self.relations)} relations"
        return f"<splatseg.SceneGraph: {counts}>"


def load_scene_graph(path: str | os.PathLike[str]) -> SceneGraph:
    """Read the JSON file of ``splatseg export map.ply --as scene-graph --out home.json``.

    ::

        graph = splatseg.load_scene_graph("home.json")
        for relation in graph.of(19):
            print(graph.objects[relation.subject], relation.relation, graph.objects[relation.object])

    Raises ``ValueError`` for a file that is no scene graph, damaged or of a later version, and ``OSError`` if it cannot
    be read.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
        if not isinstance(data, dict) or data.get("format") != _FORMAT:
            raise ValueError("not a scene graph of splatseg")
        if data["version"] != _VERSION:
            raise ValueError(f"version {data['version']} of the scene graph, expected {_VERSION}")
        return graph_of(data)
    except (ValueError, KeyError, TypeError) as error:
        found = f"no {error}" if isinstance(error, KeyError) else error
        raise ValueError(f"{os.fspath(path)}: {found}") from None


def graph_of(data: dict[str, Any]) -> SceneGraph:
    """The graph of a file's content."""
    rooms = (SceneRoom(one["id"], one["name"], tuple(one["objects"]), one.get("name_source")) for one in data["rooms"])
    relations = (Relation(one["subject"], one["relation"], one["object"]) for one in data["relations"])
    return SceneGraph(
        up=_three(data["up"]),
        frames=data["frames"],
        rooms=tuple(rooms),
        objects={one["id"]: _object(one) for one in data["objects"]},
        relations=tuple(relations),
    )


def _object(data: dict[str, Any]) -> SceneObject:
    seen = data["last_seen"]
    return SceneObject(
        id=data["id"],
        label=data["label"],
        room=data["room"],
        color=_three(data["color"]),
        box=data["box"],
        last_seen=LastSeen(seen["frame"], seen["time_s"], _three(seen["position"])),
    )


def _three(values: list[Any] | None) -> Any:
    """Three numbers as a tuple."""
    if values is None:
        return None
    if len(values) != 3:
        raise ValueError(f"found {len(values)} numbers, expected 3")
    return tuple(values)
