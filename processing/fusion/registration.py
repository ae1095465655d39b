"""SAR ground pixels in the camera's picture: where they fall, what is there, and how well that is known.

The SAR image lies on a horizontal plane; the camera is a pinhole of known place and direction. No matching of
features: the geometry alone registers the two, and its errors are propagated per pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.optics.camera_model import Pinhole

Floats = NDArray[np.float64]


def ground_points(x_m: ArrayLike, y_m: ArrayLike, z_m: float) -> Floats:
    """Points (ny, nx, 3) of a ground grid in rig coordinates, m."""
    x, y = np.meshgrid(np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64))
    return np.stack([x, y, np.full_like(x, z_m)], axis=-1)


def ground_to_camera(camera: Pinhole, x_m: ArrayLike, y_m: ArrayLike, z_m: float) -> tuple[Floats, Floats]:
    """Camera pixel (u, v) of each ground pixel, (ny, nx) each; NaN behind the camera and outside its frame."""
    u, v, _ = camera.project(ground_points(x_m, y_m, z_m))
    inside = camera.inside(u, v)
    return np.where(inside, u, np.nan), np.where(inside, v, np.nan)


def sample_bilinear(image: ArrayLike, u: ArrayLike, v: ArrayLike) -> Floats:
    """Values of a picture between its pixels.

    Args:
        image: (rows, columns) with NaN where it is undefined.
        u, v: column and row, any one shape; whole numbers are pixel centres. The outermost half pixel takes the
            border's value.

    Returns:
        Shape of ``u``; NaN outside the picture and wherever a pixel that would contribute is NaN.
    """
    values = np.asarray(image, dtype=np.float64)
    if values.ndim != 2 or not values.size:
        raise DataError(f"the picture has shape {values.shape}", "give rows and columns")
    rows, columns = values.shape
    column, row = np.asarray(u, dtype=np.float64), np.asarray(v, dtype=np.float64)
    inside = (column >= -0.5) & (column <= columns - 0.5) & (row >= -0.5) & (row <= rows - 0.5)
    column = np.clip(np.where(inside, column, 0.0), 0, columns - 1)
    row = np.clip(np.where(inside, row, 0.0), 0, rows - 1)
    left, top = np.floor(column).astype(np.intp), np.floor(row).astype(np.intp)
    right, bottom = np.minimum(left + 1, columns - 1), np.minimum(top + 1, rows - 1)
    a, b = column - left, row - top
    total = np.zeros(column.shape)
    for weight, i, j in (
        ((1 - b) * (1 - a), top, left),
        ((1 - b) * a, top, right),
        (b * (1 - a), bottom, left),
        (b * a, bottom, right),
    ):
        # A neighbour without weight does not matter, even if it is NaN.
        total += np.where(weight > 0, weight * values[i, j], 0.0)
    return np.where(inside, total, np.nan)


@dataclass(frozen=True)
class GeometryErrors:
    """Standard deviations of what the registration relies on."""

    range_m: float
    """Slant range of a SAR pixel's content, m (a cell's length over sqrt 12 when it may lie anywhere in the cell)."""
    cross_range_m: float
    """Place along the rail, m (likewise)."""
    angle_rad: float
    """Direction of the camera's axis, up-down and left-right each, rad."""
    height_m: float
    """Height of what scatters above the ground plane, m."""


@dataclass(frozen=True)
class RegistrationError:
    """Error of the registration per ground pixel, each (ny, nx), camera pixels, one standard deviation."""

    range_cell: Floats
    cross_range_cell: Floats
    angle: Floats
    height: Floats
    layover: Floats | float = 0.0
    """Of pixels that show several places of a surface at once."""

    @property
    def total(self) -> Floats:
        """All in quadrature: the causes are independent."""
        parts = (self.range_cell, self.cross_range_cell, self.angle, self.height, self.layover)
        return np.asarray(np.sqrt(sum(np.square(part) for part in parts)))


def registration_error(
    camera: Pinhole, x_m: ArrayLike, y_m: ArrayLike, z_m: float, errors: GeometryErrors
) -> RegistrationError:
    """:func:`surface_error` of a flat ground.

    Args:
        camera: the camera.
        x_m, y_m, z_m: the ground grid, m.
        errors: standard deviations.

    Returns:
        Errors per pixel; NaN behind the camera and for ground abeam of the rail (y = 0).
    """
    return surface_error(camera, ground_points(x_m, y_m, z_m), 0.0, errors)


def surface_error(
    camera: Pinhole, points_m: ArrayLike, slope: ArrayLike, errors: GeometryErrors, height_sd_m: ArrayLike | None = None
) -> RegistrationError:
    """First-order propagation of geometric errors into camera pixels.

    On a surface of slope s (rise with y) a change of slant range R moves the place along the surface, in y by
    R / (y + s z); a scatterer that is higher by h is imaged where its slant range meets the surface, while the camera
    sees it where it is. The surface is taken as level along the rail. Slopes in the picture are central differences.

    Args:
        camera: the camera.
        points_m: (..., 3) places on the surface; the rail passes at height 0 above y = 0, at closest approach.
        slope: (...) of the surface there.
        errors: standard deviations.
        height_sd_m: (...) of each place, instead of the one of ``errors``.

    Returns:
        Errors of shape (...); NaN behind the camera, and where the surface is seen by the radar face on.
    """
    points = np.asarray(points_m, dtype=np.float64)
    y, z = points[..., 1], points[..., 2]
    rise = np.broadcast_to(np.asarray(slope, dtype=np.float64), y.shape)
    # Range times its change with y along the surface.
    towards = y + rise * z
    towards = np.where(np.abs(towards) > 0, towards, np.nan)
    step = 1e-4

    def moved(along_y: Floats, along_z: Floats | float, along_x: float = 0.0) -> Floats:
        """Pixels for a metre in this direction."""
        x = np.full(y.shape, along_x)
        way = step * np.stack([x, along_y, np.broadcast_to(along_z, y.shape)], axis=-1)
        there, back = (np.stack(camera.project(points + sign * way)[:2]) for sign in (1, -1))
        return np.asarray(np.hypot(*((there - back) / (2 * step))))

    by_range = np.hypot(y, z) / towards
    higher = -z / towards
    height_sd = errors.height_m if height_sd_m is None else np.asarray(height_sd_m, dtype=np.float64)
    return RegistrationError(
        moved(by_range, rise * by_range) * errors.range_m,
        moved(np.zeros(y.shape), 0.0, 1.0) * errors.cross_range_m,
        _angle_error(camera, points, errors.angle_rad),
        np.asarray(moved(higher, 1 + rise * higher) * height_sd),
    )


def _angle_error(camera: Pinhole, ground: Floats, angle_rad: float) -> Floats:
    """Pixels by which turning the camera by ``angle_rad`` about each of its two cross axes moves the ground."""
    u, v, _ = camera.project(ground)
    f = camera.focal_length_px
    u0, v0 = camera.principal_point
    a, b = (u - u0) / f, (v - v0) / f
    # Derivatives of a perspective image (a, b) for turns about the image's horizontal and vertical axis.
    about_horizontal = np.hypot(a * b, 1 + b**2)
    about_vertical = np.hypot(1 + a**2, a * b)
    return np.asarray(f * angle_rad * np.hypot(about_horizontal, about_vertical))
