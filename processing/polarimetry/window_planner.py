"""How wide a window must be: the error that speckle leaves in an average, foretold from the matrices themselves.

Of n independent looks with the mean T the sample matrix has ``E |T^_ij - T_ij|^2 = T_ii T_jj / n`` (complex Wishart;
Goodman 1963, Ann. Math. Stat. 34, 152). Summed over the nine planes and over the image, relative to the planes' own
squares, that is the squared error of an average of n looks. What windows do to edges is not counted: of all windows
that keep a tolerance the smallest does least of it, and is chosen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from processing.errors import DataError
from processing.polarimetry.averaging import window_average
from processing.polarimetry.matrices import Planes, as_planes
from processing.tolerances import check_tolerance

WINDOWS = (1, 3, 5, 7, 9, 11, 13, 15, 17, 21, 25, 31)
"""Widths that are chosen from, pixels."""
PILOT = 7
"""Width of the average that stands for the mean, pixels."""
SAFETY_DB = 0.5
"""How far below the tolerance the expected error must be."""


@dataclass(frozen=True)
class WindowChoice:
    """A window, and why."""

    window: int
    """Odd width, pixels."""
    predicted_error_db: float
    """Root mean square over the image, relative to the matrices, dB."""
    reason: str
    considered: tuple[tuple[int, float], ...]
    """All windows with their expected errors."""

    def explain(self) -> list[str]:
        """The choice in words."""
        lines = [f"window {self.window}: {self.reason}; expected error {self.predicted_error_db:.1f} dB"]
        smaller = [(width, error) for width, error in self.considered if width < self.window]
        larger = [(width, error) for width, error in self.considered if width > self.window]
        if smaller:
            lines.append(f"not {smaller[-1][0]}: {smaller[-1][1]:.1f} dB would be left of the speckle")
        if larger:
            lines.append(f"not {larger[0][0]}: blurs edges further ({larger[0][1]:.1f} dB)")
        return lines


def speckle_error_db(planes: Planes, looks: float) -> float:
    """Expected error of a single pixel's matrix, dB: root mean square over the image, relative to the matrices.

    Args:
        planes: (9, rows, columns), see :data:`processing.polarimetry.matrices.PLANES`.
        looks: independent looks in each pixel.

    Raises:
        DataError: looks that are not positive, or no defined pixel with power.
    """
    if not (looks > 0 and math.isfinite(looks)):
        raise DataError(f"{looks} looks in a pixel", "give a positive number")
    given = as_planes(planes)
    if not given.size:
        raise DataError("there are no pixels to average", "give an image")
    mean = window_average(given, PILOT).astype(np.float64)
    mean = mean[:, np.isfinite(mean).all(axis=0)]
    diagonal = mean[[0, 5, 8]]
    trace = diagonal.sum(axis=0)
    # Variances of three real planes and of three complex ones: sum_i T_ii^2 + sum_(i<j) T_ii T_jj.
    varies = float(((diagonal**2).sum() + (trace**2).sum()) / 2)
    power = float((mean**2).sum())
    if not power > 0:
        raise DataError("no pixel has power", "check the image")
    # The pilot's own speckle is in its squares: of n looks varies / n of it.
    power = max(power - varies / (looks * PILOT**2), 0.1 * power)
    return 10 * math.log10(varies / (looks * power))


def choose_window(planes: Planes, tolerance_db: float, *, looks: float = 1.0) -> WindowChoice:
    """The smallest window after which speckle leaves less error than the tolerance; the widest where none does.

    Args:
        planes: as for :func:`speckle_error_db`.
        tolerance_db: largest error, dB (negative).
        looks: independent looks in each pixel; less than there are where neighbours are correlated.

    Raises:
        DataError: a tolerance that is no negative number, and as :func:`speckle_error_db`.
    """
    check_tolerance(tolerance_db, "matrices")
    single = speckle_error_db(planes, looks)
    considered = tuple((width, single - 20 * math.log10(width)) for width in WINDOWS)
    for width, error in considered:
        if error <= tolerance_db - SAFETY_DB:
            return WindowChoice(width, error, f"the smallest within {tolerance_db:g} dB", considered)
    width, error = considered[-1]
    return WindowChoice(width, error, f"nothing on offer reaches {tolerance_db:g} dB: the widest", considered)
