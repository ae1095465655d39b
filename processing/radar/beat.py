"""The beat voltage of a linear FM radar: the definition that simulation and ranging share.

The ramp rises by ``bandwidth_hz`` about ``centre_hz`` in ``ramp_up_s`` and falls back in the rest of the period
(triangle). A point at range R (delay tau = 2 R / c) with effective scattering M gives, while the transmitted frequency
is f and changes at the rate K (both of the present ramp),

    v = Re{ conj(M) / R^2 exp(+j phi) },   phi = 2 pi tau f - pi K tau^2,

so that the conjugate of its analytic signal is ``M exp(-j 2 pi tau f)`` but for the residual video phase
``pi K tau^2``. The few microseconds after a turn of the ramp, during which the echo still comes from the ramp before,
are not modelled (tau is below 1e-5 of the ramp).
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError, undefined_is_nan
from processing.radar.profiles import SPEED_OF_LIGHT_M_S


@dataclass(frozen=True)
class TriangleFm:
    """A triangular linear FM sweep: up-ramp, then down-ramp to the end of the period.

    Raises:
        DataError: the ramp is not shorter than the period, or a value is not positive.
    """

    centre_hz: float
    bandwidth_hz: float
    ramp_up_s: float
    period_s: float

    def __post_init__(self) -> None:
        if not (0 < self.ramp_up_s < self.period_s and self.bandwidth_hz > 0 and self.centre_hz > 0):
            raise DataError(
                f"a sweep of {self.ramp_up_s:g} s up in a period of {self.period_s:g} s is no triangle",
                "give positive values and a period longer than the up-ramp",
            )

    def frequency(self, since_start_s: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Transmitted frequency (Hz) and its rate of change (Hz/s) at times since the up-ramp's start, in [0, period).

        Both have the shape of ``since_start_s``.
        """
        t = np.asarray(since_start_s, dtype=np.float64)
        up = self.bandwidth_hz / self.ramp_up_s
        down = self.bandwidth_hz / (self.period_s - self.ramp_up_s)
        rising = t < self.ramp_up_s
        low, high = self.centre_hz - self.bandwidth_hz / 2, self.centre_hz + self.bandwidth_hz / 2
        return np.where(rising, low + up * t, high - down * (t - self.ramp_up_s)), np.where(rising, up, -down)


def beat(
    frequency_hz: ArrayLike,
    slope_hz_s: ArrayLike,
    antenna_m: ArrayLike,
    centres_m: ArrayLike,
    amplitudes: ArrayLike,
) -> NDArray[np.float64]:
    """Beat voltage of point scatterers.

    Args:
        frequency_hz: (n,) transmitted frequency at each sample.
        slope_hz_s: (n,) its rate of change.
        antenna_m: (3,) antenna for all samples, or (n, 3) for each.
        centres_m: (N, 3) scatterers.
        amplitudes: (N,) complex, effective scattering M: voltage that a scatterer would give at 1 m.

    Returns:
        (n,) float64.

    Raises:
        DataError: shapes do not fit, or the antenna is inside a scatterer.
    """
    antenna = np.asarray(antenna_m, dtype=np.float64)
    centres = np.asarray(centres_m, dtype=np.float64).reshape(-1, 3)
    if antenna.shape != (3,) and antenna.shape != (*np.shape(frequency_hz), 3):
        raise DataError(f"antenna positions of shape {antenna.shape}", "give (3,) or one row for each sample")
    ranges = np.linalg.norm(antenna[..., None, :] - centres, axis=-1)
    # A range of zero is refused below, with a sentence.
    spread = np.where(ranges > 0, ranges, np.nan) ** 2
    return beat_of_ranges(frequency_hz, slope_hz_s, ranges, np.asarray(amplitudes) / spread)


@undefined_is_nan
def beat_of_ranges(
    frequency_hz: ArrayLike, slope_hz_s: ArrayLike, ranges_m: ArrayLike, amplitudes: ArrayLike
) -> NDArray[np.float64]:
    """Beat voltage of paths of given length: :func:`beat` without geometry and spreading.

    Args:
        frequency_hz: (n,) transmitted frequency at each sample.
        slope_hz_s: (n,) its rate of change.
        ranges_m: (N,) ranges, or (n, N) for each sample.
        amplitudes: (N,) or (n, N) complex voltages.

    Returns:
        (n,) float64.

    Raises:
        DataError: a range is zero or not finite.
    """
    frequency = np.asarray(frequency_hz, dtype=np.float64)[:, None]
    slope = np.asarray(slope_hz_s, dtype=np.float64)[:, None]
    ranges = np.atleast_2d(np.asarray(ranges_m, dtype=np.float64))
    voltages = np.asarray(amplitudes, dtype=np.complex128)
    if not np.all(np.isfinite(ranges)) or not np.all(ranges > 0):
        raise DataError("a scatterer stands at the antenna", "keep scatterers and the antenna apart")
    delay = 2 * ranges / SPEED_OF_LIGHT_M_S
    # Whole turns are dropped before the cosine: 2 tau f is some hundreds of turns.
    turns = delay * frequency - 0.5 * slope * delay**2
    phase = 2 * np.pi * (turns - np.rint(turns))
    voltage: NDArray[np.float64] = (voltages.real * np.cos(phase) + voltages.imag * np.sin(phase)).sum(axis=1)
    return voltage


def beat_reference(
    sweep: TriangleFm,
    since_start_s: float,
    antenna_m: tuple[float, float, float],
    centres_m: list[tuple[float, float, float]],
    amplitudes: list[complex],
) -> float:
    """One sample of :func:`beat`, written out as the definition: the phase is that of the transmitted signal now minus
    that of the signal sent ``tau`` ago on the same ramp.
    """
    up, down = sweep.bandwidth_hz / sweep.ramp_up_s, sweep.bandwidth_hz / (sweep.period_s - sweep.ramp_up_s)
    if since_start_s < sweep.ramp_up_s:
        slope, t = up, since_start_s - sweep.ramp_up_s / 2
    else:
        slope, t = -down, since_start_s - sweep.ramp_up_s - (sweep.period_s - sweep.ramp_up_s) / 2

    def sent(time_s: float) -> float:
        return 2 * math.pi * (sweep.centre_hz * time_s + slope * time_s**2 / 2)

    total = 0.0
    for centre, amplitude in zip(centres_m, amplitudes, strict=True):
        distance = math.dist(antenna_m, centre)
        phase = sent(t) - sent(t - 2 * distance / SPEED_OF_LIGHT_M_S)
        total += (complex(amplitude).conjugate() / distance**2 * cmath.exp(1j * phase)).real
    return total


def sync(sweep: TriangleFm, since_start_s: ArrayLike, edge_s: float) -> NDArray[np.float64]:
    """The sync voltage: +1 during the up-ramp, -1 during the down-ramp, with straight edges ``edge_s`` long.

    The edges cross zero exactly at the ramp's start and end. With edges of at least two samples the two samples beside
    a crossing lie on the edge, so that linear interpolation finds the crossing without error.

    Args:
        sweep: the sweep.
        since_start_s: times since the up-ramp's start, in [0, period), any shape.
        edge_s: length of an edge, s.

    Raises:
        DataError: the edges are not shorter than both ramps.
    """
    if not 0 < edge_s < min(sweep.ramp_up_s, sweep.period_s - sweep.ramp_up_s):
        raise DataError(f"sync edges of {edge_s:g} s", "give a length above zero and below both ramps")
    t = np.asarray(since_start_s, dtype=np.float64)
    # Distance to the nearest rising and falling edge, each taken within half a period.
    rise = t - sweep.period_s * np.rint(t / sweep.period_s)
    fall = t - sweep.ramp_up_s
    fall = fall - sweep.period_s * np.rint(fall / sweep.period_s)
    state = np.where(t < sweep.ramp_up_s, 1.0, -1.0)
    state = np.where(np.abs(rise) <= edge_s / 2, 2 * rise / edge_s, state)
    wave: NDArray[np.float64] = np.where(np.abs(fall) <= edge_s / 2, -2 * fall / edge_s, state)
    return wave
