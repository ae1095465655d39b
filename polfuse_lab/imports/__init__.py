"""Foreign recordings into sessions and products. Names are imported when they are first used."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from polfuse_lab.imports.frames_session import FramesImport, import_frames
    from polfuse_lab.imports.sar_wav import SarWavImport, import_sar_wav
    from polfuse_lab.imports.wav import WavImport, import_wav

__all__ = ["FramesImport", "SarWavImport", "WavImport", "import_frames", "import_sar_wav", "import_wav"]

_HOMES = {
    "FramesImport": "frames_session",
    "SarWavImport": "sar_wav",
    "WavImport": "wav",
    "import_frames": "frames_session",
    "import_sar_wav": "sar_wav",
    "import_wav": "wav",
}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: the command line reads the table of formats only."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
