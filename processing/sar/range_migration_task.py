"""What range migration takes: its checks, and the ranges that the image needs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.antenna import AntennaPair
from processing.radar.profiles import RangeProfiles
from processing.sar.aperture import Pulses, usable_pulses
from processing.sar.continuous import sweep_motion
from processing.sar.grid import ImageGrid, check_grid
from processing.sar.straight_track import Track, straight_track

RANGE_MARGIN = 12
"""Resolution cells of range that are kept beyond the grid's; two thirds of them roll off."""

FLAT_MARGIN = 4
"""Of these, those next to the grid's that are kept whole."""


@dataclass(frozen=True)
class Task:
    """What is left to do after checks and cropping."""

    profiles: RangeProfiles
    pulses: Pulses
    track: Track
    roll: NDArray[np.float64]
    """(bins,) roll-off at the ends of the ranges."""
    outside: NDArray[np.bool_] | None
    """(ny, nx) pixels that are off the range axis for any pulse; None where there are none."""


def prepare(profiles: RangeProfiles, grid: ImageGrid, weights: NDArray[np.floating] | None) -> Task:
    """Check profiles and grid, and keep the ranges that matter; arguments as those of range migration.

    Raises:
        DataError: what the method does not model is refused, not focused wrongly.
    """
    advice = "focus by back-projection"
    if not isinstance(grid, ImageGrid):
        raise DataError("range migration forms images on a plane, in x and y", advice)
    check_grid(grid)
    pulses = usable_pulses(profiles, weights)
    if profiles.start_m is not None and np.any(np.asarray(profiles.start_m) != 0):
        raise DataError("positions have first ranges of their own, which range migration does not take", advice)
    if profiles.pairs is not None and any(pair != AntennaPair() for pair in profiles.pairs):
        raise DataError("transmitting and receiving antennas stand apart, which range migration does not model", advice)
    moving = sweep_motion(profiles)
    if moving.modelled:
        raise DataError(f"{moving.reason}, which range migration does not model", advice)
    if not np.isfinite(pulses.values).all():
        raise DataError("profiles hold single NaN samples", f"{advice}, which keeps them local")
    track = straight_track(pulses.antenna_m, profiles.wavelength_m)
    if np.min(grid.y_m) <= track.y_m:
        raise DataError(
            f"the image grid begins at y = {np.min(grid.y_m):g} m, not in front of the rail (y = {track.y_m:g} m)",
            "form the image in front of the rail",
        )
    outside, nearest, furthest = _ranges(profiles, track, grid)
    margin = RANGE_MARGIN * profiles.resolution_m
    beyond = np.maximum(nearest - profiles.range_m, profiles.range_m - furthest) / margin
    kept = np.flatnonzero(beyond < 1)
    if kept.size < 2:
        raise DataError(
            f"the image's ranges, {nearest:.3g} to {furthest:.3g} m, are outside the profiles, "
            f"{profiles.range_m[0]:.3g} to {profiles.range_m[-1]:.3g} m",
            "form the image where there are profiles",
        )
    some = slice(int(kept[0]), int(kept[-1]) + 1)
    # Beyond what the grid needs profiles roll off smoothly, so that cutting leaves nothing off the band.
    flat = FLAT_MARGIN / RANGE_MARGIN
    roll = 0.5 + 0.5 * np.cos(np.pi * np.clip((beyond[some] - flat) / (1 - flat), 0, 1))
    cropped = replace(profiles, range_m=profiles.range_m[some], values=profiles.values[..., some])
    return Task(cropped, replace(pulses, values=pulses.values[..., some]), track, roll, outside)


def _ranges(profiles: RangeProfiles, track: Track, grid: ImageGrid) -> tuple[NDArray[np.bool_] | None, float, float]:
    """Pixels that are off the range axis for any pulse (as back-projection with eight taps has it), and the ranges.

    Of a straight rail the nearest position and the further end have the shortest and the longest distance.
    """
    lowest = profiles.range_m[0] + 3 * profiles.range_step_m
    highest = profiles.range_m[-1] - 4 * profiles.range_step_m
    x = np.sort(track.x_m)
    after = np.clip(np.searchsorted(x, grid.x_m), 1, max(len(x) - 1, 1))
    beside = np.minimum(np.abs(grid.x_m - x[after - 1]), np.abs(grid.x_m - x[np.minimum(after, len(x) - 1)]))
    end = np.maximum(np.abs(grid.x_m - x[0]), np.abs(grid.x_m - x[-1]))
    slant = np.hypot(grid.y_m - track.y_m, grid.z_m - track.z_m)
    nearest = math.hypot(float(slant.min()), float(beside.min()))
    furthest = math.hypot(float(slant.max()), float(end.max()))
    if nearest >= lowest and furthest < highest:
        return None, nearest, furthest
    near, far = np.hypot(slant[:, None], beside), np.hypot(slant[:, None], end)
    return (near < lowest) | (far >= highest), nearest, furthest
