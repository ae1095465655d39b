"""What motion does to a focused picture, in closed form (thesis 8.1; Raney 1971, IEEE Trans. AES 7(3) 499).

A platform flies along x at speed V past a point at slant range R that moves with v_az along x and v_r in slant range
(positive: receding) and accelerates by a_r in slant range; the picture is focused for what stands still:

    shift      dx = -R v_r / V
    smear      w  = |1 - C| V T,    C = ((V - v_az)^2 + v_r^2 + R a_r) / V^2;  about 2 |v_az| T
    defocus    residual quadratic phase at the aperture's ends   pi |1 - C| V^2 T^2 / (2 lambda R)

since the squared distance is ``A + B t + C V^2 t^2`` and a picture of one antenna knows A, B and C only.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from processing.errors import DataError


@dataclass(frozen=True)
class Passage:
    """How a platform passes a target.

    Raises:
        DataError: a value that is not positive and finite.
    """

    speed_m_s: float
    range_m: float
    """Slant range at closest approach."""
    wavelength_m: float
    aperture_s: float
    """Time for which the target is seen."""
    prf_hz: float

    def __post_init__(self) -> None:
        values = (self.speed_m_s, self.range_m, self.wavelength_m, self.aperture_s, self.prf_hz)
        if not all(math.isfinite(value) and value > 0 for value in values):
            raise DataError(f"speed, range, wavelength, time and pulse rate are {values}", "give positive numbers")


@dataclass(frozen=True)
class Appearance:
    """How a moving point looks in the picture of what stands still."""

    shift_m: float
    """Displacement along the track."""
    smear_m: float
    """Length along the track, beyond the resolution."""
    quadratic_phase_rad: float
    """Defocus at the ends of the aperture; a quarter turn is seen."""
    range_walk_m: float
    """Change of range during the aperture, v_r T: the shifted place walks likewise, so that nothing smears by it."""
    ghost_shift_m: float
    """Displacement where pulses fold the Doppler frequency; equals ``shift_m`` within the unambiguous speed."""


@dataclass(frozen=True)
class Ambiguities:
    """Velocities that a collect cannot tell apart, m/s."""

    unambiguous_m_s: float
    """|v_r| below which phases from pulse to pulse do not fold, lambda PRF / 4."""
    alias_m_s: float
    """v_r repeats at this, lambda PRF / 2; only the range walk tells which it is. Its multiples are blind: a target
    there has the Doppler frequency of the ground."""
    clutter_m_s: float
    """|v_r| below which a target's Doppler frequency lies among the ground's, V theta / 2: it must outshine it."""
    azimuth_per_acceleration_s: float
    """A range acceleration a_r is taken for this times a_r of velocity along the track, R / 2V."""
    least_azimuth_m_s: float
    """|v_az| whose smear equals the resolution, so that slower ones stay points: lambda R / (4 V T^2)."""


def appearance(
    passage: Passage, azimuth_m_s: float, range_m_s: float, range_acceleration_m_s2: float = 0.0
) -> Appearance:
    """Shift, smear and defocus of a moving point; velocities as at closest approach, slant range."""
    p = passage
    curvature = ((p.speed_m_s - azimuth_m_s) ** 2 + range_m_s**2 + p.range_m * range_acceleration_m_s2) / p.speed_m_s**2
    alias = p.wavelength_m * p.prf_hz / 2
    folded = range_m_s - alias * round(range_m_s / alias)
    return Appearance(
        shift_m=-p.range_m * range_m_s / p.speed_m_s,
        smear_m=abs(1 - curvature) * p.speed_m_s * p.aperture_s,
        quadratic_phase_rad=float(
            np.pi * abs(1 - curvature) * (p.speed_m_s * p.aperture_s) ** 2 / (2 * p.wavelength_m * p.range_m)
        ),
        range_walk_m=range_m_s * p.aperture_s,
        ghost_shift_m=-p.range_m * folded / p.speed_m_s,
    )


def ambiguities(passage: Passage) -> Ambiguities:
    """What the collect cannot tell apart."""
    p = passage
    return Ambiguities(
        unambiguous_m_s=p.wavelength_m * p.prf_hz / 4,
        alias_m_s=p.wavelength_m * p.prf_hz / 2,
        clutter_m_s=p.speed_m_s**2 * p.aperture_s / (2 * p.range_m),
        azimuth_per_acceleration_s=p.range_m / (2 * p.speed_m_s),
        least_azimuth_m_s=p.wavelength_m * p.range_m / (4 * p.speed_m_s * p.aperture_s**2),
    )


def velocity_from_picture(passage: Passage, shift_m: float, smear_m: float) -> tuple[float, float]:
    """(|v_az|, v_r) from a smear and a shift against the true place (a road, or the camera's picture), thesis 8.1.

    The smear does not tell the sign of v_az; refocusing does.
    """
    return smear_m / (2 * passage.aperture_s), -passage.speed_m_s * shift_m / passage.range_m
