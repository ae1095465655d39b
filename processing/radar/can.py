"""Dimensions of a can antenna, a piece of circular waveguide with a probe in it (thesis 5.1 to 5.3).

The thesis's own can does not obey its rule: the guide wavelength of 18.5 cm at 12.5 cm means a diameter of 9.94 cm,
0.795 wavelengths, in which the next mode travels as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from processing.errors import DataError
from processing.radar.waveguide_antenna import TE11, TM01, circular_waveguide_pattern

RULE = (0.60, 0.75)
"""Diameters that the thesis recommends, wavelengths (5.3)."""


@dataclass(frozen=True)
class Can:
    """A can for one wavelength. Lengths in m."""

    diameter_m: float
    """Inner diameter."""
    guide_wavelength_m: float
    """Of the dominant mode inside (thesis 5.2)."""
    single_mode: bool
    """Whether no other mode that a probe excites travels in it."""
    probe_m: float
    """Length of the probe: a quarter wavelength in free space."""
    probe_from_back_m: float
    """Distance of the probe from the closed end: a quarter of the guide wavelength."""
    length_m: float
    """Length of the can: three quarters of the guide wavelength."""
    beamwidth_e_rad: float
    """Half-power beam width in the plane of the electric field."""
    beamwidth_h_rad: float
    """Half-power beam width across it."""


def single_mode_diameters_m(wavelength_m: float) -> tuple[float, float]:
    """Diameters between which TE11 travels and TM01 does not, m: 0.586 and 0.766 wavelengths."""
    return TE11 * wavelength_m / math.pi, TM01 * wavelength_m / math.pi


def guide_wavelength_m(diameter_m: float, wavelength_m: float) -> float:
    """Wavelength of TE11 inside, m: ``lambda / sqrt(1 - (lambda / 1.706 D)^2)`` (thesis 5.2, 1.706 = pi / 1.8412).

    Raises:
        DataError: lengths that are not positive, or a can so narrow that TE11 does not travel in it.
    """
    if not (np.isfinite([diameter_m, wavelength_m]).all() and diameter_m > 0 and wavelength_m > 0):
        raise DataError(f"a can of {diameter_m} m at {wavelength_m} m", "give positive, finite lengths")
    cutoff = TE11 * wavelength_m / (math.pi * diameter_m)
    if cutoff >= 1:
        raise DataError(
            f"no wave of {wavelength_m:.4g} m travels in a can of {diameter_m:.4g} m",
            f"use one of more than {single_mode_diameters_m(wavelength_m)[0]:.4g} m",
        )
    return wavelength_m / math.sqrt((1 - cutoff) * (1 + cutoff))


def diameter_for_guide_wavelength_m(guide_m: float, wavelength_m: float) -> float:
    """Inverse of :func:`guide_wavelength_m`, m. Raises :class:`DataError` for a guide wavelength that is not longer."""
    if not guide_m > wavelength_m > 0:
        raise DataError(
            f"a guide wavelength of {guide_m:g} m at {wavelength_m:g} m does not exist",
            "it is longer than the wavelength in free space",
        )
    ratio = wavelength_m / guide_m
    return TE11 * wavelength_m / (math.pi * math.sqrt((1 - ratio) * (1 + ratio)))


def design_can(diameter_m: float, wavelength_m: float) -> Can:
    """A can of a diameter. Raises as :func:`guide_wavelength_m`.

    The probe's place and the length are the usual first cut, to be trimmed by measuring the match; the beams are those
    of :func:`processing.radar.waveguide_antenna.circular_waveguide_pattern`.
    """
    guide = guide_wavelength_m(diameter_m, wavelength_m)

    def level(angle: float, plane: float) -> float:
        return float(circular_waveguide_pattern(angle, plane, diameter_m, wavelength_m)) - math.sqrt(0.5)

    def width(plane: float) -> float:
        # A wide can has side lobes: the main beam ends at the first crossing.
        angles = np.linspace(0, math.pi / 2, 721)
        below = circular_waveguide_pattern(angles, plane, diameter_m, wavelength_m) < math.sqrt(0.5)
        first = int(np.argmax(below))
        return 2 * float(brentq(level, angles[first - 1], angles[first], args=(plane,), xtol=1e-12))

    return Can(
        diameter_m=diameter_m,
        guide_wavelength_m=guide,
        single_mode=diameter_m < single_mode_diameters_m(wavelength_m)[1],
        probe_m=wavelength_m / 4,
        probe_from_back_m=guide / 4,
        length_m=3 * guide / 4,
        beamwidth_e_rad=width(0.0),
        beamwidth_h_rad=width(math.pi / 2),
    )
