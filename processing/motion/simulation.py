"""Echoes of points that move while a radar passes, and of the ground behind them.

Platforms stop and go: nothing moves within a pulse. That holds for airborne pulses of microseconds and for the rail's
positions, whatever the track; what a ramp of tens of milliseconds makes of motion is told in
:mod:`processing.sar.continuous`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.radar.antenna import one_way_gain
from processing.radar.phase_history import PhaseHistory
from processing.radar.profiles import SPEED_OF_LIGHT_M_S

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class MovingPoint:
    """An isotropic point with a place, velocity and acceleration at time 0; coordinates of the rig."""

    position_m: Vector
    velocity_m_s: Vector = (0.0, 0.0, 0.0)
    acceleration_m_s2: Vector = (0.0, 0.0, 0.0)
    amplitude: complex = 1.0

    def places_m(self, time_s: ArrayLike) -> Floats:
        """Places (..., 3) at times (...)."""
        t = np.asarray(time_s, dtype=np.float64)[..., None]
        place, velocity, acceleration = (
            np.asarray(v, dtype=np.float64) for v in (self.position_m, self.velocity_m_s, self.acceleration_m_s2)
        )
        return np.asarray(place + velocity * t + 0.5 * acceleration * t**2)


@dataclass(frozen=True)
class Collect:
    """Where and when pulses were sent, at which frequencies, through which beam.

    Raises:
        DataError: shapes that do not fit, or values that cannot be.
    """

    antenna_m: Floats
    """(pulses, 3) place of the antenna."""
    time_s: Floats
    """(pulses,) increasing; 0 is the instant to which the places of moving points refer."""
    first_hz: float
    step_hz: float
    frequencies: int
    reference_m: float
    """Range from which phases are counted; the middle of the profiles."""
    beamwidth_rad: float | None = None
    """Half-power width of one antenna's beam across the track's normal plane, broadside; None: isotropic."""

    def __post_init__(self) -> None:
        count = len(self.time_s)
        if count < 2 or self.antenna_m.shape != (count, 3) or not (np.diff(self.time_s) > 0).all():
            raise DataError(
                f"{count} times do not fit antenna places of shape {self.antenna_m.shape}",
                "give one place for each of two or more increasing times",
            )
        if self.frequencies < 2 or not (self.first_hz > 0 and self.step_hz > 0 and self.reference_m > 0):
            raise DataError("a collect needs two frequencies, positive steps and a positive range", "correct them")

    @property
    def centre_hz(self) -> float:
        """Frequency that phases of the profiles refer to (as
        :func:`processing.radar.phase_history.history_profiles`)."""
        return self.first_hz + (self.frequencies // 2) * self.step_hz

    @property
    def wavelength_m(self) -> float:
        """Wavelength at the centre."""
        return SPEED_OF_LIGHT_M_S / self.centre_hz

    @property
    def frequency_hz(self) -> Floats:
        """(frequencies,)."""
        return np.asarray(self.first_hz + self.step_hz * np.arange(self.frequencies), dtype=np.float64)


def strip_collect(
    *,
    speed_m_s: float = 240.0,
    height_m: float = 15_000.0,
    ground_range_m: float = 15_000.0,
    prf_hz: float = 362.53,
    seconds: float = 12.0,
    centre_hz: float = 1.2575e9,
    bandwidth_hz: float = 80e6,
    swath_m: float = 480.0,
    beamwidth_rad: float | None = math.radians(4.5),
) -> Collect:
    """A straight flight along x past the origin, looking broadside to +y; thesis Table 8.1 by default.

    Args:
        speed_m_s, height_m, ground_range_m: platform, and the scene's middle below and beside it.
        prf_hz: pulses a second.
        seconds: length, centred on time 0.
        centre_hz, bandwidth_hz: the chirp.
        swath_m: unambiguous depth of the profiles in slant range.
        beamwidth_rad: half-power beam width in azimuth.
    """
    pulses = round(seconds * prf_hz)
    time = np.asarray((np.arange(pulses) - (pulses - 1) / 2) / prf_hz, dtype=np.float64)
    antenna = np.zeros((pulses, 3))
    antenna[:, 0] = speed_m_s * time
    step = SPEED_OF_LIGHT_M_S / (2 * swath_m)
    count = round(bandwidth_hz / step)
    first = centre_hz - (count // 2) * step
    return Collect(antenna, time, first, step, count, float(np.hypot(ground_range_m, height_m)), beamwidth_rad)


def ranges_m(point: MovingPoint, collect: Collect) -> Floats:
    """(pulses,) distance of a moving point from the antenna."""
    return np.asarray(np.linalg.norm(point.places_m(collect.time_s) - collect.antenna_m, axis=1))


def azimuth_gain(point: MovingPoint, collect: Collect) -> Floats:
    """(pulses,) two-way amplitude pattern towards a point: that of the angle off the plane normal to the track."""
    if collect.beamwidth_rad is None:
        return np.ones(len(collect.time_s))
    towards = point.places_m(collect.time_s) - collect.antenna_m
    cosine = np.hypot(towards[:, 1], towards[:, 2]) / np.linalg.norm(towards, axis=1)
    return one_way_gain(cosine, collect.beamwidth_rad)


def moving_history(points: Iterable[MovingPoint], collect: Collect, *, channel: str = "HH") -> PhaseHistory:
    """Phase history of moving (and standing) points; amplitudes do not fall with range.

    Args:
        points: what is there.
        collect: the pulses.
        channel: name of the one channel.

    Returns:
        Echoes (1, pulses, frequencies) complex64, computed in float64.
    """
    total = np.zeros((len(collect.time_s), collect.frequencies), dtype=np.complex128)
    for point in points:
        turns = 2 / SPEED_OF_LIGHT_M_S * (ranges_m(point, collect) - collect.reference_m)
        # Each frequency is the one before turned by the same angle: one exponential for each pulse and power of two.
        row = np.empty_like(total)
        start = turns * collect.first_hz
        row[:, 0] = point.amplitude * azimuth_gain(point, collect) * np.exp(-2j * np.pi * (start - np.rint(start)))
        turn = np.exp(-2j * np.pi * turns * collect.step_hz)
        done = 1
        while done < collect.frequencies:
            some = min(done, collect.frequencies - done)
            row[:, done : done + some] = row[:, :some] * (turn**done)[:, None]
            done += some
        total += row
    return history_of(total, collect, channel)


def history_of(echoes: NDArray[np.complexfloating], collect: Collect, channel: str = "HH") -> PhaseHistory:
    """Echoes (pulses, frequencies) of a collect as a phase history of one channel."""
    return PhaseHistory(
        echoes=np.asarray(echoes, dtype=np.complex64)[None],
        first_hz=collect.first_hz,
        step_hz=collect.step_hz,
        antenna_m=collect.antenna_m,
        reference_m=np.full(len(collect.time_s), collect.reference_m),
        channels=(channel,),
    )


def ground_clutter(collect: Collect, power: float, random: np.random.Generator) -> NDArray[np.complex128]:
    """Echoes (pulses, frequencies) of even ground under the beam.

    Uniform ground over the whole unambiguous swath is a Gaussian process: independent from frequency to frequency (the
    integral of ``exp(-j 4 pi (f1 - f2) R / c)`` over the swath vanishes), stationary in slow time with the Doppler
    spectrum ``|g(theta)|^2, f_D = 2 V sin(theta) / lambda`` of the two-way pattern g. Doppler frequencies beyond the
    pulse repetition frequency fold, as they do in the real thing.

    Args:
        collect: evenly spaced pulses on a straight track, with a beam.
        power: mean power of one echo.
        random: where chance comes from.

    Raises:
        DataError: no beam, or a platform that does not move.
    """
    speed = float(np.linalg.norm(collect.antenna_m[-1] - collect.antenna_m[0]) / np.ptp(collect.time_s))
    if collect.beamwidth_rad is None or speed == 0.0:
        raise DataError("clutter has a Doppler spectrum only under a beam that moves", "give a beam width and a track")
    pulses = len(collect.time_s)
    prf = (pulses - 1) / float(np.ptp(collect.time_s))
    doppler = np.fft.fftfreq(pulses, 1 / prf)
    spectrum = np.zeros(pulses)
    for fold in (-2, -1, 0, 1, 2):
        sine = (doppler + fold * prf) * collect.wavelength_m / (2 * speed)
        cosine = np.sqrt(np.clip(1 - sine**2, 0, None))
        spectrum += np.where(np.abs(sine) < 1, one_way_gain(cosine, collect.beamwidth_rad) ** 2, 0.0)
    shape = (pulses, collect.frequencies)
    white = (random.normal(size=shape) + 1j * random.normal(size=shape)) * np.sqrt(power / 2)
    scale = np.sqrt(spectrum / spectrum.mean())
    return np.asarray(np.fft.ifft(np.fft.fft(white, axis=0) * scale[:, None], axis=0))


def receiver_noise(collect: Collect, power: float, random: np.random.Generator) -> NDArray[np.complex128]:
    """White noise (pulses, frequencies) of a mean power."""
    shape = (len(collect.time_s), collect.frequencies)
    return np.asarray((random.normal(size=shape) + 1j * random.normal(size=shape)) * np.sqrt(power / 2))
