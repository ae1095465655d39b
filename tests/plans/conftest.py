from __future__ import annotations

import sys
from pathlib import Path

# Sessions of closed-form targets are those of the SAR tests; fake devices and their bench those of the engine's.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS / "sar"), str(_TESTS / "engine")]

from engine.conftest import bench  # noqa: E402, F401
