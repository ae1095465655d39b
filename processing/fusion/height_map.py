"""Ground that is not flat: where on it a radar pixel's echo comes from, and whether the camera sees that place.

The radar's picture is focused on the plane z = z_m. What it shows at (x, y) has the slant range of that place at
closest approach, ``R = sqrt(y^2 + z_m^2)``, and lies where the surface has that range. In front of a wall or a steep
slope several places have it (layover); behind it none is reached (shadow). Along y the surface is a polyline through
the map's nodes, so that every place is exact for it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]

_HIDDEN_M = 1e-6
"""The surface hides a ray that runs so far below it, m: rounding does not."""
_MOST_STEPS = 4000


@dataclass(frozen=True, eq=False)
class HeightMap:
    """Heights over the ground plane on a grid in rig coordinates.

    Args:
        x_m: (nx,) along the rail, increasing.
        y_m: (ny,) away from it, increasing.
        height_m: (ny, nx) above the plane; NaN where unknown. Between nodes it is bilinear.
        sd_m: (ny, nx) standard deviations; None where nothing is known of them.

    Raises:
        DataError: shapes that do not fit, fewer than 2 x 2 nodes, axes that do not increase, or nothing known.
    """

    x_m: Floats
    y_m: Floats
    height_m: Floats
    sd_m: Floats | None = None

    def __post_init__(self) -> None:
        shape = (len(self.y_m), len(self.x_m))
        if self.height_m.shape != shape or min(shape) < 2 or (self.sd_m is not None and self.sd_m.shape != shape):
            raise DataError(
                f"heights of shape {self.height_m.shape} over {shape[1]} places in x and {shape[0]} in y",
                "give one height for each place, y down the rows, and two or more places each way",
            )
        if any(not np.all(np.diff(axis) > 0) for axis in (self.x_m, self.y_m)):
            raise DataError("places of the height map do not increase", "sort x and y, each place once")
        if not np.isfinite(self.height_m).any():
            raise DataError("the height map knows no height", "give finite numbers of metres")
        if self.sd_m is not None and not np.all(self.sd_m[np.isfinite(self.sd_m)] >= 0):
            raise DataError("the height map has a negative standard deviation", "give zero or more")

    def at(self, x_m: ArrayLike, y_m: ArrayLike) -> Floats:
        """Heights at places of any one shape; NaN outside the map and where a neighbour is unknown."""
        return self._between(self.height_m, x_m, y_m)

    def sd_at(self, x_m: ArrayLike, y_m: ArrayLike) -> Floats:
        """Standard deviations there; NaN where none is known."""
        return self._between(np.full(self.height_m.shape, np.nan) if self.sd_m is None else self.sd_m, x_m, y_m)

    def _between(self, nodes: Floats, x_m: ArrayLike, y_m: ArrayLike) -> Floats:
        i, a, inside_x = _cell(self.x_m, x_m)
        k, b, inside_y = _cell(self.y_m, y_m)
        total = np.zeros(np.broadcast_shapes(a.shape, b.shape))
        for weight, row, column in (
            ((1 - b) * (1 - a), k, i),
            ((1 - b) * a, k, i + 1),
            (b * (1 - a), k + 1, i),
            (b * a, k + 1, i + 1),
        ):
            # A neighbour without weight does not matter, even if it is unknown.
            total = total + np.where(weight > 0, weight * nodes[row, column], 0.0)
        return np.where(inside_x & inside_y, total, np.nan)


@dataclass(frozen=True, eq=False)
class RadarPlaces:
    """Every place on the surface that a radar pixel shows; one entry each, pixels in order."""

    pixel: NDArray[np.int64]
    """(n,) number of the pixel, row by row."""
    points_m: Floats
    """(n, 3) rig coordinates."""
    slope: Floats
    """(n,) rise of the surface with y."""
    area: Floats
    """(n,) length of surface in a metre of range: how much of the pixel's echo to expect from there."""


def radar_places(heights: HeightMap, x_m: ArrayLike, y_m: ArrayLike, z_m: float) -> RadarPlaces:
    """Places on the surface with the slant range of each pixel that nothing hides from the rail.

    Args:
        heights: over the plane z = z_m.
        x_m, y_m: the picture's grid, m; y increasing and positive.
        z_m: height of the plane that the picture is focused on, m (the rail is at 0).

    Returns:
        Places; pixels outside the map and those that lie in the shadow have none.

    Raises:
        DataError: a grid that does not increase, or begins at the rail or behind it.
    """
    x, y = np.asarray(x_m, dtype=np.float64), np.asarray(y_m, dtype=np.float64)
    if not (len(y) and y[0] > 0 and np.all(np.diff(y) > 0)):
        raise DataError("the picture's ground range does not increase from above zero", "give y in front of the rail")
    nodes = heights.y_m[heights.y_m > 0]
    if len(nodes) < 2:
        raise DataError("the height map lies behind the rail", "give y away from it, m")
    across, along = np.meshgrid(x, nodes, indexing="ij")
    z = z_m + heights.at(across, along)
    wanted = y**2 + z_m**2
    y0, z0 = along[:, :-1], z[:, :-1]
    dy, dz = np.diff(along, axis=1), np.diff(z, axis=1)
    length = dy**2 + dz**2
    # Range squared is a parabola along each part; it is taken apart at its least value.
    least = np.clip(-(y0 * dy + z0 * dz) / length, 0.0, 1.0)
    last = np.zeros(y0.shape, dtype=bool)
    last[:, -1] = True
    last[:, :-1] = ~np.isfinite(length[:, 1:])
    found: list[tuple[NDArray[np.intp], NDArray[np.intp], Floats]] = []
    for sign, begin, end in ((-1.0, np.zeros_like(least), least), (1.0, least, np.ones_like(least))):
        column, row, part = _crossings(wanted, (y0, z0, dy, dz), (begin, end), last & (end == 1.0) & (sign > 0))
        p = y0[column, part] * dy[column, part] + z0[column, part] * dz[column, part]
        c = y0[column, part] ** 2 + z0[column, part] ** 2 - wanted[row]
        root = np.sqrt(np.maximum(p**2 - length[column, part] * c, 0.0))
        t = np.clip((-p + sign * root) / length[column, part], begin[column, part], end[column, part])
        found.append((column * len(y) + row, column * y0.shape[1] + part, t))
    pixel, part, t = (np.concatenate([each[k] for each in found]) for k in range(3))
    column, segment = np.divmod(part, y0.shape[1])
    at_y = y0[column, segment] + t * dy[column, segment]
    at_z = z0[column, segment] + t * dz[column, segment]
    # Elevation seen from the rail: whatever is lower than something nearer is hidden.
    highest = np.fmax.accumulate(z / along, axis=1)
    seen = at_z / at_y >= highest[column, segment] - 1e-9
    step = np.sqrt(length[column, segment])
    towards = np.abs(at_y * dy[column, segment] + at_z * dz[column, segment]) / step
    reach = np.hypot(at_y, at_z)
    area = reach / np.maximum(towards, 1e-9 * reach)
    row, slope = pixel % len(y), dz[column, segment] / dy[column, segment]
    pixel = row * len(x) + column
    points = np.stack([x[column], at_y, at_z], axis=-1)
    order = np.argsort(pixel[seen], kind="stable")
    return RadarPlaces(pixel[seen][order], points[seen][order], slope[seen][order], area[seen][order])


def camera_sees(heights: HeightMap, z_m: float, eye_m: ArrayLike, points_m: ArrayLike) -> NDArray[np.bool_]:
    """Whether nothing of the surface stands between an eye and points on it.

    The rays are followed in steps of half a node's distance, so edges of what is hidden are right to that.

    Args:
        heights: over the plane z = z_m; unknown heights hide nothing.
        z_m: height of that plane, m.
        eye_m: (3,) the camera's pupil.
        points_m: (n, 3).
    """
    eye, points = np.asarray(eye_m, dtype=np.float64), np.asarray(points_m, dtype=np.float64)
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(points).all(axis=-1))
    top = z_m + float(np.nanmax(heights.height_m))
    fall = eye[2] - points[:, 2]
    # Above the highest place of the map there is nothing in the way.
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.where(fall > 0, np.clip((eye[2] - top) / fall, 0.0, 1.0), 0.0)
    way = (1 - first) * np.hypot(points[:, 0] - eye[0], points[:, 1] - eye[1])
    fine = 0.5 * min(float(np.diff(heights.x_m).min()), float(np.diff(heights.y_m).min()))
    longest = float(np.max(way[seen], initial=0.0))
    steps = int(min(np.ceil(longest / fine), _MOST_STEPS))
    for step in range(steps):
        chosen = np.flatnonzero(seen & (first < 1))
        share = first[chosen] + (1 - first[chosen]) * (step + 0.5) / steps
        at = eye + share[:, None] * (points[chosen] - eye)
        above = z_m + heights.at(at[:, 0], at[:, 1]) - at[:, 2]
        seen[chosen[above > _HIDDEN_M]] = False
    return seen


def _cell(axis: Floats, values: ArrayLike) -> tuple[NDArray[np.intp], Floats, NDArray[np.bool_]]:
    """Number of the node before each value, the share of the way to the next, and whether it is on the axis."""
    at = np.asarray(values, dtype=np.float64)
    inside = (at >= axis[0]) & (at <= axis[-1])
    safe = np.where(inside, at, axis[0])
    before = np.clip(np.searchsorted(axis, safe, side="right") - 1, 0, len(axis) - 2)
    return before, (safe - axis[before]) / (axis[before + 1] - axis[before]), inside


def _crossings(
    wanted: Floats,
    parts: tuple[Floats, Floats, Floats, Floats],
    between: tuple[Floats, Floats],
    closed: NDArray[np.bool_],
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Column, row and part of the polyline of each crossing of a range squared (``wanted``, increasing).

    A part holds its begin and not its end, so that a node between two counts once; ``closed`` ones hold both.
    """
    y0, z0, dy, dz = parts
    begin, end = ((y0 + t * dy) ** 2 + (z0 + t * dz) ** 2 for t in between)
    known = np.isfinite(begin) & np.isfinite(end) & (between[1] > between[0])
    low, high = np.where(known, np.fmin(begin, end), 0.0), np.where(known, np.fmax(begin, end), 0.0)
    rising = end >= begin
    first = np.where(rising, np.searchsorted(wanted, low, "left"), np.searchsorted(wanted, low, "right"))
    after = np.where(rising & ~closed, np.searchsorted(wanted, high, "left"), np.searchsorted(wanted, high, "right"))
    count = np.where(known, after - first, 0).ravel()
    total = int(count.sum())
    which = np.repeat(np.arange(count.size), count)
    row = np.arange(total) - np.repeat(np.cumsum(count) - count, count) + np.repeat(first.ravel(), count)
    column, part = np.divmod(which, y0.shape[1])
    return column, row, part
