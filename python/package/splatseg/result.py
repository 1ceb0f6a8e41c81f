"""The result for one frame."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from . import _splatseg
from .forking import use_threads
from .objects import Object, Sightings
from .optional import require

if TYPE_CHECKING:
    import pandas
    import supervision


@dataclass(frozen=True, eq=False, repr=False)
class StepResult:
    """The result of a step for a frame. A notebook displays it as a picture."""

    ids: NDArray[np.uint32]
    """The persistent object id of each pixel, ``(height, width)``; 0 where there is no segment."""
    confidence: NDArray[np.float32]
    """Confidence of each pixel's id, ``(height, width)``, from 0 to 1; 0 where there is no segment."""
    objects: Sightings
    """The objects in the frame, by increasing id."""
    times_ms: dict[str, float]
    """Time of each stage, milliseconds; ``step`` is the library's time for the whole frame, without Python's
    overhead."""
    rgb: NDArray[np.uint8]
    """The frame's colours: a copy of those given."""
    depth: NDArray[np.generic]
    """The frame's depth: a copy of that given."""
    K: NDArray[np.float64]
    """The camera matrix."""
    camera_to_world: NDArray[np.float64]
    """The frame's pose, given or tracked; the last known one if tracking is lost."""
    pose_state: str
    """Whether the pose was ``"given"``, is ``"tracked"``, or tracking is ``"lost"``."""
    remapped: list[tuple[int, int]]
    """Ids of earlier frames that turned out to be the same object as an older id: (id that is not used any more, older
    id). The camera came back to a place, and the map was corrected."""
    timestamp: float | None
    """The frame's timestamp, seconds, if given."""
    name: str | None
    """The frame's name, if given."""
    regions: NDArray[np.uint32] | None = None
    """The segmenter's finer cut, ``(height, width)``: pixels of a region lie in one object. Of a frame larger than
    ``working_pixels`` it has the resolution at which that was processed. ``None`` if there is none."""
    _masks: NDArray[np.bool_] | None = None
    _depth_scale: float | None = None
    _anchor: tuple[int, list[float]] | None = None

    @property
    def masks(self) -> NDArray[np.bool_]:
        """The mask of each of ``objects``, ``(objects, height, width)``. They may overlap where a tracker made them."""
        if self._masks is not None:
            return self._masks
        own = np.array([sighting.id for sighting in self.objects], dtype=self.ids.dtype)
        masks: NDArray[np.bool_] = self.ids == own[:, None, None]
        return masks

    def to_supervision(self, objects: Iterable[Object] = ()) -> supervision.Detections:
        """The objects as ``supervision.Detections`` with boxes, masks, confidence and ``tracker_id``.

        ``class_id`` is the id, too: annotators give every class a colour of its own, and here every object. With
        ``objects``, e.g. ``pipeline.objects()``, classes are labels: ``data["class_name"]`` has them, and ``class_id`` the
        place of each among them in alphabetical order, from 1. Objects without a label are of class 0, ``object``.
        Needs ``pip install supervision``.
        """
        ids = np.array([sighting.id for sighting in self.objects], dtype=int)
        labels = {entry.id: entry.label for entry in objects if entry.label}
        numbers = {label: number for number, label in enumerate(sorted(set(labels.values())), 1)}
        names = [labels.get(sighting.id, "object") for sighting in self.objects]
        classes = np.array([numbers.get(name, 0) for name in names], dtype=int) if numbers else ids
        boxes = np.array([sighting.bounding_box for sighting in self.objects], dtype=np.float32).reshape(-1, 4)
        corners = np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)
        detections: supervision.Detections = require("supervision", "supervision", "to_supervision").Detections(
            xyxy=corners,
            mask=self.masks,
            confidence=np.array([sighting.confidence for sighting in self.objects], dtype=np.float32),
            class_id=classes,
            tracker_id=ids.copy(),
            data={"class_name": np.array(names, dtype=str)},
        )
        return detections

    def to_df(self) -> pandas.DataFrame:
        """The objects in the frame as a table of pandas. Needs ``pip install pandas``."""
        return self.objects.to_df()

    def plot(self) -> NDArray[np.uint8]:
        """The frame with every object tinted, outlined and numbered: RGB, ``(height, width, 3)``."""
        use_threads()
        return _splatseg.overlay(self.rgb, self.ids)

    def show(self) -> None:
        """Opens :meth:`plot` in a viewer of pictures. Needs ``pip install pillow``."""
        require("PIL.Image", "pillow", "show").fromarray(self.plot()).show()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes :meth:`plot` to a PNG file.

        Raises ``ValueError`` if the file's name ends otherwise than in ``.png``.
        """
        suffix = Path(path).suffix
        if suffix.lower() not in ("", ".png"):
            raise ValueError(
                f"{os.fspath(path)}: ends in {suffix}, expected .png; PIL.Image.fromarray(r.plot()).save writes other formats"
            )
        Path(path).write_bytes(self.overlay_png())

    def overlay_png(self) -> bytes:
        """:meth:`plot` as the bytes of a PNG."""
        use_threads()
        return _splatseg.overlay_png(self.rgb, self.ids)

    def _repr_png_(self) -> bytes:
        return self.overlay_png()

    def __repr__(self) -> str:
        height, width = self.ids.shape
        name = f" {self.name!r}" if self.name is not None else ""
        return f"<splatseg.StepResult{name}: {len(self.objects)} objects, {width}x{height}, pose {self.pose_state}>"
