"""What focusing in one piece and in tiles have in common: checks, the order along the rail, and what stands out."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.forming import own_positions
from polfuse_lab.session import Session
from processing.radar.profiles import RangeProfiles
from processing.sar.aperture import grating_lobe_warning
from processing.sar.grid import ImageGrid, check_grid
from processing.sar.peak_search import Rows, find_peaks
from processing.sar.planner import Choice
from processing.sar.quality import Peak
from processing.sar.resolution import point_resolution


def furthest_m(session: Session, grid: ImageGrid) -> float:
    """Largest range from any position to any pixel.

    Raises:
        PolfuseError: positions are not known.
        DataError: the grid is empty.
    """
    check_grid(grid)
    x = np.asarray(session.sweeps["x_m"], dtype=np.float64)
    if not x.size or not np.isfinite(x).all():
        raise PolfuseError(
            "holds no sweeps with known positions", where=str(session.path), advice="collect along the rail first"
        )
    aside = max(float(grid.x_m.max() - x.min()), float(x.max() - grid.x_m.min()), 0.0)
    return math.sqrt(aside**2 + float(np.max(np.abs(grid.y_m))) ** 2 + grid.z_m**2)


def rail_order(antenna_m: NDArray[np.float64], session: Session) -> NDArray[np.intp]:
    """Positions in the order of x, so that a window along the aperture meets them in their place.

    Raises:
        PolfuseError: they are all at one place.
    """
    x = antenna_m[:, 0]
    if len(np.unique(x)) < 2:
        raise PolfuseError(
            f"has {len(x)} position{'s' if len(x) > 1 else ''} at one place, which is no aperture",
            where=str(session.path),
            advice="collect at several positions along the rail",
        )
    return np.argsort(x, kind="stable")


def along_the_rail(profiles: RangeProfiles, session: Session) -> RangeProfiles:
    """Profiles in the order of :func:`rail_order`."""
    return profiles.at_positions(rail_order(profiles.antenna_m, session))


def step_m(profiles: RangeProfiles) -> float:
    """From one position to the next in the channel that has the fewest."""
    present = ~np.isnan(profiles.values).all(axis=2)
    x = [np.unique(profiles.antenna_m[own, 0]) for own in present]
    return max(float(np.median(np.diff(places))) for places in x if len(places) > 1)


def warnings_of(profiles: RangeProfiles, grid: ImageGrid, choice: Choice, tolerance_db: float) -> list[str]:
    """What the user should know: grating lobes, missing positions, an error above the tolerance."""
    found = []
    if lobes := grating_lobe_warning(step_m(profiles), profiles.wavelength_m, profiles.antenna_m, grid):
        found.append(lobes)
    alone = own_positions(profiles) is not None
    missing = np.isnan(profiles.values).all(axis=2).sum(axis=1) * (not alone)
    for name, count in zip(profiles.channels, missing, strict=True):
        if count:
            found.append(f"channel {name} misses {count} of {len(profiles.antenna_m)} positions")
    if choice.predicted_error_db > tolerance_db:
        found.append(f"the error expected, {choice.predicted_error_db:.0f} dB, is above {tolerance_db:g} dB")
    return found


class Span:
    """Root of the sum of the channels' powers, some rows at a time.

    Args:
        image: (channels, ny, nx) complex, an array or what is read like one.
    """

    def __init__(self, image: Any) -> None:
        self._image = image
        self.shape: tuple[int, ...] = tuple(image.shape[1:])
        """Rows and columns."""

    def __getitem__(self, rows: slice, /) -> NDArray[np.float64]:
        """Some rows, float64."""
        part = np.asarray(self._image[:, rows]).astype(np.complex128)
        span: NDArray[np.float64] = np.sqrt(np.sum(np.abs(part) ** 2, axis=0))
        return span


def strongest_peaks(span: Rows, grid: ImageGrid, profiles: RangeProfiles, count: int) -> list[Peak]:
    """The strongest peaks of an image's span; what is nearer than a main lobe is the same target."""
    middle = (float(np.mean(profiles.antenna_m[:, 0])), float(np.median(grid.y_m)), grid.z_m)
    cell = point_resolution(
        profiles.antenna_m, middle, centre_hz=profiles.centre_hz, bandwidth_hz=profiles.bandwidth_hz
    )
    # Hann's main lobe is four widths of the unweighted cell from null to null; what is nearer is the same target.
    separation = (2 * min(cell.x_m, 1.0), 2 * min(cell.y_m, 2 * profiles.resolution_m))
    return find_peaks(span, grid, count, separation_m=separation, range_compensated=profiles.range_compensated)
