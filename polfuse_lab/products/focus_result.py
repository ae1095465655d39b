"""What focusing made."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from processing.sar.grid import ImageGrid
from processing.sar.planner import Choice
from processing.sar.quality import Peak


@dataclass(frozen=True)
class FocusResult:
    """What was focused, how, and what stands out."""

    products: Path
    image: NDArray[np.complexfloating]
    """(channels, ny, nx)."""
    grid: ImageGrid
    channels: tuple[str, ...]
    choice: Choice
    settings: dict[str, Any]
    pulses: int
    """Positions along the rail."""
    seconds: float
    peaks: list[Peak]
    """Of the span (root of the sum of the channels' powers), strongest first."""
    warnings: list[str]
    explanation: tuple[str, ...] = ()
    """The planner's choice in words, line by line."""

    @property
    def pixels(self) -> int:
        """Pixels of one channel."""
        return self.grid.shape[0] * self.grid.shape[1]
