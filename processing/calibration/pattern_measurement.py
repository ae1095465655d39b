"""The antennas' pattern as a calibration target shows it: its echo at every position along the rail, by direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.radar.antenna import boresight

Floats = NDArray[np.float64]

TOGETHER = 11
"""Positions that are averaged coherently: on a rail of 61, what lies aside by more than five cells averages out."""
LEAST_RESPONSE_DB = -10.0
"""Positions at which the target itself answers more weakly than this, over its best, tell nothing of the antennas."""


@dataclass(frozen=True, eq=False)
class MeasuredPattern:
    """Two-way pattern over the directions in which a target was seen."""

    azimuth_rad: Floats
    """(positions,) direction of the target from the antenna on the ground: 0 abreast, positive to the right."""
    off_axis_rad: Floats
    """(positions,) angle between the antennas' axis and the target, which the pattern depends on."""
    level_db: Floats
    """(channels, positions) received power, compensated for range and for the target's own response, relative to the
    largest of each channel; NaN where the target answers too weakly, the profile does not reach, or the track ends."""


def measured_pattern(
    profiles: ArrayLike,
    range_m: ArrayLike,
    antenna_m: ArrayLike,
    place_m: ArrayLike,
    response: ArrayLike,
    wavelength_m: float,
    *,
    depression_rad: float = 0.0,
    together: int = TOGETHER,
) -> MeasuredPattern:
    """Two-way pattern from range profiles of a target whose own response is known.

    Echoes are freed of the phase of their path and averaged over neighbouring positions (Hann weights): what comes from
    elsewhere turns from position to position and averages out, which magnitudes alone would not.

    Args:
        profiles: (channels, positions, bins) complex, compensated for range (multiplied by R^2).
        range_m: (bins,) uniform, m.
        antenna_m: (positions, 3) m.
        place_m: (3,) the target's phase centre, m.
        response: (channels, positions) the target's scattering amplitude in each channel, sqrt(m^2).
        wavelength_m: at the centre frequency, m.
        depression_rad: of the antennas' axes below the horizontal.
        together: positions that are averaged, odd; 1 for none.

    Raises:
        DataError: shapes that do not fit, a target at an antenna, or more positions together than there are.
    """
    values = np.asarray(profiles)
    axis, places = np.asarray(range_m, dtype=np.float64), np.asarray(antenna_m, dtype=np.float64)
    answer = np.asarray(response, dtype=np.complex128)
    own = np.abs(answer)
    if values.ndim != 3 or values.shape[1:] != (len(places), axis.size) or own.shape != values.shape[:2]:
        raise DataError(
            f"profiles of shape {values.shape} with {len(places)} positions, {axis.size} ranges and responses of shape "
            f"{own.shape}",
            "give (channels, positions, bins), and one response for each channel and position",
        )
    sight = np.asarray(place_m, dtype=np.float64) - places
    distance = np.linalg.norm(sight, axis=1)
    if not (distance > 0).all():
        raise DataError("the target stands at an antenna", "check its place")
    if together < 1 or together % 2 == 0 or together > len(places):
        raise DataError(
            f"{together} of {len(places)} positions cannot be averaged", "give an odd number, at most the positions"
        )
    cosine = np.clip(sight @ boresight(depression_rad) / distance, -1, 1)
    echo = np.empty(own.shape, dtype=np.complex128)
    for channel, position in np.ndindex(*own.shape):
        profile = values[channel, position].astype(np.complex128)
        # The profile's phase does not turn along range, so that both parts may be interpolated.
        parts = [
            np.interp(distance[position], axis, part, left=np.nan, right=np.nan)
            for part in (profile.real, profile.imag)
        ]
        echo[channel, position] = complex(*parts)
    with np.errstate(divide="ignore", invalid="ignore"):
        strong = own > own.max(axis=1, keepdims=True) * 10 ** (LEAST_RESPONSE_DB / 20)
        gain = np.where(strong & (own > 0), echo * np.exp(4j * np.pi * distance / wavelength_m) / answer, np.nan)
        weights, half = np.hanning(together + 2)[1:-1], together // 2
        level = np.full(own.shape, np.nan)
        for row, seen in zip(level, gain, strict=True):
            row[half : len(row) - half] = np.abs(np.convolve(seen, weights / weights.sum(), mode="valid"))
        largest = np.array([row[np.isfinite(row)].max() if np.isfinite(row).any() else np.nan for row in level])
        azimuth = np.arctan2(sight[:, 0], sight[:, 1])
        return MeasuredPattern(azimuth, np.arccos(cosine), np.asarray(20 * np.log10(level / largest[:, None])))
