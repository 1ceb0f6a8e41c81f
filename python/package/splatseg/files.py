"""Files that are written."""

from __future__ import annotations

import os


def require_new(path: str | os.PathLike[str], overwrite: bool) -> None:
    """Raises ``FileExistsError`` if a file exists, unless ``overwrite``."""
    if not overwrite and os.path.lexists(path):
        raise FileExistsError(f"{os.fspath(path)}: exists: pass overwrite=True to replace it")
