"""What a surface does to radar waves: Fresnel's reflection, weakened by roughness, and what roughness scatters back.

Fields vary as ``exp(+j w t)``, in which a lossy medium has the permittivity ``e' - j e''``. Roughness is told by the
standard deviation of heights: the mirrored wave falls by Rayleigh's factor ``exp(-2 (k s cos t)^2)`` (Ament 1953, Proc.
IRE 41), and what is scattered back is that of Oh, Sarabandi and Ulaby 1992 (IEEE TGRS 30, An empirical model and an
inversion technique for radar scattering from bare soil surfaces).
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.optics.fresnel import amplitudes, amplitudes_kernel

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

COLUMNS = 4
N, K, HEIGHT, CONDUCTS = range(COLUMNS)
"""Columns of the table: refractive index n + i k, wavenumber times the heights' deviation, 1 for a conductor."""


@dataclass(frozen=True)
class RadarSurface:
    """A surface as a radar meets it.

    Raises:
        DataError: a permittivity that no passive medium has, or a roughness below zero.
    """

    permittivity: complex | None = None
    """Relative, ``e' - j e''`` with e' >= 1 and e'' >= 0; None: a perfect conductor."""
    height_sd_m: float = 0.0
    """Standard deviation of heights, m; 0 is smooth."""

    def __post_init__(self) -> None:
        if self.permittivity is not None:
            e = complex(self.permittivity)
            if not (cmath.isfinite(e) and e.real >= 1 and e.imag <= 0):
                raise DataError(f"a permittivity is {e}", "give e' - j e'' with e' of 1 or more and e'' not negative")
        if not (math.isfinite(self.height_sd_m) and self.height_sd_m >= 0):
            raise DataError(f"a surface is {self.height_sd_m} m rough", "give zero or more")

    @property
    def index(self) -> complex:
        """Refractive index n + i k, as :mod:`processing.optics.fresnel` has it; 1 for a conductor."""
        return 1 + 0j if self.permittivity is None else cmath.sqrt(complex(self.permittivity).conjugate())


CONDUCTOR = RadarSurface()
"""Smooth metal."""


def reflection(surface: RadarSurface, cosine: ArrayLike, wavelength_m: float) -> tuple[Complexes, Complexes]:
    """Amplitudes ``R_s`` and ``R_p`` (...) of the mirrored wave, exp(+j w t); p axes are ``propagation x s``.

    Args:
        surface: what reflects.
        cosine: of the angle of incidence, 0 to 1.
        wavelength_m: wavelength, m.

    Raises:
        DataError: a cosine outside 0 to 1.
    """
    c = np.asarray(cosine, dtype=np.float64)
    fall = np.exp(-2 * (2 * np.pi / wavelength_m * surface.height_sd_m * c) ** 2)
    if surface.permittivity is None:
        return -fall + 0j, fall + 0j
    s, p = amplitudes(surface.index, c)
    return fall * s.conj(), fall * p.conj()


def table(surfaces: Sequence[RadarSurface], wavelength_m: float) -> Floats:
    """Surfaces as the kernels read them, (count, :data:`COLUMNS`)."""
    rows = np.zeros((len(surfaces), COLUMNS))
    for row, surface in zip(rows, surfaces, strict=True):
        row[:] = (
            surface.index.real,
            surface.index.imag,
            2 * math.pi / wavelength_m * surface.height_sd_m,
            surface.permittivity is None,
        )
    return rows


@numba.njit(cache=True, nogil=True, error_model="numpy")
def reflection_kernel(row: Floats, cosine: float) -> tuple[complex, complex]:
    """:func:`reflection` of a row of the table, in scalars."""
    fall = math.exp(-2.0 * (row[2] * cosine) ** 2)
    if row[3] != 0.0:
        return complex(-fall, 0.0), complex(fall, 0.0)
    s, p = amplitudes_kernel(complex(row[0], row[1]), cosine, complex(1.0, 0.0), 0.0)
    return complex(fall * s.real, -fall * s.imag), complex(fall * p.real, -fall * p.imag)


class Backscatter(NamedTuple):
    """RCS of a unit area of ground, m^2/m^2, each (...)."""

    hh: Floats
    vv: Floats
    hv: Floats


def rough_backscatter(surface: RadarSurface, incidence_rad: ArrayLike, wavelength_m: float) -> Backscatter:
    """What a rough surface scatters back to the radar, without the mirrored wave (Oh, Sarabandi, Ulaby 1992).

    ``p = hh/vv = (1 - (2 t / pi)^(1 / 3 G0) exp(-ks))^2``, ``q = hv/vv = 0.23 sqrt(G0) (1 - exp(-ks))``,
    ``vv = 0.7 (1 - exp(-0.65 ks^1.8)) cos^3 t / sqrt(p) (G_h + G_v)``; G are Fresnel's reflectances (G0 upright).
    Fitted to measurements of bare soil from 1.5 to 9.5 GHz, ``0.1 < ks < 6`` and 10 to 70 degrees; stretched beyond.

    Args:
        surface: permittivity and roughness; a smooth one scatters nothing back.
        incidence_rad: angle from the normal, 0 to pi / 2.
        wavelength_m: wavelength, m.

    Raises:
        DataError: an angle outside 0 to pi / 2.
    """
    angle = np.asarray(incidence_rad, dtype=np.float64)
    if not np.all((angle >= 0) & (angle <= np.pi / 2)):
        raise DataError("an angle of incidence lies outside 0 to 90 degrees", "turn the surface towards the radar")
    ks = 2 * np.pi / wavelength_m * surface.height_sd_m
    if ks == 0:
        nothing = np.zeros_like(angle)
        return Backscatter(nothing, nothing, nothing)
    cosine = np.cos(angle)
    smooth = RadarSurface(surface.permittivity)
    horizontal, vertical = (np.abs(r) ** 2 for r in reflection(smooth, np.clip(cosine, 0, 1), wavelength_m))
    upright = float(np.abs(reflection(smooth, 1.0, wavelength_m)[0]) ** 2)
    p = (1 - (2 * angle / np.pi) ** (1 / (3 * upright)) * np.exp(-ks)) ** 2
    q = 0.23 * math.sqrt(upright) * (1 - math.exp(-ks))
    vv = 0.7 * (1 - math.exp(-0.65 * ks**1.8)) * cosine**3 / np.sqrt(p) * (horizontal + vertical)
    return Backscatter(p * vv, vv, q * vv)
