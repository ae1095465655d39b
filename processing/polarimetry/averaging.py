"""Window averages of matrix images: what turns single looks into coherency matrices.

Each window is summed anew: running sums keep the rounding of a strong pixel long after it has left the window, which at
120 dB of dynamic range spoils its neighbours.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from processing.errors import DataError
from processing.polarimetry.matrices import Planes, as_planes


def window_average(planes: Planes, window: int) -> Planes:
    """Mean of (9, rows, columns) planes over ``window`` x ``window`` pixels around each pixel.

    Pixels outside the image and pixels with a NaN in any plane are left out of the mean (so borders are averaged over
    what is there); a pixel that is itself undefined stays NaN in every plane. Sums are float64.

    Args:
        planes: see :data:`processing.polarimetry.matrices.PLANES`.
        window: odd width, pixels; 1 averages nothing.

    Raises:
        DataError: the window is even or not positive, or the planes have another shape.
    """
    given = _checked(planes, window)
    defined = np.asarray(np.isfinite(given).all(axis=0))
    made = np.empty_like(given)
    _average(given, defined, window // 2, made)
    return made


def window_average_reference(planes: Planes, window: int) -> NDArray[np.float64]:
    """The definition of :func:`window_average` in NumPy and float64."""
    given = _checked(planes, window).astype(np.float64)
    defined = np.asarray(np.isfinite(given).all(axis=0))
    reach = window // 2
    around = ((0, 0), (reach, reach), (reach, reach))
    views = np.lib.stride_tricks.sliding_window_view
    sums = views(np.pad(np.where(defined, given, 0.0), around), (window, window), axis=(1, 2)).sum(axis=(-2, -1))
    counts = views(np.pad(defined[None].astype(float), around), (window, window), axis=(1, 2)).sum(axis=(-2, -1))
    return np.where(defined, sums / np.maximum(counts, 1), np.nan)


def _checked(planes: Planes, window: int) -> Planes:
    if window < 1 or window % 2 == 0:
        raise DataError(f"a window of {window} pixels has no centre", "take an odd number such as 3, 5 or 7")
    return as_planes(planes)


@njit(cache=True, nogil=True, parallel=True)
def _average(planes: NDArray[Any], defined: NDArray[np.bool_], reach: int, made: NDArray[Any]) -> None:
    for row in prange(planes.shape[1]):
        # prange counts unsigned; without the cast the row would be compiled for both kinds of numbers.
        _average_row(planes, defined, reach, made, np.int64(row))


@njit(cache=True, nogil=True)
def _average_row(planes: NDArray[Any], defined: NDArray[np.bool_], reach: int, made: NDArray[Any], row: Any) -> None:
    count, rows, columns = planes.shape
    above, below = max(row - reach, 0), min(row + reach + 1, rows)
    sums = np.zeros(columns + 2 * reach)
    inverse, totals = np.empty(columns), np.empty(columns)
    for r in range(above, below):
        for c in range(columns):
            sums[c + reach] += 1.0 if defined[r, c] else 0.0
    for c in range(columns):
        total = 0.0
        for k in range(2 * reach + 1):
            total += sums[c + k]
        inverse[c] = 1.0 / total if defined[row, c] else np.nan
    for plane in range(count):
        sums[:] = 0.0
        for r in range(above, below):
            for c in range(columns):
                sums[c + reach] += planes[plane, r, c] if defined[r, c] else 0.0
        # Pixels of a row in the inner loop: independent sums, which the compiler makes several of at a time.
        totals[:] = 0.0
        for k in range(2 * reach + 1):
            for c in range(columns):
                totals[c] += sums[c + k]
        for c in range(columns):
            made[plane, row, c] = totals[c] * inverse[c]
