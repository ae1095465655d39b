"""Where real recordings are, for tests that use them when they are present."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


def real_data(name: str) -> Path:
    """Path of a real recording; skips the calling test where it is absent."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    root = Path(os.environ.get("POLFUSE_DATA", beside))
    path = root / name
    if not path.exists():
        pytest.skip(f"real recording {name} is not present (set POLFUSE_DATA to its folder)")
    return path
