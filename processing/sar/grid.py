"""The places at which images are formed: a plane, a map of heights, or polar coordinates around a point.

Image formation asks a grid for nothing but its shape and the places of a few rows at a time (:class:`Grid`), so that no
image needs the places of all its pixels in memory. What needs a plane (range migration, peaks and their widths) asks
for an :class:`ImageGrid`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError

Places = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]
"""x, y and z of pixels, m, each (rows, columns); may be read-only views of smaller arrays."""


class Grid(Protocol):
    """What image formation needs to know of a grid."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""

    def places_m(self, rows: slice = slice(None)) -> Places:
        """Places of the pixels of some rows; NaN where there is no such place.

        Raises:
            DataError: the grid is empty or malformed.
        """


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

    def places_m(self, rows: slice = slice(None)) -> Places:
        """Places of the pixels of some rows; see :class:`Grid`."""
        x, y = _axis(self.x_m), _axis(self.y_m)
        if not np.isfinite(self.z_m):
            raise DataError("the image plane's height is not finite", "give the ground's z in metres")
        y = y[rows]
        shape = len(y), len(x)
        return (
            np.broadcast_to(x, shape),
            np.broadcast_to(y[:, None], shape),
            np.broadcast_to(np.float64(self.z_m), shape),
        )


@dataclass(frozen=True)
class HeightMapGrid:
    """A regular grid in x and y on ground of known height."""

    x_m: NDArray[np.float64]
    """(nx,) along the rail."""
    y_m: NDArray[np.float64]
    """(ny,) away from it."""
    height_m: NDArray[np.float64]
    """(ny, nx) z of the ground in rig coordinates; NaN where it is not known, which makes the pixel NaN."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows (y) and columns (x)."""
        return len(self.y_m), len(self.x_m)

    def places_m(self, rows: slice = slice(None)) -> Places:
        """Places of the pixels of some rows; see :class:`Grid`."""
        x, y = _axis(self.x_m), _axis(self.y_m)
        height = np.asarray(self.height_m, dtype=np.float64)
        if height.shape != (len(y), len(x)) or np.isinf(height).any():
            raise DataError(
                f"a map of heights of shape {height.shape} does not fit {len(y)} rows of {len(x)} pixels",
                "give one height for each pixel, NaN where it is not known",
            )
        height = height[rows]
        return np.broadcast_to(x, height.shape), np.broadcast_to(y[rows, None], height.shape), height


@dataclass(frozen=True)
class PolarGrid:
    """Slant range and angle around a point, on the plane ``z = z_m``. Rows are ranges, columns angles.

    A pixel lies at the distance ``range_m`` from ``origin_m``, in the direction that is turned by ``angle_rad`` from
    +y (away from the rail) toward +x. Ranges shorter than the height above the plane have no place there: NaN.
    """

    range_m: NDArray[np.float64]
    """(rows,) slant range from the origin."""
    angle_rad: NDArray[np.float64]
    """(columns,) from +y toward +x."""
    z_m: float
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows (range) and columns (angle)."""
        return len(self.range_m), len(self.angle_rad)

    def places_m(self, rows: slice = slice(None)) -> Places:
        """Places of the pixels of some rows; see :class:`Grid`."""
        slant, angle = _axis(self.range_m), _axis(self.angle_rad)
        if not (np.isfinite(self.z_m) and np.isfinite(self.origin_m).all()):
            raise DataError("the polar grid's plane or origin is not finite", "give them in metres")
        slant = slant[rows]
        away = slant**2 - (self.z_m - self.origin_m[2]) ** 2
        ground = np.sqrt(np.where((slant >= 0) & (away >= 0), away, np.nan))[:, None]
        x = self.origin_m[0] + ground * np.sin(angle)
        y = self.origin_m[1] + ground * np.cos(angle)
        return x, y, np.broadcast_to(np.float64(self.z_m), x.shape)


def check_grid(grid: Grid) -> None:
    """Refuse a grid without pixels or with places that are not finite.

    Raises:
        DataError: the grid is empty or not finite.
    """
    grid.places_m(slice(0, 1))


def _axis(values: NDArray[np.float64]) -> NDArray[np.float64]:
    axis = np.asarray(values, dtype=np.float64)
    if axis.ndim != 1 or not axis.size or not np.isfinite(axis).all():
        raise DataError("the image grid is empty or not finite", "give at least one finite x and one finite y")
    return axis
