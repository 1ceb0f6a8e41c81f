"""Recorded scenes."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from typing import Any

from . import _splatseg
from .forking import require_threads, use_threads
from .frame import Frame


class Scene:
    """A recorded RGB-D video of any format that ``splatseg run`` reads. Iterating reads frames ahead in the background.

    Iterating skips a frame that cannot be used, with a ``UserWarning`` that states the reason; ``scene[i]`` raises
    ``ValueError`` instead.
    """

    def __init__(self, path: str | os.PathLike[str], **settings: Any) -> None:
        require_threads()
        self._scene = _splatseg.Scene(path, settings)
        self.path = os.fspath(path)
        """The path, as given."""
        self._guess = self._scene.guessed_camera
        if self._guess is not None:
            use_threads()
            warnings.warn(f"{self.path}: {self._guess[1].replace('--fx PIXELS', 'fx=PIXELS')}", stacklevel=3)

    @property
    def name(self) -> str:
        """The scene's name, e.g. its folder's."""
        return self._scene.name

    @property
    def format(self) -> str | None:
        """The recognised format, e.g. ``mcap``."""
        return self._scene.format

    @property
    def has_poses(self) -> bool:
        """True if at least one frame is expected to have a pose. The others have ``camera_to_world`` = ``None``."""
        return self._scene.has_poses

    @property
    def has_depth(self) -> bool:
        """False if no frame has depth, as in a video: it must be predicted."""
        return self._scene.has_depth

    @property
    def guessed_camera(self) -> dict[str, float | bool] | None:
        """The focal length in pixels of the stored images, if nothing describes the camera, with which a ``UserWarning`` is
        given: ``fx``, its range ``from``, ``to``, whether the motion in the images tells it (``estimated``) and whether the
        lens seems to distort (``distorts``). ``None`` if the camera is known."""
        return None if self._guess is None else self._guess[0]

    @property
    def has_ground_truth(self) -> bool:
        """True if frames may have true ids."""
        return self._scene.has_ground_truth

    def __len__(self) -> int:
        """The number of frames that the settings select."""
        return len(self._scene)

    def __getitem__(self, index: int) -> Frame:
        """Reads one of the selected frames, given by its position among them."""
        self._prepare()
        return Frame(*self._scene.frame(index))

    def __iter__(self) -> Iterator[Frame]:
        self._prepare()
        for item in self._scene.frames():
            if isinstance(item, str):
                warnings.warn(f"frame skipped: {item}", stacklevel=2)
            else:
                yield Frame(*item)

    def _prepare(self) -> None:
        """Called before frames are read. Recorded ones need none of the threads that a fork loses."""
        if self.format == "synthetic":
            use_threads()

    def _usable_frames(self) -> Iterator[Frame]:
        """As iterating, but raises ``ValueError`` for a frame that cannot be used."""
        self._prepare()
        for item in self._scene.frames():
            if isinstance(item, str):
                raise ValueError(f"{item} (strict_input ends the run)")  # noqa: TRY004
            yield Frame(*item)

    def __repr__(self) -> str:
        return f"<splatseg.Scene {self.path!r}: {self.format}, {len(self)} frames>"


def open_scene(path: str | os.PathLike[str], **settings: Any) -> Scene:
    """Opens a scene: a folder or file of any format, or ``synthetic[:frames=60,seed=3,...]``.

    ``settings`` are those of the section ``dataset``, without its name: ``stride=2``, ``resize="320x240"``,
    ``crop_border=5``, ``start``, ``max_frames``, ``format``; ``fx``, ``fy``, ``cx`` and ``cy`` for a camera without a
    calibration file; and for recordings ``color``, ``depth``, ``camera_info``, ``pose``.

    Raises ``ValueError`` if there is no scene or a setting is out of range, ``TypeError`` for unknown settings.
    """
    return Scene(path, **settings)
