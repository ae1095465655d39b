"""The radar's pixels in the camera's picture where the ground is a height map and not a plane."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.fusion.height_map import HeightMap, camera_sees, radar_places
from processing.fusion.registration import GeometryErrors, RegistrationError, surface_error
from processing.optics.camera_model import Pinhole

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SurfacePixels:
    """Where the radar's pixels are, (ny, nx) each."""

    u: Floats
    """Column of the camera's picture; NaN outside it, in the radar's shadow, outside the map, and where the camera does
    not see the place."""
    v: Floats
    points_m: Floats
    """(ny, nx, 3) place that returns most of the pixel's echo, were all of the surface alike; NaN where none does."""
    slope: Floats
    """Rise of the surface there with y."""
    height_sd_m: Floats
    """Standard deviation of its height."""
    layover_px: Floats
    """Distance of the pixel's other places in the camera's picture, root mean square by their share of the echo."""
    hidden: NDArray[np.bool_]
    """Places that the camera would show if nothing stood before them."""

    def error(self, camera: Pinhole, errors: GeometryErrors) -> RegistrationError:
        """Error of each pixel's place in the camera's picture."""
        budget = surface_error(camera, self.points_m, self.slope, errors, self.height_sd_m)
        return replace(budget, layover=self.layover_px)


def surface_to_camera(
    camera: Pinhole, heights: HeightMap, x_m: ArrayLike, y_m: ArrayLike, z_m: float, height_sd_m: float
) -> SurfacePixels:
    """Camera pixels of a radar picture over a height map.

    Of several places in one pixel that is taken whose surface is longest in a metre of range: the one that is turned
    most towards the radar. The others are told as an error.

    Args:
        camera: the camera.
        heights: over the plane z = z_m.
        x_m, y_m, z_m: grid that the picture is focused on, m.
        height_sd_m: standard deviation of heights where the map tells none.

    Raises:
        DataError: as :func:`processing.fusion.height_map.radar_places`.
    """
    shape = len(np.asarray(y_m)), len(np.asarray(x_m))
    places = radar_places(heights, x_m, y_m, z_m)
    count = shape[0] * shape[1]
    order = np.lexsort((-places.area, places.pixel))
    pixel, first = np.unique(places.pixel[order], return_index=True)
    chosen = order[first]
    points, slope = np.full((count, 3), np.nan), np.full(count, np.nan)
    points[pixel], slope[pixel] = places.points_m[chosen], places.slope[chosen]
    all_u, all_v, _ = camera.project(places.points_m)
    u, v = np.full(count, np.nan), np.full(count, np.nan)
    u[pixel], v[pixel] = all_u[chosen], all_v[chosen]
    away = np.hypot(all_u - u[places.pixel], all_v - v[places.pixel])
    known = np.isfinite(away)
    weight, moment = (
        np.bincount(places.pixel[known], weights=values[known], minlength=count)
        for values in (places.area, places.area * np.where(known, away, 0.0) ** 2)
    )
    layover = np.sqrt(moment / np.maximum(weight, 1e-300))
    return _seen(camera, heights, (points, slope, layover), shape, z_m, height_sd_m)


def focused_to_camera(
    camera: Pinhole, heights: HeightMap, x_m: ArrayLike, y_m: ArrayLike, z_m: float, height_sd_m: float
) -> SurfacePixels:
    """Camera pixels of a radar picture that was focused on the height map itself: each pixel lies at its own height.

    Args:
        camera: the camera.
        heights: over the plane z = z_m.
        x_m, y_m: the picture's grid, m.
        z_m: the plane's height, m.
        height_sd_m: standard deviation of heights where the map tells none.
    """
    x, y = np.meshgrid(np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64))
    z = z_m + heights.at(x, y)
    # Slopes of the grid itself; of one row there are none.
    slope = np.gradient(z, y[:, 0], axis=0) if len(y) > 1 else np.zeros(z.shape)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return _seen(camera, heights, (points, slope.ravel(), np.zeros(z.size)), z.shape, z_m, height_sd_m)


def _seen(
    camera: Pinhole,
    heights: HeightMap,
    surface: tuple[Floats, Floats, Floats],
    shape: tuple[int, ...],
    z_m: float,
    height_sd_m: float,
) -> SurfacePixels:
    """Places, slopes and layover of pixels, as the camera sees them."""
    points, slope, layover = surface
    u, v, _ = camera.project(points)
    inside = camera.inside(u, v)
    hidden = np.zeros(len(points), dtype=bool)
    hidden[inside] = ~camera_sees(heights, z_m, camera.position_m, points[inside])
    shown = inside & ~hidden
    sd = heights.sd_at(points[:, 0], points[:, 1])
    return SurfacePixels(
        u=np.where(shown, u, np.nan).reshape(shape),
        v=np.where(shown, v, np.nan).reshape(shape),
        points_m=points.reshape(*shape, 3),
        slope=slope.reshape(shape),
        height_sd_m=np.where(np.isfinite(sd), sd, height_sd_m).reshape(shape),
        layover_px=layover.reshape(shape),
        hidden=hidden.reshape(shape),
    )
