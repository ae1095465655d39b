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
from processing.sar.continuous import Motion, apparent_range, sweep_motion
from processing.sar.grid import Grid, ImageGrid, check_grid
from processing.sar.interpolation import tap_table, tap_weights, taps_of
from processing.sar.paths import channel_groups, radial_velocity, range_to


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
    grid: Grid,
    *,
    interpolator: str = "sinc16",
    weights: NDArray[np.floating] | None = None,
    beamwidth_rad: float | None = None,
    depression_rad: float = 0.0,
    motion: Motion = "auto",
) -> NDArray[np.complex128]:
    """Back-projection in plain NumPy, float64 throughout: what :func:`backproject` is measured against.

    Arguments, NaN rules and errors as there; the default interpolator is the longest one. Returns (channels, ny, nx)
    complex128.
    """
    pulses = usable_pulses(profiles, weights)
    taps = _checked_taps(profiles, grid, interpolator)
    moving = sweep_motion(profiles, motion)
    places = grid.places_m()
    bins = len(profiles.range_m)
    step = (profiles.range_m[-1] - profiles.range_m[0]) / (bins - 1)
    oversampling = profiles.resolution_m / step
    total = np.zeros((len(pulses.values), *grid.shape), dtype=np.complex128)
    gain_total = np.zeros(total.shape)
    for n, antenna in enumerate(pulses.antenna_m):
        gain = np.ones(grid.shape)
        if beamwidth_rad is not None:
            gain = two_way_gain(antenna, grid, beamwidth_rad, depression_rad)
        for pair, channels in channel_groups(profiles):
            distance = range_to(antenna, pair, places)
            seen, turns = distance, 2 * profiles.centre_hz / SPEED_OF_LIGHT_M_S * distance
            if moving.modelled and pulses.velocity_m_s is not None:
                radial = radial_velocity(antenna, pulses.velocity_m_s[n], pair, places)
                seen, turns = apparent_range(distance, radial, profiles.centre_hz, moving.slope_hz_s)
            place = (seen - pulses.start_m[n]) / step
            # NaN places (where a grid has none) read bin 0 and stay NaN by their phase.
            first = np.floor(np.nan_to_num(np.clip(place, -taps, bins + taps))).astype(np.int64) - (taps // 2 - 1)
            inside = (first >= 0) & (first + taps <= bins)
            read = np.where(inside, first, 0)[..., None] + np.arange(taps)
            filters = tap_weights(interpolator, place - np.floor(place), oversampling)
            turned = np.exp(2j * np.pi * turns)
            for c in channels:
                weight = pulses.weights[c, n]
                sample = (pulses.values[c, n].astype(np.complex128)[read] * filters).sum(axis=-1)
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


def _checked_taps(profiles: RangeProfiles, grid: Grid, interpolator: str) -> int:
    taps = taps_of(interpolator)
    check_grid(grid)
    if len(profiles.range_m) < taps:
        raise DataError(
            f"{len(profiles.range_m)} range bins are fewer than the {taps} that {interpolator} interpolation reads",
            "keep a longer range axis",
        )
    return taps
