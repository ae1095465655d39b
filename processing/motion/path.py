"""A point's echoes along its own path through the range profiles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.profiles import RangeProfiles
from processing.sar.interpolation import check_bins, tap_weights

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Path:
    """A virtual target that moves along the track only: any target of constant velocity has the ranges of one of these.

    Its squared distance is a parabola in time, with three numbers; place along the track, distance, and speed along it.
    """

    x_m: float
    """At time 0."""
    y_m: float
    z_m: float
    speed_m_s: float
    """Along x."""

    def ranges_m(self, antenna_m: Floats, time_s: Floats) -> Floats:
        """(positions,) distances."""
        dx = self.x_m + self.speed_m_s * time_s - antenna_m[:, 0]
        return np.asarray(np.sqrt(dx**2 + (self.y_m - antenna_m[:, 1]) ** 2 + (self.z_m - antenna_m[:, 2]) ** 2))

    def slopes(self, antenna_m: Floats, time_s: Floats) -> Floats:
        """(2, positions) derivatives of the distances by place and by speed along the track."""
        dx = self.x_m + self.speed_m_s * time_s - antenna_m[:, 0]
        by_place = dx / self.ranges_m(antenna_m, time_s)
        return np.stack([by_place, by_place * time_s])

    def moved(self, by_m: float, faster_m_s: float) -> Path:
        """Another place and speed along the track."""
        return replace(self, x_m=self.x_m + by_m, speed_m_s=self.speed_m_s + faster_m_s)


def echoes_along(
    profiles: RangeProfiles, range_m: Floats, *, channel: int = 0, offset_m: float = 0.0
) -> NDArray[np.complex128]:
    """(positions,) samples of the profiles at ranges, turned so that a point on that path is constant; 0 off the axis.

    Args:
        profiles: range profiles.
        range_m: (positions,) ranges.
        channel: index.
        offset_m: where to read beside the path; phases stay those of the path itself.

    Raises:
        DataError: as many ranges as positions are needed.
    """
    if range_m.shape != (len(profiles.antenna_m),):
        raise DataError(f"{range_m.shape} ranges for {len(profiles.antenna_m)} positions", "give one for each")
    bins, step = len(profiles.range_m), profiles.range_step_m
    taps = check_bins("sinc8", bins)
    start = profiles.range_m[0] if profiles.start_m is None else profiles.range_m[0] + profiles.start_m
    place = (range_m + offset_m - start) / step
    first = np.floor(place).astype(np.intp) - (taps // 2 - 1)
    inside = (first >= 0) & (first + taps <= bins)
    read = np.where(inside, first, 0)[:, None] + np.arange(taps)
    weights = tap_weights("sinc8", place - np.floor(place), profiles.resolution_m / step)
    values = profiles.values[channel][np.arange(len(place))[:, None], read]
    turns = 2 * range_m / profiles.wavelength_m
    turned = np.exp(2j * np.pi * (turns - np.rint(turns)))
    return np.asarray(np.where(inside, (values * weights).sum(axis=1) * turned, 0.0))
