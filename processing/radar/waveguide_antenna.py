"""Pattern of an open circular waveguide (the "cantenna" of thesis 5.1): what H and V antennas do off their axis.

The dominant mode TE11 has different beams in the plane of its electric field (E-plane) and across it (H-plane), so that
the H and the V antenna light the same place differently. The cos^n model of :mod:`processing.radar.antenna` is what
simulation and compensation use; this one tells how far that is from a can.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import j1, jvp

from processing.errors import DataError, undefined_is_nan
from processing.radar.antenna import one_way_gain

Floats = NDArray[np.float64]

TE11 = 1.841183781340659
"""First zero of J1': cut-off of TE11 in units of 1 / radius."""
TM01 = 2.404825557695773
"""First zero of J0: cut-off of TM01, the next mode that a can's probe excites."""


@undefined_is_nan
def circular_waveguide_pattern(
    off_axis_rad: ArrayLike, plane_rad: ArrayLike, diameter_m: float, wavelength_m: float
) -> Floats:
    """Field amplitude of a TE11 aperture relative to its axis, any broadcast shape; 0 at and behind 90 degrees.

    E-plane ``2 J1(x) / x`` and H-plane ``2 J1'(x) / (1 - (x / 1.841)^2)`` with ``x = k a sin t``, both with the
    obliquity ``(1 + cos t) / 2`` of an aperture in free space; between the planes their squares are mixed by angle.
    Source: Balanis, Antenna Theory, Table 12.2 (circular aperture, TE11).

    Args:
        off_axis_rad: angle t from the axis.
        plane_rad: angle of the plane of observation from the electric field: 0 E-plane, pi / 2 H-plane.
        diameter_m: inner diameter of the can, m.
        wavelength_m: m.

    Raises:
        DataError: a can so narrow that TE11 does not travel in it, or figures that are not positive.
    """
    if not (np.isfinite([diameter_m, wavelength_m]).all() and diameter_m > 0 and wavelength_m > 0):
        raise DataError(f"a can of {diameter_m} m at {wavelength_m} m", "give positive, finite lengths")
    if np.pi * diameter_m / wavelength_m <= TE11:
        raise DataError(
            f"no wave of {wavelength_m:.4g} m travels in a can of {diameter_m:.4g} m",
            f"use one of more than {TE11 * wavelength_m / np.pi:.4g} m",
        )
    angle = np.asarray(off_axis_rad, dtype=np.float64)
    x = np.pi * diameter_m / wavelength_m * np.abs(np.sin(angle))
    with np.errstate(divide="ignore", invalid="ignore"):
        in_e = np.where(x < 1e-8, 1.0, 2 * j1(x) / x)
        ratio = 1 - (x / TE11) ** 2
        # At the zero of the denominator J1' vanishes too; the limit by l'Hopital, J1'' = -(1 - 1 / x^2) J1 there.
        limit = TE11 * (1 - 1 / TE11**2) * j1(TE11)
        in_h = np.where(np.abs(ratio) < 1e-7, limit, 2 * jvp(1, x) / ratio)
    plane = np.asarray(plane_rad, dtype=np.float64)
    mixed = np.sqrt((in_e * np.cos(plane)) ** 2 + (in_h * np.sin(plane)) ** 2)
    return np.asarray(np.where(np.cos(angle) > 0, mixed * (1 + np.cos(angle)) / 2, 0.0))


def pattern_difference_db(
    off_axis_rad: ArrayLike, plane_rad: ArrayLike, diameter_m: float, wavelength_m: float, beamwidth_rad: float
) -> Floats:
    """Power of a can's pattern over that of the cos^n model with a stated half-power beamwidth, dB.

    Raises as :func:`circular_waveguide_pattern` and :func:`processing.radar.antenna.one_way_gain`.
    """
    model = one_way_gain(np.cos(np.asarray(off_axis_rad, dtype=np.float64)), beamwidth_rad)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(
            20 * np.log10(circular_waveguide_pattern(off_axis_rad, plane_rad, diameter_m, wavelength_m))
            - 10 * np.log10(model)
        )
