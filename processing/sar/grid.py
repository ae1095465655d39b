"""The ground on which images are formed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class ImageGrid:
    """A regular grid on the plane ``z = z_m`` in rig coordinates: x along the rail, y away from it.

    Images on it have shape (..., len(y_m), len(x_m)): rows are ground range, increasing away from the rail.
    """

    x_m: NDArray[np.float64]
    y_m: NDArray[np.float64]
    z_m: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows (y) and columns (x)."""
        return len(self.y_m), len(self.x_m)
