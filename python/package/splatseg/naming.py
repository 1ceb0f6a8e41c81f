"""Names of objects from a network for images and words."""

from __future__ import annotations

import os
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from . import _splatseg
from .forking import use_threads


class Names:
    """A network for images and words on the CPU, for :meth:`Pipeline.name_objects`; see :func:`names`."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        vocabulary: str | os.PathLike[str] | Iterable[str] | None = None,
        min_score: float | None = None,
    ) -> None:
        file, labels = None, None
        if isinstance(vocabulary, (str, os.PathLike)):
            file = vocabulary
        elif vocabulary is not None:
            labels = list(vocabulary)
        self._names = _splatseg.Names(path, file, labels, min_score)

    @property
    def labels(self) -> list[str]:
        """The labels that objects can get."""
        return self._names.labels()

    def embed_text(self, text: str) -> NDArray[np.float32]:
        """The embedding of a text, for :meth:`Pipeline.find`."""
        use_threads()
        return self._names.embed_text(text)

    def __repr__(self) -> str:
        return f"<splatseg.Names: {len(self.labels)} labels>"


def names(
    path: str | os.PathLike[str],
    *,
    vocabulary: str | os.PathLike[str] | Iterable[str] | None = None,
    min_score: float | None = None,
) -> Names:
    """Loads a network that names objects: ``pipeline.name_objects(ss.names("pe-core-s16.safetensors"))``.

    ``path`` is a ``.safetensors`` file of CLIP (OpenCLIP or Hugging Face) or Perception Encoder Core. ``vocabulary``: the
    labels, as a list, each with other words for it after commas, or as a text or CSV file; by default about 670 household
    things. ``min_score``: least probability of a label, from 0 to 1; other objects stay without one.

    Raises ``ValueError`` if a file cannot be used.
    """
    return Names(path, vocabulary=vocabulary, min_score=min_score)
