"""Back-projection: every pixel sums the pulses at its own range, phase turned back. The exact method for any track.

    image(p) = sum_n w_n g_n(p) s_n(R_n(p)) exp(+j 4 pi centre R_n(p) / c) / sum_n w_n g_n(p)^2

with the pulses' profiles s_n, the distance R_n(p) from pulse n to the pixel, the aperture's window w_n, and the two-way
amplitude pattern g_n(p) (1 where no beam width is given). An isotropic target of RCS sigma in range-compensated
profiles therefore shows ``A sqrt(sigma)`` with its own phase at its place, A as in
:class:`processing.radar.profiles.RangeProfiles`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError
from processing.radar.antenna import boresight, pattern_exponent
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.aperture import two_way_gain, usable_pulses
from processing.sar.grid import ImageGrid
from processing.sar.interpolation import tap_table, tap_weights, taps_of


def backproject(
    profiles: RangeProfiles,
    grid: ImageGrid,
    *,
    interpolator: str = "sinc8",
    weights: NDArray[np.floating] | None = None,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
) -> NDArray[np.complex64]:
    """Focus all channels in one pass of a compiled kernel.

    Range and phase are float64 (phase reduced to turns before it is rounded), samples and weights float32, sums
    float64. Image rows are shared among threads, each pixel sums its pulses in order: the result does not depend on
    the number of threads. :func:`backproject_reference` is the definition.

    Args:
        profiles: (channels, positions, bins); profiles that are NaN throughout count as missing.
        grid: where to form the image.
        interpolator: how profiles are read between bins, see :mod:`processing.sar.interpolation`.
        weights: (positions,) window along the aperture; rectangular where left out.
        beamwidth_rad: half-power beam width of one antenna for pattern compensation; none where left out.
        depression_rad: angle of the antennas' axes below horizontal; they look along +y.

    Returns:
        (channels, ny, nx) complex64; NaN where a pulse's range is off the profiles' axis, where a NaN sample was
        touched, and where no pulse illuminates the pixel.

    Raises:
        DataError: unusable profiles, weights, grid or beam width, or an unknown interpolator.
    """
    from processing.sar.backprojection_kernel import kernel_for

    pulses = usable_pulses(profiles, weights)
    taps = _checked_taps(profiles, grid, interpolator)
    channels = len(pulses.values)
    weighted = pulses.values * pulses.weights[..., None]
    planar = np.concatenate([weighted.real, weighted.imag]).transpose(1, 0, 2)
    exponent = 0.0 if beamwidth_rad is None else pattern_exponent(beamwidth_rad)
    image = np.empty((channels, *grid.shape), dtype=np.complex64)
    kernel_for(taps)(
        np.ascontiguousarray(planar, dtype=np.float32),
        np.ascontiguousarray(pulses.weights.T),
        pulses.antenna_m,
        np.ascontiguousarray(grid.x_m, dtype=np.float64),
        np.ascontiguousarray(grid.y_m, dtype=np.float64),
        float(grid.z_m),
        float(profiles.range_m[0]),
        1.0 / profiles.range_step_m,
        2.0 * profiles.centre_hz / SPEED_OF_LIGHT_M_S,
        tap_table(interpolator, profiles.resolution_m / profiles.range_step_m),
        boresight(depression_rad),
        exponent,
        image,
    )
    return image


def backproject_reference(
    profiles: RangeProfiles,
    grid: ImageGrid,
    *,
    interpolator: str = "sinc16",
    weights: NDArray[np.floating] | None = None,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
) -> NDArray[np.complex128]:
    """Back-projection in plain NumPy, float64 throughout: what :func:`backproject` is measured against.

    Arguments, NaN rules and errors as there; the default interpolator is the longest one. Returns (channels, ny, nx)
    complex128.
    """
    pulses = usable_pulses(profiles, weights)
    taps = _checked_taps(profiles, grid, interpolator)
    total = np.zeros((len(pulses.values), *grid.shape), dtype=np.complex128)
    gain_total = np.zeros(total.shape)
    oversampling = profiles.resolution_m / profiles.range_step_m
    for n, antenna in enumerate(pulses.antenna_m):
        distance = distance_m(antenna, grid)
        place = (distance - profiles.range_m[0]) / profiles.range_step_m
        first = np.floor(place).astype(np.int64) - (taps // 2 - 1)
        inside = (first >= 0) & (first + taps <= len(profiles.range_m))
        bins = np.where(inside, first, 0)[..., None] + np.arange(taps)
        filters = tap_weights(interpolator, place - np.floor(place), oversampling)
        turned = np.exp(4j * np.pi * profiles.centre_hz / SPEED_OF_LIGHT_M_S * distance)
        gain = np.ones(grid.shape)
        if beamwidth_rad is not None:
            gain = two_way_gain(antenna, grid, beamwidth_rad, depression_rad)
        for c, weight in enumerate(pulses.weights[:, n]):
            sample = (pulses.values[c, n].astype(np.complex128)[bins] * filters).sum(axis=-1)
            total[c] += np.where(inside, weight * gain * sample * turned, np.nan)
            gain_total[c] += weight * gain**2
    with np.errstate(invalid="ignore", divide="ignore"):
        image: NDArray[np.complex128] = np.where(gain_total > 0, total / gain_total, np.nan)
    return image


def distance_m(antenna_m: NDArray[np.float64], grid: ImageGrid) -> NDArray[np.float64]:
    """Distance, (ny, nx) m, from one place (3,) to every pixel."""
    dx = grid.x_m[None, :] - antenna_m[0]
    dy = grid.y_m[:, None] - antenna_m[1]
    distance: NDArray[np.float64] = np.sqrt(dx**2 + dy**2 + (grid.z_m - antenna_m[2]) ** 2)
    return distance


def _checked_taps(profiles: RangeProfiles, grid: ImageGrid, interpolator: str) -> int:
    taps = taps_of(interpolator)
    check_grid(grid)
    if len(profiles.range_m) < taps:
        raise DataError(
            f"{len(profiles.range_m)} range bins are fewer than the {taps} that {interpolator} interpolation reads",
            "keep a longer range axis",
        )
    return taps


def check_grid(grid: ImageGrid) -> None:
    """Refuse a grid without pixels or with places that are not finite.

    Raises:
        DataError: the grid is empty or not finite.
    """
    axes = np.asarray(grid.x_m), np.asarray(grid.y_m)
    if any(axis.ndim != 1 or not axis.size or not np.isfinite(axis).all() for axis in axes):
        raise DataError("the image grid is empty or not finite", "give at least one finite x and one finite y")
    if not np.isfinite(grid.z_m):
        raise DataError("the image plane's height is not finite", "give the ground's z in metres")
