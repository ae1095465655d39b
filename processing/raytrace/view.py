"""A pinhole camera that looks anywhere, and the frame in which it describes polarization.

Its Stokes vectors have x horizontal in the picture (across the ray and the camera's upright direction, as a sheet
polarizer before the lens has it), and S2 > 0 at +45 degrees counter-clockwise as the picture is seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class View:
    """Where a picture is taken from.

    Raises:
        DataError: no size, a field of view outside 0 to 180 degrees, or directions that do not fit together.
    """

    position_m: Vector
    target_m: Vector
    """The point in the middle of the picture."""
    width_px: int
    height_px: int
    field_rad: float
    """Horizontal field of view from edge to edge."""
    up: Vector = (0.0, 0.0, 1.0)
    """Upright in the picture, but for its part along the view."""

    def __post_init__(self) -> None:
        if not (0 < self.width_px <= 65536 and 0 < self.height_px <= 65536 and 0 < self.field_rad < math.pi):
            raise DataError(
                f"a view has {self.width_px} x {self.height_px} pixels and a field of {self.field_rad} rad",
                "give 1 to 65536 pixels and a field between 0 and 180 degrees",
            )
        if not np.all(np.isfinite([*self.position_m, *self.target_m, *self.up])) or not np.linalg.norm(self._side) > 0:
            raise DataError(
                f"a view from {self.position_m} to {self.target_m} with {self.up} upright has no direction",
                "give two finite points and an upright direction that is not along the view",
            )

    @property
    def _side(self) -> Floats:
        forward = np.subtract(self.target_m, self.position_m)
        size = np.linalg.norm(forward) * np.linalg.norm(self.up)
        side = np.cross(forward, self.up)
        return np.asarray(side if np.linalg.norm(side) > 1e-9 * size else np.zeros(3))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height_px, self.width_px

    @property
    def focal_length_px(self) -> float:
        """Distance of the picture's plane in pixels."""
        return self.width_px / 2 / math.tan(self.field_rad / 2)

    @property
    def axes(self) -> Floats:
        """(3, 3): unit vectors forward, to the right and up, one a row."""
        forward = np.subtract(self.target_m, self.position_m).astype(np.float64)
        forward /= np.linalg.norm(forward)
        right = self._side / np.linalg.norm(self._side)
        return np.stack([forward, right, np.cross(right, forward)])

    def row(self) -> Floats:
        """As the kernels read it: position, axes, focal length, columns, rows."""
        return np.array([*self.position_m, *self.axes.ravel(), self.focal_length_px, self.width_px, self.height_px])

    def rays(self, column: Floats, row: Floats) -> tuple[Floats, Floats]:
        """Unit vectors (..., 3) through points of the picture (whole numbers are pixels' edges), and Stokes axes."""
        forward, right, up = self.axes
        x, y = column - self.width_px / 2, self.height_px / 2 - row
        direction = self.focal_length_px * forward + x[..., None] * right + y[..., None] * up
        direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
        axis = np.cross(direction, up)
        return direction, axis / np.linalg.norm(axis, axis=-1, keepdims=True)
