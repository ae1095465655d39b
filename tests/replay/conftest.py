from __future__ import annotations

import sys
from pathlib import Path

# The fake devices and the bench around them are those of the engine's tests.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "engine"))

from engine.conftest import bench  # noqa: F401
