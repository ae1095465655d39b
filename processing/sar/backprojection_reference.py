"""Back-projection in plain NumPy and float64: the definition that the compiled kernel is measured against."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.aperture import two_way_gain, usable_pulses
from processing.sar.continuous import Motion, apparent_range, sweep_motion
from processing.sar.grid import Grid
from processing.sar.interpolation import check_bins, tap_weights
from processing.sar.paths import channel_groups, radial_velocity, range_to


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
    """Back-projection in plain NumPy, float64 throughout: what the compiled kernel is measured against.

    Arguments, NaN rules and errors as in :func:`processing.sar.backprojection.backproject`; the default interpolator is
    the longest one. Returns (channels, rows, columns) complex128.
    """
    pulses = usable_pulses(profiles, weights)
    taps = check_bins(interpolator, len(profiles.range_m))
    moving = sweep_motion(profiles, motion)
    places = grid.places_m()
    bins = len(profiles.range_m)
    step = (profiles.range_m[-1] - profiles.range_m[0]) / (bins - 1)
    oversampling = profiles.resolution_m / step
    total = np.zeros((len(pulses.values), *grid.shape), dtype=np.complex128)
    gain_total = np.zeros(total.shape)
    for n, antenna in enumerate(pulses.antenna_m):
        for pair, channels in channel_groups(profiles):
            gain = np.ones(grid.shape)
            if beamwidth_rad is not None:
                gain = two_way_gain(antenna, grid, beamwidth_rad, depression_rad, pair)
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
