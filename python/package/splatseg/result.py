"""The result for one frame."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from . import _splatseg
from .objects import Object, ObjectSighting

if TYPE_CHECKING:
    import supervision


@dataclass(frozen=True, eq=False)
class StepResult:
    """The result of a step for a frame. A notebook displays it as a picture."""

    ids: NDArray[np.uint32]
    """The persistent object id of each pixel, ``(height, width)``; 0 where there is no segment."""
    confidence: NDArray[np.float32]
    """Confidence of each pixel's id, ``(height, width)``, from 0 to 1; 0 where there is no segment."""
    objects: list[ObjectSighting]
    """The objects in the frame, by increasing id."""
    times_ms: dict[str, float]
    """Time of each stage, milliseconds; ``step`` is the library's time for the whole frame, without Python's
    overhead."""
    rgb: NDArray[np.uint8] = field(repr=False)
    """The frame's colours, as given."""
    depth: NDArray[np.generic] = field(repr=False)
    """The frame's depth, as given."""
    K: NDArray[np.float64] = field(repr=False)
    """The camera matrix."""
    camera_to_world: NDArray[np.float64] = field(repr=False)
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
    regions: NDArray[np.uint32] | None = field(default=None, repr=False)
    """The segmenter's finer cut, ``(height, width)``: pixels of a region lie in one object. Of a frame larger than
    ``working_pixels`` it has the resolution at which that was processed. ``None`` if there is none."""
    _masks: NDArray[np.bool_] | None = field(default=None, repr=False)
    _depth_scale: float | None = field(default=None, repr=False)

    @property
    def masks(self) -> NDArray[np.bool_]:
        """The mask of each of ``objects``, ``(objects, height, width)``. They may overlap where a tracker made them."""
        if self._masks is not None:
            return self._masks
        own = np.array([sighting.id for sighting in self.objects], dtype=self.ids.dtype)
        return self.ids == own[:, None, None]

    def to_supervision(self, objects: Iterable[Object] = ()) -> supervision.Detections:
        """The objects as ``supervision.Detections`` with boxes, masks, confidence and ``tracker_id``.

        With ``objects``, e.g. ``pipeline.objects()``, ``data["class_name"]`` has their labels, and ``class_id`` the place of
        each label among them in alphabetical order, from 1. Objects without a label are of class 0, ``object``. Needs ``pip install splatseg[supervision]``.
        """
        import supervision

        labels = {entry.id: entry.label for entry in objects if entry.label}
        classes = {label: index for index, label in enumerate(sorted(set(labels.values())), 1)}
        names = [labels.get(sighting.id, "object") for sighting in self.objects]
        boxes = np.array([sighting.bounding_box for sighting in self.objects], dtype=np.float32).reshape(-1, 4)
        corners = np.concatenate([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]], axis=1)
        return supervision.Detections(
            xyxy=corners,
            mask=self.masks,
            confidence=np.array([sighting.confidence for sighting in self.objects], dtype=np.float32),
            class_id=np.array([classes.get(labels.get(sighting.id), 0) for sighting in self.objects], dtype=int),
            tracker_id=np.array([sighting.id for sighting in self.objects], dtype=int),
            data={"class_name": np.array(names, dtype=str)},
        )

    def overlay_png(self) -> bytes:
        """The frame with every object tinted, outlined and numbered, as a PNG."""
        return _splatseg.overlay_png(self.rgb, self.ids)

    def _repr_png_(self) -> bytes:
        return self.overlay_png()
