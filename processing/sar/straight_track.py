"""Tracks along a straight line: which they are, how far off it positions stand, and what the antennas saw from them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.antenna import pattern_exponent
from processing.sar.grid import ImageGrid
from processing.sar.gridding import chebyshev_nodes

LARGEST_PHASE = 0.3
"""Two-way phase, rad, of the furthest position from the line: 10 % of error, of which nothing good can be made."""

NODES_PER_SLOPE = 16.0
"""Chebyshev nodes of the pattern's sum along x for each time that the image is wider than its nearest row is far."""

ROW_NODES = 40
"""The same for all rows, on a logarithmic scale of distance."""


@dataclass(frozen=True)
class Track:
    """Positions on a straight line along x, in any order and at any distances."""

    x_m: NDArray[np.float64]
    """(positions,)."""
    y_m: float
    z_m: float
    residual_m: float = 0.0
    """Root mean square distance of the true positions from the line."""

    @property
    def middle_m(self) -> float:
        """x halfway between the ends."""
        return 0.5 * float(self.x_m.min() + self.x_m.max())


def straight_track(antenna_m: NDArray[np.float64], wavelength_m: float) -> Track:
    """The line along x that positions stand on.

    Args:
        antenna_m: (positions, 3).
        wavelength_m: of the centre frequency, which tells how far off the line is too far.

    Raises:
        DataError: a position is off the line by more than a two-way phase of 0.3 rad, a fortieth of the wavelength.
    """
    y, z = float(np.mean(antenna_m[:, 1])), float(np.mean(antenna_m[:, 2]))
    off = np.hypot(antenna_m[:, 1] - y, antenna_m[:, 2] - z)
    allowed = LARGEST_PHASE * wavelength_m / (4 * math.pi)
    if off.max() > allowed:
        raise DataError(
            f"positions deviate up to {1000 * off.max():.2g} mm from a straight line along x "
            f"(range migration allows {1000 * allowed:.2g} mm)",
            "focus by back-projection, which takes positions as they are",
        )
    return Track(np.asarray(antenna_m[:, 0], dtype=np.float64), y, z, float(np.sqrt(np.mean(off**2))))


def ahead_cosine(track: Track, grid: ImageGrid, depression_rad: float) -> NDArray[np.float64]:
    """(ny,) cosine between the antennas' axis and the direction to each row straight ahead, 0 where it is behind."""
    dy, dz = grid.y_m - track.y_m, grid.z_m - track.z_m
    ahead = math.cos(depression_rad) * dy - math.sin(depression_rad) * dz
    return np.asarray(np.clip(ahead / np.hypot(dy, dz), 0, 1))


def pattern_sum(
    track: Track, weights: NDArray[np.float64], grid: ImageGrid, beamwidth_rad: float, depression_rad: float
) -> NDArray[np.float64]:
    """Sum of the weighted squares of the two-way amplitude pattern over the positions, (ny, nx).

    It is smooth: a product of the tilt's part, which each row has once, and ``sum w (u^2 + rho^2)^-n``, which is
    interpolated from Chebyshev nodes where the grid has more rows or columns than those.

    Args:
        track: the positions.
        weights: (positions,).
        grid: in front of the track.
        beamwidth_rad: half-power beam width of one antenna.
        depression_rad: angle of the antennas' axes below horizontal; they look along +y.
    """
    exponent = pattern_exponent(beamwidth_rad)
    slant = np.hypot(grid.y_m - track.y_m, grid.z_m - track.z_m)
    wide = float(np.ptp(grid.x_m)) / float(slant.min())
    x, to_columns = chebyshev_nodes(grid.x_m, 16 + math.ceil(NODES_PER_SLOPE * wide))
    rho, to_rows = chebyshev_nodes(np.log(slant), ROW_NODES)
    square = np.exp(rho) ** 2
    total = np.zeros((len(rho), len(x)))
    for place, weight in zip(track.x_m, weights, strict=True):
        # Relative to the row's own distance, so that no power is out of range.
        total += weight * (1 + (x - place) ** 2 / square[:, None]) ** -exponent
    tilt = ahead_cosine(track, grid, depression_rad) ** (2 * exponent)
    return np.asarray(tilt[:, None] * np.clip(to_rows @ total @ to_columns.T, 0, None))
