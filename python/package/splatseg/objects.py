"""Objects: in one frame, and in the whole video."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, SupportsIndex, TypeVar, overload

from . import _splatseg
from .optional import require

if TYPE_CHECKING:
    import pandas
    from typing_extensions import Self

_MOST_IDS = 12
_POINT = ("x", "y", "z")


@dataclass(frozen=True, repr=False)
class ObjectSighting:
    """An object in one frame."""

    id: int
    """Its id, the same in every frame."""
    area: int
    """Number of pixels that show it."""
    bounding_box: tuple[int, int, int, int]
    """The smallest box around them as in COCO: x, y, width, height, pixels."""
    confidence: float
    """Confidence of the id, from 0 to 1: the mean over these pixels."""
    first_frame: int
    """The first frame that showed it; 0 is the first frame of the run."""
    last_frame: int
    """The last frame that showed it: this one."""

    @property
    def color(self) -> tuple[int, int, int]:
        """Its colour in overlays, sRGB."""
        return _splatseg.segment_color(self.id)

    def __repr__(self) -> str:
        return f"<splatseg.ObjectSighting {self.id}: {self.area} pixels, confidence {self.confidence:.2f}>"

    def _row(self) -> dict[str, Any]:
        return {
            "id": self.id,
            "area": self.area,
            **_cells("", ("x", "y", "width", "height"), self.bounding_box),
            "confidence": self.confidence,
            "first_frame": self.first_frame,
            "last_frame": self.last_frame,
        }


@dataclass(frozen=True)
class FrameStamp:
    """A frame of a run."""

    number: int
    """Its position in the run, from 0."""
    name: str | None
    """Its name."""
    time_s: float | None
    """Its timestamp, seconds."""


@dataclass(frozen=True)
class BestView:
    """The best view of an object."""

    frame: FrameStamp
    """The frame."""
    bounding_box: tuple[int, int, int, int]
    """The smallest box around the object's pixels: x, y, width, height."""
    area_px: int
    """Number of its pixels."""
    confidence: float
    """Confidence of the id in this frame, from 0 to 1."""


@dataclass(frozen=True)
class Shape:
    """An object's shape in the world, metres."""

    centroid: tuple[float, float, float]
    """Mean of its surface."""
    axis_aligned_box: tuple[tuple[float, float, float], tuple[float, float, float]]
    """Minimum and maximum coordinates."""
    center: tuple[float, float, float]
    """The centre of the oriented box, the tightest box of any orientation."""
    size: tuple[float, float, float]
    """The side lengths of the oriented box."""
    rotation: tuple[float, float, float, float]
    """Quaternion x, y, z, w that rotates the oriented box's axes into the world's."""
    area_m2: float
    """Area of the seen surface, square metres."""
    points: int
    """Number of its Gaussians, without those whose distance is not known."""
    completed_points: int
    """Number of these that continue a measured surface where depth is missing, as on a screen."""


@dataclass(frozen=True, repr=False)
class Object:
    """An object of the whole video, as in ``objects.json``."""

    id: int
    """Its id."""
    label: str | None
    """Its label from :meth:`Pipeline.name_objects`."""
    state: str | None
    """``remembered``, ``tentative`` (seen once, may be a mistake) or ``forgotten``; ``None`` without a memory."""
    frames: int
    """Number of frames that showed it."""
    first_seen: FrameStamp | None
    """The first frame that showed it; ``None`` for an object of a loaded memory that was not seen again."""
    last_seen: FrameStamp | None
    """The last frame that showed it."""
    confidence: float | None
    """The mean of its confidence over these frames, from 0 to 1."""
    color: tuple[int, int, int] | None
    """Its mean colour, sRGB."""
    shape: Shape | None
    """Its shape; ``None`` if it has no Gaussians."""
    best_view: BestView | None
    """Its best view."""
    label_score: float | None = None
    """How clearly the label fits, from 0 to 1; ``None`` if that is not known, as for labels given by hand."""
    label_alternatives: tuple[tuple[str, float], ...] = ()
    """Other labels that fit, best first, each with its score."""

    @property
    def centroid(self) -> tuple[float, float, float] | None:
        """Mean of its surface, world, metres; ``None`` if it has no Gaussians."""
        return self.shape.centroid if self.shape is not None else None

    @property
    def box(self) -> tuple[tuple[float, float, float], tuple[float, float, float]] | None:
        """The axis-aligned box, world, metres; ``None`` if it has no Gaussians."""
        return self.shape.axis_aligned_box if self.shape is not None else None

    def __repr__(self) -> str:
        label = f" {self.label!r}" if self.label is not None else ""
        at = f", at ({', '.join(f'{value:.2f}' for value in self.centroid)}) m" if self.centroid is not None else ""
        state = f"{self.state}, " if self.state is not None else ""
        return f"<splatseg.Object {self.id}{label}: {state}in {self.frames} frames{at}>"

    def _row(self) -> dict[str, Any]:
        """Its line of ``objects.csv``."""
        shape, view = self.shape, self.best_view
        box = shape.axis_aligned_box if shape else (None, None)
        return {
            "id": self.id,
            "label": self.label,
            "state": self.state,
            "frames": self.frames,
            "confidence": self.confidence,
            **_stamp_cells("first", self.first_seen),
            **_stamp_cells("last", self.last_seen),
            **_cells("", ("red", "green", "blue"), self.color),
            **_cells("centroid_", _POINT, shape.centroid if shape else None),
            **_cells("min_", _POINT, box[0]),
            **_cells("max_", _POINT, box[1]),
            **_cells("center_", _POINT, shape.center if shape else None),
            **_cells("size_", _POINT, shape.size if shape else None),
            **_cells("rotation_", (*_POINT, "w"), shape.rotation if shape else None),
            "area_m2": shape and shape.area_m2,
            "points": shape and shape.points,
            "best_frame": view and view.frame.number,
            "best_name": view and view.frame.name,
            **_cells("best_", ("x", "y", "width", "height"), view.bounding_box if view else None),
            "completed_points": shape and shape.completed_points,
            "label_score": self.label_score,
        }


_Entry = TypeVar("_Entry", bound=Object | ObjectSighting)


class _Entries(list[_Entry]):
    """A list that can become a table."""

    _columns: tuple[str, ...]

    @overload
    def __getitem__(self, index: SupportsIndex, /) -> _Entry: ...
    @overload
    def __getitem__(self, index: slice, /) -> Self: ...
    def __getitem__(self, index: SupportsIndex | slice, /) -> _Entry | Self:
        if isinstance(index, slice):
            return type(self)(super().__getitem__(index))
        return super().__getitem__(index)

    def to_df(self) -> pandas.DataFrame:
        """A table of pandas with one row for each, in the order of the list. Needs ``pip install pandas``."""
        data_frame = require("pandas", "pandas", "to_df").DataFrame
        frame: pandas.DataFrame = data_frame([entry._row() for entry in self], columns=list(self._columns))
        return frame

    def __repr__(self) -> str:
        ids = ", ".join(str(entry.id) for entry in self[:_MOST_IDS])
        more = ", …" if len(self) > _MOST_IDS else ""
        return f"<splatseg.{type(self).__name__}: {len(self)} objects" + (f", ids {ids}{more}>" if self else ">")


def _cells(prefix: str, names: Iterable[str], values: Iterable[Any] | None) -> dict[str, Any]:
    """Columns for the parts of a value; empty if there is none."""
    names = [f"{prefix}{name}" for name in names]
    return dict.fromkeys(names) if values is None else dict(zip(names, values, strict=True))


def _stamp_cells(prefix: str, stamp: FrameStamp | None) -> dict[str, Any]:
    values = (stamp.number, stamp.name, stamp.time_s) if stamp is not None else None
    return _cells(f"{prefix}_", ("frame", "name", "time_s"), values)


class Objects(_Entries[Object]):
    """A list of the objects of a video, the longest seen first.

    The columns of :meth:`to_df` have the names of those in ``objects.csv``. A notebook displays the list as a table.
    """

    _columns = tuple(Object(0, None, None, 0, None, None, None, None, None, None)._row())

    def _repr_html_(self) -> str:
        from .pictures import objects_table

        return objects_table(self, "objects")


class Sightings(_Entries[ObjectSighting]):
    """A list of the objects in one frame, by increasing id."""

    _columns = tuple(ObjectSighting(0, 0, (0, 0, 0, 0), 0.0, 0, 0)._row())


@dataclass(frozen=True)
class FoundObject:
    """An object that :meth:`Pipeline.find` has found."""

    object: Object
    """The object."""
    similarity: float | None
    """Cosine similarity of its embedding, from -1 to 1; ``None`` if it was found by a text."""
    score: float | None = None
    """How well it fits the text, from 0 to 1; ``None`` if it was found by an embedding."""


def parse(entry: dict[str, Any]) -> Object:
    """Parses an object of ``objects.json``."""
    shape, view = entry["shape"], entry["best_view"]
    return Object(
        id=entry["id"],
        label=entry["label"],
        state=entry["state"],
        frames=entry["frames"],
        first_seen=_stamp(entry["first_frame"]),
        last_seen=_stamp(entry["last_frame"]),
        confidence=entry["confidence"],
        color=entry["color"] and tuple(entry["color"]),
        shape=shape and _shape(shape),
        best_view=view
        and BestView(
            frame=FrameStamp(view["frame"]["number"], view["frame"]["name"], view["frame"]["time_s"]),
            bounding_box=tuple(view["bounding_box"][key] for key in ("x", "y", "width", "height")),
            area_px=view["area_px"],
            confidence=view["confidence"],
        ),
        label_score=entry.get("label_score"),
        label_alternatives=tuple((other["label"], other["score"]) for other in entry.get("label_alternatives", ())),
    )


def _stamp(stamp: dict[str, Any] | None) -> FrameStamp | None:
    return FrameStamp(stamp["number"], stamp["name"], stamp["time_s"]) if stamp is not None else None


def _shape(shape: dict[str, Any]) -> Shape:
    aligned, oriented = shape["axis_aligned_box"], shape["oriented_box"]
    return Shape(
        centroid=tuple(shape["centroid"]),
        axis_aligned_box=(tuple(aligned["min"]), tuple(aligned["max"])),
        center=tuple(oriented["center"]),
        size=tuple(oriented["size"]),
        rotation=tuple(oriented["rotation"]),
        area_m2=shape["area_m2"],
        points=shape["points"],
        completed_points=shape["completed_points"],
    )
