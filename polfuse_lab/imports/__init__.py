"""Foreign recordings into sessions and products. Names are imported when they are first used."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from polfuse_lab.imports.wav import WavImport, import_wav

__all__ = ["WavImport", "import_wav"]

_HOMES = {"WavImport": "wav", "import_wav": "wav"}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: the command line reads the table of formats only."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
