from __future__ import annotations

import sys
from pathlib import Path

# Point targets in closed form are those of the SAR tests.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "sar"))
