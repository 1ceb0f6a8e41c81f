"""The compiled part; use the package `splatseg` instead."""

import os
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias, final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from typing_extensions import Self

__all__ = [
    "Frames",
    "Lens",
    "Live",
    "Names",
    "Pipeline",
    "Sam2",
    "Scene",
    "Segmenter",
    "__version__",
    "evaluate",
    "merge",
    "overlay",
    "overlay_png",
    "run_command",
    "segment_color",
]

__version__: str

_Path: TypeAlias = str | os.PathLike[str]
_Frame: TypeAlias = tuple[
    int,
    str,
    NDArray[np.uint8],
    NDArray[np.float32],
    NDArray[np.float64],
    NDArray[np.float64] | None,
    float | None,
    NDArray[np.uint32] | None,
]
_Sighting: TypeAlias = tuple[int, int, tuple[int, int, int, int], float, int, int]
_Tracks: TypeAlias = tuple[list[int], NDArray[np.bool_]]

@final
class Lens:
    def __new__(cls) -> Self: ...
    def undistort(
        self,
        rgb: NDArray[np.uint8],
        depth: NDArray[Any],
        k: ArrayLike,
        distortion: tuple[str, list[float]],
        depth_scale: float | None = None,
    ) -> tuple[NDArray[np.uint8], NDArray[np.float32]]: ...

@final
class Live:
    def __new__(
        cls,
        settings: dict[str, Any],
        map: _Path | None = None,
        save_interval: float = 30.0,
        every_frame: bool = False,
        config: _Path | None = None,
        lag: float = 0.0,
    ) -> Self: ...
    @staticmethod
    def outputs() -> list[tuple[str, str, str, bool]]: ...
    def feed(self, topic: str, type_name: str, data: bytes) -> None: ...
    def wants(self, topic: str, type_name: str) -> bool: ...
    def set_wanted(self, names: list[str]) -> None: ...
    def take(self, timeout: float) -> list[tuple[str, bytes]]: ...
    def request(self, name: str) -> str: ...
    def objects(self) -> str: ...
    @property
    def status(self) -> str: ...
    @property
    def frames(self) -> int: ...
    @property
    def sources(self) -> list[str]: ...
    def close(self, finish: bool) -> None: ...

@final
class Names:
    def __new__(
        cls,
        path: _Path,
        vocabulary: _Path | None = None,
        labels: list[str] | None = None,
        min_score: float | None = None,
    ) -> Self: ...
    def labels(self) -> list[str]: ...
    def embed_text(self, text: str) -> NDArray[np.float32]: ...

@final
class Pipeline:
    def __new__(
        cls,
        settings: dict[str, Any],
        segmenter: Callable[..., Any] | None = None,
        config: _Path | None = None,
        saved_memory: _Path | None = None,
        keep_views: bool = False,
    ) -> Self: ...
    @property
    def settings(self) -> str: ...
    @property
    def frames(self) -> int: ...
    @property
    def has_memory(self) -> bool: ...
    def step(
        self,
        rgb: NDArray[np.uint8],
        depth: NDArray[Any],
        k: ArrayLike,
        camera_to_world: ArrayLike | None = None,
        timestamp: float | None = None,
        name: str | None = None,
        depth_scale: float | None = None,
    ) -> tuple[
        NDArray[np.uint32],
        NDArray[np.float32],
        list[_Sighting],
        NDArray[np.bool_] | None,
        list[tuple[str, float]],
        NDArray[np.float64],
        str,
        list[tuple[int, int]],
        NDArray[np.uint32] | None,
    ]: ...
    def settle(self) -> bool: ...
    def look_again(
        self,
        rgb: NDArray[np.uint8],
        depth: NDArray[Any],
        k: ArrayLike,
        camera_to_world: ArrayLike,
        ids: NDArray[np.uint32],
        regions: NDArray[np.uint32] | None = None,
        depth_scale: float | None = None,
    ) -> NDArray[np.uint32]: ...
    def objects(self) -> str: ...
    def name_objects(
        self,
        callable: Callable[[NDArray[np.uint8], NDArray[np.bool_], str], tuple[str | None, NDArray[np.float32]]],
    ) -> int: ...
    def find(self, embedding: NDArray[np.float32]) -> list[tuple[int, float]]: ...
    def name_with_network(self, names: Names) -> int: ...
    def finish_names(self) -> int: ...
    def name_by_hand(self, id: int, label: str | None) -> None: ...
    def find_text(self, text: str) -> list[tuple[int, float]]: ...
    def clear_names(self) -> None: ...
    def save(self, path: _Path) -> None: ...
    def gaussian_count(self) -> int: ...
    def means(self) -> NDArray[np.float64]: ...
    def radii(self) -> NDArray[np.float32]: ...
    def colors(self) -> NDArray[np.uint8]: ...
    def has_place(self) -> NDArray[np.bool_]: ...
    def segment_ids(self) -> NDArray[np.uint32]: ...

@final
class Segmenter:
    def __new__(cls, settings: dict[str, Any]) -> Self: ...
    def segment(
        self,
        rgb: NDArray[np.uint8],
        depth: NDArray[Any] | None = None,
        k: ArrayLike | None = None,
        depth_scale: float | None = None,
    ) -> tuple[NDArray[np.bool_], NDArray[np.float32]]: ...

@final
class Sam2:
    def __new__(cls, settings: dict[str, Any]) -> Self: ...
    def step(self, rgb: NDArray[np.uint8]) -> _Tracks: ...
    def add_mask(self, id: int, mask: NDArray[np.bool_]) -> _Tracks: ...
    def add_points(
        self,
        id: int,
        points: ArrayLike | None = None,
        labels: ArrayLike | None = None,
        box: ArrayLike | None = None,
        more: bool = False,
    ) -> _Tracks: ...
    def remove(self, id: int) -> None: ...

@final
class Frames:
    def __iter__(self) -> Iterator[_Frame | str]: ...
    def __next__(self) -> _Frame | str: ...

@final
class Scene:
    def __new__(cls, path: _Path, settings: dict[str, Any]) -> Self: ...
    @property
    def name(self) -> str: ...
    @property
    def format(self) -> str | None: ...
    @property
    def has_poses(self) -> bool: ...
    @property
    def has_ground_truth(self) -> bool: ...
    def __len__(self) -> int: ...
    def frame(self, index: int) -> _Frame: ...
    def frames(self) -> Frames: ...

def evaluate(
    gt: _Path,
    predictions: _Path,
    settings: dict[str, Any],
    protocol: str,
    exclude_void: bool,
    min_truth_area: float,
    allow_missing: bool,
    ids: bool,
) -> str: ...
def merge(earlier: _Path, later: _Path, out: _Path, transform: list[float] | None) -> str: ...
def overlay(rgb: NDArray[np.uint8], ids: NDArray[np.integer]) -> NDArray[np.uint8]: ...
def overlay_png(rgb: NDArray[np.uint8], ids: NDArray[np.integer]) -> bytes: ...
def segment_color(id: int) -> tuple[int, int, int]: ...
def run_command(arguments: list[str], program: list[str]) -> int: ...
