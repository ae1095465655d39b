"""Slow time: moving-target indication and range-Doppler maps.

Profiles follow :class:`processing.radar.profiles.RangeProfiles`: the phase of a point is -4 pi R / lambda, so that a
receding point turns backwards. Speeds are range rates: positive when the range grows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError, undefined_is_nan


def unambiguous_speed_m_s(wavelength_m: float, period_s: float) -> float:
    """Largest range rate that sweeps ``period_s`` apart tell from its aliases, m/s: lambda / 4 T."""
    return wavelength_m / (4 * period_s)


def two_pulse_canceller(profiles: NDArray[np.complexfloating]) -> NDArray[np.complexfloating]:
    """Difference of neighbouring sweeps along the first axis; one sweep fewer. What stands still goes.

    A range rate v passes with the amplitude 2 |sin(2 pi v T / lambda)|: multiples of lambda / 2T are blind.

    Raises:
        DataError: fewer than two sweeps.
    """
    _enough(profiles)
    result: NDArray[np.complexfloating] = np.diff(profiles, axis=0)
    return result


@undefined_is_nan
def remove_background(profiles: NDArray[np.complexfloating], sweeps: int) -> NDArray[np.complexfloating]:
    """Subtract the mean over a sliding window of ``sweeps`` sweeps centred on each (cut at the ends).

    Unlike the canceller it has no blind speeds, and follows a background that drifts slowly.

    Raises:
        DataError: fewer than two sweeps, or a window below two.
    """
    _enough(profiles)
    if sweeps < 2:
        raise DataError(f"a background of {sweeps} sweeps", "average over at least two")
    count = len(profiles)
    total = np.concatenate([np.zeros_like(profiles[:1]), np.cumsum(profiles, axis=0)])
    first = np.maximum(np.arange(count) - sweeps // 2, 0)
    last = np.minimum(first + sweeps, count)
    first = np.maximum(last - sweeps, 0)
    result: NDArray[np.complexfloating] = profiles - (total[last] - total[first]) / (last - first)[:, None]
    return result


@undefined_is_nan
def range_doppler(
    profiles: NDArray[np.complexfloating], period_s: float, wavelength_m: float, *, padding: int = 2
) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
    """Range-Doppler map of evenly spaced sweeps: Hann window over slow time, DFT.

    Args:
        profiles: (sweeps, bins).
        period_s: time between sweeps, s.
        wavelength_m: wavelength, m.
        padding: zero padding of the transform.

    Returns:
        (speeds, bins) complex map, scaled so that a steady point keeps its amplitude, and the (speeds,) range rates in
        m/s, ascending from -lambda/4T.

    Raises:
        DataError: fewer than two sweeps.
    """
    _enough(profiles)
    count = len(profiles)
    # Hann between the samples' intervals: no sweep has weight 0.
    window = np.sin(np.pi * (np.arange(count) + 0.5) / count) ** 2
    size = count * max(padding, 1)
    spectrum = np.fft.fft(profiles * (window / window.sum())[:, None], n=size, axis=0)
    speed = -np.fft.fftfreq(size, period_s) * wavelength_m / 2
    order = np.argsort(speed)
    return spectrum[order], speed[order]


def mean_range_doppler(
    profiles: NDArray[np.complexfloating], period_s: float, wavelength_m: float, *, sweeps: int = 64
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean power of the range-Doppler maps of half-overlapping blocks (Welch 1967), for long records.

    Args:
        profiles: (sweeps, bins).
        period_s: time between sweeps, s.
        wavelength_m: wavelength, m.
        sweeps: length of a block; short enough that targets stay within a range cell.

    Returns:
        (speeds, bins) power, and the (speeds,) range rates in m/s as :func:`range_doppler`.

    Raises:
        DataError: fewer than two sweeps.
    """
    _enough(profiles)
    length = min(max(sweeps, 2), len(profiles))
    starts = range(0, len(profiles) - length + 1, max(length // 2, 1))
    maps = [range_doppler(profiles[start : start + length], period_s, wavelength_m) for start in starts]
    power: NDArray[np.float64] = np.mean([np.abs(values) ** 2 for values, _ in maps], axis=0)
    return power, maps[0][1]


def _enough(profiles: NDArray[np.complexfloating]) -> None:
    if profiles.ndim != 2 or len(profiles) < 2:
        raise DataError(f"{len(profiles)} sweep(s) hold no movement", "record at least two sweeps")
