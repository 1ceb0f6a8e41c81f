"""Packages that single functions need, and that are not installed with splatseg."""

from __future__ import annotations

import importlib
from typing import Any


def require(module: str, package: str, what: str) -> Any:
    """Imports a module of an optional package.

    Raises ``ImportError`` with the command that installs the package, if it is missing. ``what`` needs it.
    """
    top = module.partition(".")[0]
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        # A package that is there, but lacks another one, says so itself.
        if error.name not in (top, module):
            raise
        raise ImportError(f"{what} needs {top}: pip install {package}") from None
