"""What autofocus works on: parts of the image, kept as the terms of its sum, one for each position."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.backprojection_reference import backproject_reference
from processing.sar.grid import ImageGrid, Places
from processing.sar.quality import Peak
from processing.sar.resolution import Resolution

REACH_CELLS = (6.0, 1.0)
"""Resolution cells that a chip reaches from its point: along the track, where errors smear, and across."""

PIXELS_PER_CELL, FIELD_PIXELS_PER_CELL = 2.5, 2.0
"""Pixels in one resolution cell of a chip, and of a field."""

LARGEST_TERMS = 3_000_000
"""Positions times pixels that are kept at most, for each channel."""


@dataclass(frozen=True)
class Chips:
    """The terms of the back-projected sum at the pixels around strong points, or of a whole field of pixels."""

    terms: NDArray[np.complex128]
    """(channels, positions, points, pixels), weighted; 0 where a channel has no profile at a position."""
    places_m: NDArray[np.float64]
    """(points, pixels, 3)."""
    antenna_m: NDArray[np.float64]
    """(positions, 3)."""
    k_rad_m: float
    """Two-way wavenumber, 4 pi centre / c."""
    cell_m: tuple[float, float]
    """Resolution cell along x and y."""

    def image(self, turn_rad: NDArray[np.float64]) -> NDArray[np.complex128]:
        """(channels, points, pixels) with the terms' phases turned by (positions, points or 1, pixels or 1)."""
        return np.asarray(np.einsum("cnkp,nkp->ckp", self.terms, np.exp(1j * self.spread(turn_rad)), optimize=True))

    def spread(self, turn_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """The turn of every term, (positions, points, pixels)."""
        return np.broadcast_to(turn_rad, self.terms.shape[1:])

    def turn_of_shift(self, shift_m: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
        """Turn (positions, points, pixels) of the terms when positions are moved by ``shift_m`` along a unit vector."""
        away = self.places_m[None] - self.antenna_m[:, None, None]
        before = np.sqrt(np.sum(away**2, axis=-1))
        along = away @ axis
        shift = shift_m[:, None, None]
        after = np.sqrt(before**2 - 2 * shift * along + shift**2)
        # A difference of squares over the sum keeps its digits at long range.
        return np.asarray(self.k_rad_m * (shift**2 - 2 * shift * along) / (after + before))

    def slope_of_shift(self, shift_m: NDArray[np.float64], axis: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivative of :meth:`turn_of_shift` by the shift of each position, rad/m."""
        away = self.places_m[None] - (self.antenna_m + shift_m[:, None] * axis)[:, None, None]
        return np.asarray(-self.k_rad_m * (away @ axis) / np.sqrt(np.sum(away**2, axis=-1)))


@dataclass(frozen=True)
class _Scattered:
    """Any places as a grid."""

    places: NDArray[np.float64]

    @property
    def shape(self) -> tuple[int, int]:
        return self.places.shape[0], self.places.shape[1]

    def places_m(self, rows: slice = slice(None)) -> Places:
        chosen = self.places[rows]
        return chosen[..., 0], chosen[..., 1], chosen[..., 2]


def cut_chips(
    profiles: RangeProfiles,
    peaks: list[Peak],
    grid: ImageGrid,
    cell: Resolution,
    weights: NDArray[np.float64],
) -> Chips:
    """Terms of back-projection around peaks, as many of the strongest as memory allows.

    Args:
        profiles: range profiles.
        peaks: of the image, strongest first.
        grid: the image's grid: chips lie on its plane.
        cell: resolution of a point in the middle of the image.
        weights: (positions,) along the aperture.
    """
    sizes = min(cell.x_m, 1e3), min(cell.y_m, 2 * profiles.resolution_m)
    across, along = (
        np.arange(-round(reach * PIXELS_PER_CELL), round(reach * PIXELS_PER_CELL) + 1) / PIXELS_PER_CELL * size
        for reach, size in zip(REACH_CELLS, sizes, strict=True)
    )
    offsets = np.stack(np.broadcast_arrays(across[None, :], along[:, None], 0.0), axis=-1).reshape(-1, 3)
    positions = len(profiles.antenna_m)
    room = max(LARGEST_TERMS // (positions * len(offsets)), 1)
    middle = np.array([[peak.x_m, peak.y_m, grid.z_m] for peak in peaks[:room]])
    places = middle[:, None] + offsets
    return _chips(profiles, places, weights, sizes)


def cut_field(
    profiles: RangeProfiles, grid: ImageGrid, span: NDArray[np.float64], cell: Resolution, weights: NDArray[np.float64]
) -> Chips:
    """Terms of back-projection over the image, as one point: all columns of as many rows as memory allows.

    Rows are those with most power in ``span`` (ny, nx): across the track focusing is a matter of each row by itself.
    Columns and rows are thinned to some two for a resolution cell.
    """
    sizes = min(cell.x_m, 1e3), min(cell.y_m, 2 * profiles.resolution_m)
    columns, rows = (
        np.arange(0, len(axis), max(1, int(size / FIELD_PIXELS_PER_CELL / abs(axis[1] - axis[0]))))
        if len(axis) > 1
        else np.array([0])
        for axis, size in zip((grid.x_m, grid.y_m), sizes, strict=True)
    )
    room = max(LARGEST_TERMS // (len(profiles.antenna_m) * len(columns)), 1)
    power = np.nansum(span[rows] ** 2, axis=1)
    rows = np.sort(rows[np.argsort(-power, kind="stable")[:room]])
    x, y = np.meshgrid(grid.x_m[columns], grid.y_m[rows])
    defined = np.isfinite(span[np.ix_(rows, columns)])
    places = np.stack([x[defined], y[defined], np.full(defined.sum(), grid.z_m)], axis=-1)
    return _chips(profiles, places[None], weights, sizes)


def _chips(
    profiles: RangeProfiles, places: NDArray[np.float64], weights: NDArray[np.float64], sizes: tuple[float, float]
) -> Chips:
    values = np.asarray(profiles.values)
    present = np.asarray(~np.isnan(values).all(axis=2))
    terms = np.zeros((len(values), len(profiles.antenna_m), *places.shape[:2]), dtype=np.complex128)
    for n in range(len(profiles.antenna_m)):
        own = np.flatnonzero(present[:, n])
        if own.size and weights[n] > 0:
            formed = backproject_reference(_one(profiles, own, n), _Scattered(places), interpolator="lagrange4")
            terms[own, n] = weights[n] * np.nan_to_num(formed)
    k = 4 * np.pi * profiles.centre_hz / SPEED_OF_LIGHT_M_S
    return Chips(terms, places, np.asarray(profiles.antenna_m, dtype=np.float64), k, sizes)


def _one(profiles: RangeProfiles, channels: NDArray[np.intp], n: int) -> RangeProfiles:
    some = slice(n, n + 1)
    return replace(
        profiles,
        values=profiles.values[channels, some],
        antenna_m=profiles.antenna_m[some],
        channels=tuple(profiles.channels[c] for c in channels),
        noise=None,
        start_m=None if profiles.start_m is None else profiles.start_m[some],
        velocity_m_s=None if profiles.velocity_m_s is None else profiles.velocity_m_s[some],
        pairs=None if profiles.pairs is None else tuple(profiles.pairs[c] for c in channels),
    )
