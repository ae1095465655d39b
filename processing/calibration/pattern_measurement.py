"""The antennas' pattern as a calibration target shows it: its echo at every position along the rail, by direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.radar.antenna import boresight

Floats = NDArray[np.float64]

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
    largest of each channel; NaN where the target answers too weakly or the profile does not reach."""


def measured_pattern(
    profiles: ArrayLike,
    range_m: ArrayLike,
    antenna_m: ArrayLike,
    place_m: ArrayLike,
    response: ArrayLike,
    *,
    depression_rad: float = 0.0,
) -> MeasuredPattern:
    """Two-way pattern from range profiles of a target whose own response is known.

    Args:
        profiles: (channels, positions, bins) complex, compensated for range (multiplied by R^2).
        range_m: (bins,) uniform, m.
        antenna_m: (positions, 3) m.
        place_m: (3,) the target's phase centre, m.
        response: (channels, positions) the target's scattering amplitude in each channel, sqrt(m^2).
        depression_rad: of the antennas' axes below the horizontal.

    Raises:
        DataError: shapes that do not fit, or a target at an antenna.
    """
    values = np.asarray(profiles)
    axis, places = np.asarray(range_m, dtype=np.float64), np.asarray(antenna_m, dtype=np.float64)
    own = np.abs(np.asarray(response, dtype=np.complex128))
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
    cosine = np.clip(sight @ boresight(depression_rad) / distance, -1, 1)
    amplitude = np.empty(own.shape)
    for channel, position in np.ndindex(*own.shape):
        profile = values[channel, position].astype(np.complex128)
        # The profile's phase does not turn along range, so that both parts may be interpolated.
        parts = [
            np.interp(distance[position], axis, part, left=np.nan, right=np.nan)
            for part in (profile.real, profile.imag)
        ]
        amplitude[channel, position] = np.hypot(*parts)
    with np.errstate(divide="ignore", invalid="ignore"):
        strong = own > own.max(axis=1, keepdims=True) * 10 ** (LEAST_RESPONSE_DB / 20)
        level = np.where(strong & (own > 0), amplitude / own, np.nan)
        largest = np.array([row[np.isfinite(row)].max() if np.isfinite(row).any() else np.nan for row in level])
        azimuth = np.arctan2(sight[:, 0], sight[:, 1])
        return MeasuredPattern(azimuth, np.arccos(cosine), np.asarray(20 * np.log10(level / largest[:, None])))
