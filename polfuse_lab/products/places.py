"""Places on the ground and in the camera's picture that the fusion registered to each other."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from polfuse_lab.products.store import Products


class Places:
    """Both ways between the ground and the camera's pixels, as the stage "fusion" holds them.

    Args:
        arrays: of that stage.
    """

    def __init__(self, arrays: dict[str, NDArray[Any]]) -> None:
        self._x, self._y = arrays["x_m"], arrays["y_m"]
        self._u, self._v = (arrays[name].astype(np.float64) for name in ("u_px", "v_px"))
        self._known = np.isfinite(self._u) & np.isfinite(self._v)
        at = np.stack([self._u[self._known], self._v[self._known]], axis=-1)
        self._tree = cKDTree(at) if len(at) else None
        # As far as from there to its furthest neighbour, a camera pixel shows what is in a radar pixel.
        self._reach = 0.75 * _furthest(self._u, self._v)[self._known] + 0.5

    def pixels(self, columns: ArrayLike, rows: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column of the ground's pixel that is registered nearest to camera pixels; -1 where none is near."""
        wanted = np.stack(np.broadcast_arrays(columns, rows), axis=-1).astype(np.float64)
        if self._tree is None:
            missed = np.full(wanted.shape[:-1], -1, dtype=np.int64)
            return missed, missed
        distance, number = self._tree.query(wanted)
        near = distance <= self._reach[number]
        i, k = (np.where(near, places[number], -1) for places in np.nonzero(self._known))
        return i, k

    def to_ground(self, column: float, row: float) -> tuple[float, float] | None:
        """Place (x, y) of a camera pixel, m; None where the fusion knows none."""
        i, k = (int(number) for number in self.pixels(column, row))
        return (float(self._x[k]), float(self._y[i])) if i >= 0 else None

    def to_camera(self, x_m: float, y_m: float) -> tuple[float, float] | None:
        """Camera pixel (column, row) of a place; None outside the grid and where the camera does not see it."""
        i, k = pixel_of(self._y, y_m), pixel_of(self._x, x_m)
        if i is None or k is None or not self._known[i, k]:
            return None
        return float(self._u[i, k]), float(self._v[i, k])


def load_places(products: Products) -> Places | None:
    """What a file knows of both planes; None where nothing was registered by geometry."""
    if "fusion" not in products.stages() or products.settings("fusion").get("registration") == "identity":
        return None
    return Places(products.read("fusion"))


def pixel_of(axis: NDArray[np.floating], value: float) -> int | None:
    """Number of the pixel of an even axis that a place is in; None beside them."""
    step = float(axis[1] - axis[0]) if len(axis) > 1 else 1.0
    number = int(np.floor((value - float(axis[0])) / step + 0.5))
    return number if 0 <= number < len(axis) else None


def _furthest(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each pixel's furthest neighbour in the camera's picture."""
    reach = np.zeros(u.shape)
    for axis in (0, 1):
        gap = np.nan_to_num(np.hypot(np.diff(u, axis=axis), np.diff(v, axis=axis)))
        before, after = ([(0, 0), (0, 0)] for _ in range(2))
        before[axis], after[axis] = (1, 0), (0, 1)
        reach = np.maximum(reach, np.maximum(np.pad(gap, before), np.pad(gap, after)))
    return reach
