"""Images that are no plane in x and y: polar coordinates around the rail's centre, and ground of known height."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.focus_parts import strongest_peaks
from processing.radar.profiles import RangeProfiles
from processing.sar.grid import Grid, HeightMapGrid, ImageGrid, PolarGrid, check_grid
from processing.sar.peak_search import Rows, find_peaks
from processing.sar.quality import Peak
from processing.sar.resolution import point_resolution

if TYPE_CHECKING:
    from polfuse_lab.session import Session

POLAR_STAGE = "focus_polar"
"""Stage of polar images: what works on images in x and y finds theirs in stage "focus" as before."""

MOST_CELLS = 50_000_000
"""Heights that a file may hold."""


def plane_of(grid: Grid) -> ImageGrid:
    """A plane grid of the same shape that spans the same ground: what planning and warnings go by.

    Raises:
        DataError: the grid is empty or malformed.
    """
    if isinstance(grid, ImageGrid):
        return grid
    check_grid(grid)
    x, y, z = grid.places_m()
    if not np.isfinite(x + y + z).any():
        raise PolfuseError(
            "no pixel of the image grid has a place", where="image grid", advice="give ranges beyond the height"
        )
    height = float(np.nanmedian(z))
    if isinstance(grid, HeightMapGrid):
        return ImageGrid(np.asarray(grid.x_m, np.float64), np.asarray(grid.y_m, np.float64), height)
    rows, columns = grid.shape
    spans = [np.linspace(np.nanmin(axis), np.nanmax(axis), n) for axis, n in ((x, columns), (y, rows))]
    return ImageGrid(spans[0], spans[1], height)


def polar_grid(
    session: Session,
    *,
    x_m: tuple[float, float] | None = None,
    y_m: tuple[float, float] | None = None,
    step: tuple[float, float] | None = None,
) -> PolarGrid:
    """Ranges and angles around the rail's centre that span an extent on the ground.

    Ranges run between those straight ahead at both ends of y, angles between those of both ends of x at the far end.
    The angle's resolution is the same everywhere, which is what makes polar images small.

    Args:
        session: collected along a rail.
        x_m: extent along the rail; as for :func:`polfuse_lab.products.focus.default_grid` where left out.
        y_m: extent away from it, likewise.
        step: of angle (degrees) and range (m); a quarter of the finest resolution where left out.

    Raises:
        PolfuseError: as :func:`polfuse_lab.products.focus.default_grid`.
    """
    from polfuse_lab.products.focus import default_grid

    if step is not None and not all(math.isfinite(size) and size > 0 for size in step):
        raise PolfuseError(
            f"pixels of {step[0]:g} degrees x {step[1]:g} m", where="image grid", advice="give positive sizes"
        )
    plane = default_grid(session, x_m=x_m, y_m=y_m)
    (x0, x1), (y0, y1) = ((float(axis[0]), float(axis[-1])) for axis in (plane.x_m, plane.y_m))
    nearest, furthest = math.hypot(y0, plane.z_m), math.hypot(y1, plane.z_m)
    if step is None:
        steps = (float(plane.x_m[1] - plane.x_m[0]) / nearest, float(plane.y_m[1] - plane.y_m[0]))
    else:
        steps = (math.radians(step[0]), step[1])
    angles, ranges = (
        first + size * np.arange(math.floor((last - first) / size + 1e-9) + 1, dtype=np.float64)
        for first, last, size in ((math.atan2(x0, y1), math.atan2(x1, y1), steps[0]), (nearest, furthest, steps[1]))
    )
    return PolarGrid(ranges, angles, plane.z_m)


def read_heights(path: Path | str) -> HeightMapGrid:
    """A map of the ground's heights from a file.

    Either text, a table with commas whose first row holds x (its first cell is not read), whose first column holds y,
    and whose other cells hold z (empty or ``nan`` where it is not known); or ``.npz`` with arrays ``x_m`` (nx,),
    ``y_m`` (ny,) and ``height_m`` (ny, nx). Rig coordinates, m; the ground is z = -antenna height.

    Raises:
        PolfuseError: the file cannot be read, or holds no such map.
    """
    path = Path(path)
    advice = "give a table: x in the first row, y in the first column, heights z between them"
    try:
        x, y, height = _npz(path) if path.suffix == ".npz" else _table(path)
    except Exception as error:
        # Damaged archives raise nearly every kind of exception.
        raise PolfuseError(f"holds no map of heights ({error})", where=str(path), advice=advice) from error
    wrong = not all(axis.ndim == 1 and axis.size and np.isfinite(axis).all() for axis in (x, y))
    if wrong or height.shape != (len(y), len(x)) or np.isinf(height).any() or np.isnan(height).all():
        raise PolfuseError(
            f"{height.shape} heights do not fit {x.size} x and {y.size} y", where=str(path), advice=advice
        )
    if any(len(axis) > 1 and not (np.diff(axis) > 0).all() for axis in (x, y)):
        raise PolfuseError("x and y do not increase", where=str(path), advice=advice)
    return HeightMapGrid(x, y, height)


def _npz(path: Path) -> tuple[NDArray[np.float64], ...]:
    with np.load(path, allow_pickle=False) as held:
        shape = held["height_m"].shape
        if math.prod(shape) > MOST_CELLS:
            raise ValueError(f"{shape} heights are too many")
        return tuple(np.asarray(held[name], dtype=np.float64) for name in ("x_m", "y_m", "height_m"))


def _table(path: Path) -> tuple[NDArray[np.float64], ...]:
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    if len(rows) < 2 or len(rows[0]) < 2 or any(len(row) != len(rows[0]) for row in rows):
        raise ValueError("rows of one length, two at least, are wanted")
    x = np.array([float(cell) for cell in rows[0][1:]])
    y = np.array([float(row[0]) for row in rows[1:]])
    height = np.array([[float(cell) if cell.strip() else math.nan for cell in row[1:]] for row in rows[1:]])
    return x, y, height


def told(grid: Grid) -> dict[str, Any]:
    """What a product's settings tell of a grid."""
    if isinstance(grid, HeightMapGrid):
        return {"grid": "heights", "heights_m": [float(np.nanmin(grid.height_m)), float(np.nanmax(grid.height_m))]}
    if isinstance(grid, PolarGrid):
        return {"grid": "polar", "origin_m": list(grid.origin_m)}
    return {"grid": "plane"}


def axes_of(grid: Grid) -> tuple[str, dict[str, NDArray[np.float64]], dict[str, str]]:
    """Stage that images on a grid are stored in, the grid's arrays there, and their units."""
    if isinstance(grid, PolarGrid):
        return POLAR_STAGE, {"range_m": grid.range_m, "angle_rad": grid.angle_rad}, {"range_m": "m", "angle_rad": "rad"}
    if isinstance(grid, HeightMapGrid):
        axes = {"x_m": grid.x_m, "y_m": grid.y_m, "height_m": np.asarray(grid.height_m, dtype=np.float64)}
        return "focus", axes, {"x_m": "m", "y_m": "m", "height_m": "m"}
    plane = plane_of(grid)
    return "focus", {"x_m": plane.x_m, "y_m": plane.y_m}, {"x_m": "m", "y_m": "m"}


def peaks_on(grid: Grid, span: Rows, profiles: RangeProfiles, count: int) -> list[Peak]:
    """The strongest peaks of an image's span, in x and y on the ground whatever the grid.

    In polar images they are looked for in range and angle, where lobes have the same shape everywhere.
    """
    if not isinstance(grid, PolarGrid):
        return strongest_peaks(span, plane_of(grid), profiles, count)
    middle = float(np.median(grid.range_m))
    flat = ImageGrid(grid.angle_rad * middle, grid.range_m, 0.0)
    ground = math.sqrt(max(middle**2 - (grid.z_m - grid.origin_m[2]) ** 2, 0.0))
    place = (grid.origin_m[0], grid.origin_m[1] + ground, grid.z_m)
    cell = point_resolution(profiles.antenna_m, place, centre_hz=profiles.centre_hz, bandwidth_hz=profiles.bandwidth_hz)
    separation = (2 * min(cell.x_m, 1.0), 2 * min(cell.y_m, 2 * profiles.resolution_m))
    found = []
    level = _Ungained(span, np.asarray(grid.range_m, np.float64)) if profiles.range_compensated else span
    for peak in find_peaks(level, flat, count, separation_m=separation):
        value = peak.value * peak.y_m**2 if profiles.range_compensated else peak.value
        angle = peak.x_m / middle
        away = math.sqrt(max(peak.y_m**2 - (grid.z_m - grid.origin_m[2]) ** 2, 0.0))
        x, y = grid.origin_m[0] + away * math.sin(angle), grid.origin_m[1] + away * math.cos(angle)
        found.append(Peak(x, y, value))
    return found


class _Ungained:
    """Some rows of a polar image at a time, without range compensation, which would pull maxima outward."""

    def __init__(self, image: Rows, range_m: NDArray[np.float64]) -> None:
        self._image, self._range_m = image, range_m
        self.shape = image.shape

    def __getitem__(self, rows: slice, /) -> NDArray[Any]:
        """Some rows."""
        part: NDArray[Any] = self._image[rows] / self._range_m[rows, None] ** 2
        return part
