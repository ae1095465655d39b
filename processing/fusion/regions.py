"""Regions of the ground as polygons."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError


def polygon_mask(polygon_m: ArrayLike, x_m: ArrayLike, y_m: ArrayLike) -> NDArray[np.bool_]:
    """Pixels of a grid whose centre lies in a polygon, (ny, nx), by the even-odd rule.

    Args:
        polygon_m: (n, 2) corners x, y in order, m; the last is joined to the first.
        x_m, y_m: the grid's axes, m.

    Raises:
        DataError: fewer than three finite corners.
    """
    corners = np.asarray(polygon_m, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3 or not np.isfinite(corners).all():
        raise DataError(f"a polygon of shape {corners.shape}", "give at least three finite corners [x, y]")
    x, y = np.meshgrid(np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64))
    inside = np.zeros(x.shape, dtype=bool)
    for (x0, y0), (x1, y1) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if y0 == y1:
            continue
        spans = (y0 > y) != (y1 > y)
        inside ^= spans & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
    return inside
