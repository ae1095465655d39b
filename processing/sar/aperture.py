"""The synthetic aperture: windows along it, which pulses count, and what the antennas saw."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import windows

from processing.errors import DataError
from processing.radar.antenna import AntennaPair, boresight, one_way_gain
from processing.radar.profiles import RangeProfiles
from processing.sar.grid import Grid, ImageGrid

APERTURE_WINDOWS = ("rectangular", "hann", "taylor")


def aperture_window(name: str, positions: int) -> NDArray[np.float64]:
    """Weights along the aperture, (positions,), largest 1, none of them 0.

    ``"hann"`` has its zeros one step outside the aperture, so that no position is wasted; ``"taylor"`` has four
    nearly equal side lobes at -35 dB.

    Raises:
        DataError: there is no window of that name.
    """
    if name == "rectangular":
        return np.ones(positions)
    if name == "hann":
        weights: NDArray[np.float64] = windows.hann(positions + 2)[1:-1]
        return weights
    if name == "taylor":
        return np.asarray(windows.taylor(positions, nbar=4, sll=35, norm=False), dtype=np.float64)
    raise DataError(f"there is no aperture window called {name!r}", f"choose one of {', '.join(APERTURE_WINDOWS)}")


@dataclass(frozen=True)
class Pulses:
    """Checked input of image formation: the pulses that count, without their missing values."""

    values: NDArray[np.complexfloating]
    """(channels, pulses, bins); 0 where a channel has no profile at that position."""
    weights: NDArray[np.float64]
    """(channels, pulses); 0 where a channel has no profile at that position."""
    antenna_m: NDArray[np.float64]
    """(pulses, 3)."""
    start_m: NDArray[np.float64]
    """(pulses,) range of the first bin."""
    velocity_m_s: NDArray[np.float64] | None
    """(pulses, 3); None where the platform stood still."""


def usable_pulses(
    profiles: RangeProfiles, weights: NDArray[np.floating] | None = None, *, every_channel: bool = True
) -> Pulses:
    """Check profiles and leave out what does not count.

    A profile that is NaN throughout is a position that its channel missed: it gets weight 0 in that channel. Single
    NaN samples stay and make the pixels that touch them NaN. Positions without weight in any channel are dropped.

    Args:
        profiles: range profiles of one or more channels.
        weights: (positions,) window along the aperture, finite and not negative; all ones where left out.
        every_channel: whether a channel without any profile is refused.

    Raises:
        DataError: shapes disagree, positions, velocities or ranges are not finite, the range axis is not uniform,
            values are infinite, or a channel has no weighted profile at all.
    """
    values = np.asarray(profiles.values)
    if values.ndim != 3 or not values.size:
        raise DataError(
            f"range profiles have shape {values.shape}", "give (channels, positions, bins), none of them empty"
        )
    _, positions, bins = values.shape
    antenna = np.asarray(profiles.antenna_m, dtype=np.float64)
    if antenna.shape != (positions, 3) or not np.isfinite(antenna).all():
        raise DataError(
            f"{positions} positions need {positions} finite antenna places, found an array of shape {antenna.shape}",
            "record the trolley's position with every profile",
        )
    axis = np.asarray(profiles.range_m, dtype=np.float64)
    if axis.shape != (bins,) or bins < 2 or not np.isfinite(axis).all() or profiles.range_step_m <= 0:
        raise DataError(f"the range axis does not fit {bins} bins", "give one finite, increasing range for each bin")
    if np.abs(axis - np.linspace(axis[0], axis[-1], bins)).max() > 1e-6 * profiles.range_step_m * bins:
        raise DataError("the range axis is not uniform", "resample the profiles to equal steps")
    whole = bool(np.isfinite(values).all())
    if not whole and np.isinf(values).any():
        raise DataError("range profiles hold infinite values", "range the session again, or leave those positions out")
    window = np.ones(positions) if weights is None else np.asarray(weights, dtype=np.float64)
    if window.shape != (positions,) or not np.isfinite(window).all() or (window < 0).any():
        raise DataError(
            f"the aperture's weights do not fit {positions} positions", "give one finite weight >= 0 for each"
        )
    start = np.zeros(positions) if profiles.start_m is None else np.asarray(profiles.start_m, dtype=np.float64)
    if start.shape != (positions,) or not np.isfinite(start).all():
        raise DataError(f"the starts of ranges do not fit {positions} positions", "give one finite range for each")
    velocity = None if profiles.velocity_m_s is None else np.asarray(profiles.velocity_m_s, dtype=np.float64)
    if velocity is not None and (velocity.shape != (positions, 3) or not np.isfinite(velocity).all()):
        raise DataError(f"velocities do not fit {positions} positions", "give a finite velocity (x, y, z) for each")
    present = np.ones(values.shape[:2], dtype=np.bool_) if whole else ~np.isnan(values).all(axis=2)
    effective = np.where(present, window, 0.0)
    for name, total in zip(profiles.channels, effective.sum(axis=1), strict=True):
        if total <= 0 and every_channel:
            raise DataError(f"channel {name} has no profile with any weight", "collect it again, or leave it out")
    used = effective.max(axis=0) > 0
    kept = values if used.all() else values[:, used]
    if not (effective[:, used] > 0).all():
        kept = np.where((effective[:, used] > 0)[..., None], kept, 0)
    return Pulses(
        values=kept,
        weights=effective[:, used],
        antenna_m=antenna[used],
        start_m=axis[0] + start[used],
        velocity_m_s=None if velocity is None else velocity[used],
    )


def two_way_gain(
    antenna_m: NDArray[np.float64],
    grid: Grid,
    beamwidth_rad: float,
    depression_rad: float,
    pair: AntennaPair | None = None,
) -> NDArray[np.float64]:
    """Two-way amplitude pattern, (rows, columns), of antennas that look along +y and down.

    It is the product of the antennas' one-way amplitude patterns, each seen from its own place.

    Args:
        antenna_m: (3,) the platform's point.
        grid: the places that are looked at.
        beamwidth_rad: half-power beam width of one antenna.
        depression_rad: angle of the antennas' axes below horizontal.
        pair: the antennas' phase centres on the platform; both at its point where left out.
    """
    pair = AntennaPair() if pair is None else pair
    there = _power_pattern(antenna_m + np.asarray(pair.transmit_m), grid, beamwidth_rad, depression_rad)
    if pair.transmit_m == pair.receive_m:
        return there
    back = _power_pattern(antenna_m + np.asarray(pair.receive_m), grid, beamwidth_rad, depression_rad)
    gain: NDArray[np.float64] = np.sqrt(there * back)
    return gain


def _power_pattern(
    antenna_m: NDArray[np.float64], grid: Grid, beamwidth_rad: float, depression_rad: float
) -> NDArray[np.float64]:
    away = [place - antenna for place, antenna in zip(grid.places_m(), antenna_m, strict=True)]
    distance = np.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2)
    axis = boresight(depression_rad)
    along = axis[0] * away[0] + axis[1] * away[1] + axis[2] * away[2]
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.where(distance == 0, 0.0, along / distance)
    return one_way_gain(cosine, beamwidth_rad)


def alias_free_angle_rad(step_m: float, wavelength_m: float) -> float:
    """Largest angle from broadside, rad, that is seen without a grating lobe: ``asin(wavelength / (4 step))``.

    The two-way phase turns by ``4 pi step sin(angle) / wavelength`` from one position to the next and is ambiguous
    beyond half a turn. Steps of a quarter wavelength or less give pi/2: no grating lobes at all.

    Raises:
        DataError: step or wavelength are not positive.
    """
    if not (step_m > 0 and wavelength_m > 0):
        raise DataError(
            f"a step of {step_m:g} m at a wavelength of {wavelength_m:g} m has no aperture", "give positive lengths"
        )
    return math.asin(min(wavelength_m / (4 * step_m), 1.0))


def widest_angle_rad(antenna_m: NDArray[np.float64], grid: ImageGrid) -> float:
    """Largest angle from broadside, rad, at which any position sees any pixel of a grid in front of a straight rail."""
    ahead = max(float(np.min(grid.y_m)) - float(np.mean(antenna_m[:, 1])), 0.0)
    down = float(np.mean(antenna_m[:, 2])) - grid.z_m
    ends = float(np.min(antenna_m[:, 0])), float(np.max(antenna_m[:, 0]))
    aside = max(float(np.max(grid.x_m)) - ends[0], ends[1] - float(np.min(grid.x_m)), 0.0)
    return math.atan2(aside, math.hypot(ahead, down))


def grating_lobe_warning(step_m: float, wavelength_m: float, antenna_m: NDArray[np.float64], grid: ImageGrid) -> str:
    """One sentence where part of the grid is beyond the alias-free angle, else an empty string."""
    limit = alias_free_angle_rad(step_m, wavelength_m)
    widest = widest_angle_rad(antenna_m, grid)
    if limit >= math.pi / 2 or widest <= limit:
        return ""
    return (
        f"steps of {step_m:.4g} m are {step_m / wavelength_m:.2f} wavelengths: beyond "
        f"{math.degrees(limit):.0f} degrees from broadside bright targets leave grating lobes, and the image reaches "
        f"{math.degrees(widest):.0f}"
    )
