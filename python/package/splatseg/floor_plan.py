"""The floor plan of a map: free space, rooms, footprints and routes."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _splatseg


@dataclass(frozen=True)
class Door:
    """A way into another room."""

    to: int
    """Number of the other room."""
    place: tuple[float, float]
    """Its middle, in the plan's coordinates, metres."""
    width_m: float
    """Its width as far as it was seen, metres."""


@dataclass(frozen=True)
class PlanRoom:
    """A room of a floor plan."""

    id: int
    """Its number, from 1."""
    name: str | None
    """Its name."""
    name_source: str | None
    """``by_hand`` or ``derived`` from its objects; ``None`` without a name."""
    middle: tuple[float, float]
    """Where it is widest, in the plan's coordinates, metres."""
    area_m2: float
    """Area of its floor, furniture included."""
    doors: tuple[Door, ...]
    """Ways into other rooms."""


@dataclass(frozen=True)
class ApproachPoint:
    """A place from which a robot faces an object."""

    place: tuple[float, float]
    """Where its centre stands, in the plan's coordinates, metres."""
    yaw: float
    """Direction to the object's nearest part, radians, counter-clockwise from x."""
    distance_m: float
    """Distance from the centre to the object's footprint."""
    clearance_m: float
    """Free distance around the centre."""


@dataclass(frozen=True, repr=False)
class Footprint:
    """The part of the floor that an object covers."""

    id: int
    """Id of the object."""
    label: str | None
    """Its label."""
    room: int | None
    """Number of its room; ``None`` if it is in none."""
    center: tuple[float, float]
    """Mean of its cells, in the plan's coordinates, metres."""
    outlines: tuple[NDArray[np.float64], ...]
    """Corners, ``(corners, 2)`` each: counter-clockwise around parts, clockwise around holes."""
    heights: tuple[float, float]
    """Height of its lowest and highest part above the floor, metres."""
    area_m2: float
    """Area of its cells."""

    def __repr__(self) -> str:
        name = f" {self.label!r}" if self.label else ""
        return f"<splatseg.Footprint {self.id}{name}: {self.area_m2:.2f} m²>"


@dataclass(frozen=True, repr=False)
class Route:
    """A way of a robot."""

    points: NDArray[np.float64]
    """Its corners from start to end, in the plan's coordinates, metres, ``(corners, 2)``."""
    length_m: float
    """Its length."""
    clearance_m: float
    """The least distance of its centre line from what is not known to be free."""
    yaw: float | None
    """Direction to the object at its end, radians, counter-clockwise from x; ``None`` if it ends at a place."""

    def __repr__(self) -> str:
        return f"<splatseg.Route: {self.length_m:.2f} m, {len(self.points)} corners>"


class FloorPlan:
    """The floor plan of a :class:`SavedMap`. Its coordinates are x and y along the floor, metres.

    ``plan.grid[row, column]`` is the cell whose lowest corner is ``plan.origin + plan.resolution * [column, row]``.
    """

    def __init__(self, plan: _splatseg.FloorPlan) -> None:
        self._plan = plan

    def _data(self, robot_radius: float = 0.2) -> dict[str, Any]:
        data: dict[str, Any] = json.loads(self._plan.data(robot_radius))
        return data

    @property
    def grid(self) -> NDArray[np.int8]:
        """The cells as in ``nav_msgs/OccupancyGrid``, ``(height, width)``: 0 free, 100 occupied, -1 unknown."""
        return self._plan.grid()

    @property
    def room_ids(self) -> NDArray[np.uint32]:
        """The number of the room of each cell, ``(height, width)``; 0 for none."""
        return self._plan.room_ids()

    @property
    def resolution(self) -> float:
        """Side of a cell, metres."""
        return float(self._data()["grid"]["resolution"])

    @property
    def origin(self) -> NDArray[np.float64]:
        """The grid's corner with the lowest x and y, metres, ``(2,)``."""
        return np.array(self._data()["grid"]["origin"], np.float64)

    @property
    def plan_from_world(self) -> NDArray[np.float64]:
        """Transform from world coordinates to the plan's, ``(4, 4)``: the unit matrix if z points up in the world."""
        frame = self._data()["frame"]
        matrix = np.eye(4)
        matrix[:3, :3] = _rotation(frame["rotation"])
        matrix[:3, 3] = frame["translation"]
        return matrix

    @property
    def floor_height(self) -> float:
        """z of the floor in the plan's coordinates, metres."""
        return float(self._data()["frame"]["floor_height"])

    @property
    def rooms(self) -> tuple[PlanRoom, ...]:
        """The rooms, by number."""
        return tuple(_room(room) for room in self._data()["rooms"])

    @property
    def footprints(self) -> dict[int, Footprint]:
        """The footprints of all objects that have a place in the plan, by id."""
        return {one["id"]: _footprint(one) for one in self._data()["objects"]}

    def approach(self, id: int, *, robot_radius: float = 0.2) -> list[ApproachPoint]:
        """Places for a robot of this radius, metres, from which it faces an object, the best first.

        Raises ``ValueError`` if the object has no footprint, or no such place is free.
        """
        points = json.loads(self._plan.approach(id, robot_radius))
        return [ApproachPoint(_two(one["place"]), one["yaw"], one["distance_m"], one["clearance_m"]) for one in points]

    def route(self, start: ArrayLike, end: ArrayLike | int, *, robot_radius: float = 0.2) -> Route:
        """The way of a robot of this radius, metres, from a place to a place, or to where it faces an object.

        ``start`` is x and y in the plan's coordinates; ``end`` too, or the id of an object. It keeps the robot's whole disc on
        cells that are known to be free.

        Raises ``ValueError`` if there is no free place near an end, or no way between them.
        """
        if isinstance(end, (int, np.integer)):
            (points, length, clearance), yaw = self._plan.route_to_object(_place(start), int(end), robot_radius)
            return Route(points, length, clearance, yaw)
        points, length, clearance = self._plan.route(_place(start), _place(end), robot_radius)
        return Route(points, length, clearance, None)

    def to_plan(self, points: ArrayLike) -> NDArray[np.float64]:
        """Places on the plan, ``(…, 2)``, of points in world coordinates, ``(…, 3)``."""
        matrix = self.plan_from_world
        turned = np.asarray(points, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]
        return np.asarray(turned[..., :2], np.float64)

    def to_world(self, places: ArrayLike) -> NDArray[np.float64]:
        """Points on the floor in world coordinates, ``(…, 3)``, of places on the plan, ``(…, 2)``."""
        places = np.asarray(places, np.float64)
        matrix = self.plan_from_world
        points = np.concatenate([places, np.full((*places.shape[:-1], 1), self.floor_height)], axis=-1)
        return np.asarray((points - matrix[:3, 3]) @ matrix[:3, :3])

    def picture(self, scale: int = 4) -> NDArray[np.uint8]:
        """The plan from above, the highest y at the top, sRGB: ``(height, width, 3)`` of the grid times ``scale``, 1 to 32.

        Raises ``ValueError`` for another ``scale``.
        """
        if not 1 <= scale <= 32:
            raise ValueError(f"scale is {scale}, expected 1 to 32")
        pixels, width, height = self._plan.picture(scale)
        return np.array(bytearray(pixels), np.uint8).reshape(height, width, 3)

    def __repr__(self) -> str:
        height, width = self.grid.shape
        return f"<splatseg.FloorPlan: {width} x {height} cells, {len(self.rooms)} rooms>"


def _two(values: list[float]) -> tuple[float, float]:
    return (values[0], values[1])


def _place(values: ArrayLike) -> list[float]:
    place = np.asarray(values, np.float64)
    if place.shape != (2,):
        raise ValueError(f"a place has the shape {place.shape}, expected (2,): x and y of the plan")
    return [float(place[0]), float(place[1])]


def _room(data: dict[str, Any]) -> PlanRoom:
    doors = tuple(Door(door["to"], _two(door["place"]), door["width_m"]) for door in data["doors"])
    name, source = data.get("name"), data.get("name_source")
    return PlanRoom(data["id"], name, source, _two(data["middle"]), data["area_m2"], doors)


def _footprint(data: dict[str, Any]) -> Footprint:
    return Footprint(
        id=data["id"],
        label=data["label"],
        room=data["room"],
        center=_two(data["center"]),
        outlines=tuple(np.array(outline, np.float64).reshape(-1, 2) for outline in data["footprint"]),
        heights=_two(data["heights"]),
        area_m2=data["area_m2"],
    )


def _rotation(quaternion: list[float]) -> NDArray[np.float64]:
    """The matrix of a quaternion x, y, z, w."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
