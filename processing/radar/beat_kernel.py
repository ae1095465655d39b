"""The beat of a moving antenna, compiled: :func:`processing.radar.beat.beat` is the definition."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.radar.profiles import SPEED_OF_LIGHT_M_S


def beat_along_track(
    frequency_hz: ArrayLike,
    slope_hz_s: ArrayLike,
    antenna_m: ArrayLike,
    centres_m: ArrayLike,
    amplitudes: ArrayLike,
    *,
    delay_m: float = 0.0,
) -> NDArray[np.float64]:
    """Beat voltage of point scatterers seen from an antenna that moves from sample to sample.

    Args:
        frequency_hz: (n,) transmitted frequency at each sample.
        slope_hz_s: (n,) its rate of change.
        antenna_m: (n, 3) antenna at each sample.
        centres_m: (N, 3) scatterers.
        amplitudes: (N,) complex, effective scattering M: voltage that a scatterer would give at 1 m.
        delay_m: range that cables and electronics add, m: it delays, but does not spread.

    Returns:
        (n,) float64; equal to :func:`processing.radar.beat.beat_of_ranges` to 1e-10 of the echoes' amplitudes.

    Raises:
        DataError: shapes do not fit, or the antenna is inside a scatterer.
    """
    antenna = np.ascontiguousarray(antenna_m, dtype=np.float64)
    centres = np.ascontiguousarray(np.asarray(centres_m, dtype=np.float64).reshape(-1, 3))
    voltages = np.asarray(amplitudes, dtype=np.complex128)
    frequency = np.ascontiguousarray(frequency_hz, dtype=np.float64)
    slope = np.ascontiguousarray(slope_hz_s, dtype=np.float64)
    if antenna.shape != (*frequency.shape, 3) or slope.shape != frequency.shape or voltages.shape != (len(centres),):
        raise DataError(
            f"{antenna.shape} antenna positions, {frequency.shape} frequencies, {voltages.shape} amplitudes do not fit",
            "give one antenna position for each sample and one amplitude for each scatterer",
        )
    beat = np.zeros(len(frequency))
    turns = np.angle(voltages) / (2 * np.pi)
    _beat(frequency, slope, np.ascontiguousarray(antenna.T), centres, np.abs(voltages), turns, delay_m, beat)
    if not np.isfinite(beat).all():
        raise DataError("a scatterer stands at the antenna", "keep scatterers and the antenna apart")
    return beat


@njit(cache=True, nogil=True, error_model="numpy")
def _beat(
    frequency: NDArray[np.float64],
    slope: NDArray[np.float64],
    antenna: NDArray[np.float64],
    centres: NDArray[np.float64],
    strengths: NDArray[np.float64],
    angle_turns: NDArray[np.float64],
    delay_m: float,
    beat: NDArray[np.float64],
) -> None:
    """Add all scatterers to ``beat``, one after the other: the loop over samples is then done several at a time."""
    per_m = 2.0 / SPEED_OF_LIGHT_M_S
    x, y, z = antenna
    for k in range(len(strengths)):
        cx, cy, cz = centres[k]
        strength, angle = strengths[k], angle_turns[k]
        for n in range(len(beat)):
            dx, dy, dz = x[n] - cx, y[n] - cy, z[n] - cz
            squared = dx * dx + dy * dy + dz * dz
            delay = per_m * (math.sqrt(squared) + delay_m)
            turns = delay * frequency[n] - 0.5 * slope[n] * delay * delay - angle
            # Whole turns are dropped: there are some hundreds of them. cos 2a = 1 - 2 sin(a)^2 with |a| <= pi / 2,
            # where Taylor's series of the sine up to the 15th power misses by 6e-12.
            a = math.pi * (turns - math.floor(turns + 0.5))
            q = a * a
            sine = -1.0 / 1307674368000.0
            sine = sine * q + 1.0 / 6227020800.0
            sine = sine * q - 1.0 / 39916800.0
            sine = sine * q + 1.0 / 362880.0
            sine = sine * q - 1.0 / 5040.0
            sine = sine * q + 1.0 / 120.0
            sine = sine * q - 1.0 / 6.0
            sine = a * (sine * q + 1.0)
            beat[n] += strength / squared * (1.0 - 2.0 * sine * sine)
