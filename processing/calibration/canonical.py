"""Exact and high-frequency RCS of round calibration targets: sphere (Mie), cylinder (normal modes), disc.

Scattering matrices are in the backscatter alignment of :mod:`processing.scene.radar_response` and have the sign of a
plate: positive where the front of a large target reflects.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import h2vp, hankel2, j1, jv, jvp, spherical_jn, spherical_yn

from processing.errors import DataError, undefined_is_nan

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

LARGEST_CIRCUMFERENCE_WAVELENGTHS = 1e5
"""Above this the series' orders are too many; the optical limit is then exact to parts in 1e5."""


def sphere_amplitude(radius_m: float, wavelength_m: float) -> complex:
    """Backscatter amplitude of a conducting sphere, sqrt(m^2), its phase told from its centre: the Mie series.

    ``S = (1 / k) sqrt(pi) sum (-1)^n (2 n + 1) (b_n - a_n)`` times a unit phase, with a_n and b_n the ratios of
    Riccati-Bessel functions (and of their derivatives) at k r; the same for H and V, no cross polarization.
    Source: Ruck et al., Radar Cross Section Handbook, 3.2; Bohren and Huffman, chapter 4, for a perfect conductor.

    Raises:
        DataError: radius or wavelength that are not positive, or a sphere of more than 1e5 wavelengths around.
    """
    _positive("radius_m", radius_m)
    _positive("wavelength_m", wavelength_m)
    size = 2 * np.pi * radius_m / wavelength_m
    if size > LARGEST_CIRCUMFERENCE_WAVELENGTHS:
        raise DataError(
            f"a sphere of {size:.3g} wavelengths around is beyond the Mie series",
            "use sphere_rcs, its optical limit pi r^2",
        )
    # Wiscombe 1980: terms beyond these are below double precision.
    n = np.arange(1, int(np.ceil(size + 4.05 * np.cbrt(size) + 10)) + 1)
    j, y = spherical_jn(n, size), spherical_yn(n, size)
    dj, dy = spherical_jn(n, size, derivative=True), spherical_yn(n, size, derivative=True)
    psi, slope = size * j, j + size * dj
    with np.errstate(over="ignore", invalid="ignore"):
        # exp(+j w t): outgoing waves are Hankel functions of the second kind.
        xi, rise = size * (j - 1j * y), j + size * dj - 1j * (y + size * dy)
        a, b = slope / rise, psi / xi
    terms = np.where(np.isfinite(a) & np.isfinite(b), (-1.0) ** n * (2 * n + 1) * (b - a), 0.0)
    # The series' sign in the optical limit is that of -1j exp(2j k r): what a plate at the front would give is 1.
    return complex(1j * np.sqrt(np.pi) * wavelength_m / (2 * np.pi) * terms.sum())


def sphere_mie_rcs(radius_m: float, wavelength_m: float) -> float:
    """RCS of a conducting sphere of any size, m^2; see :func:`sphere_amplitude`."""
    return float(abs(sphere_amplitude(radius_m, wavelength_m)) ** 2)


@undefined_is_nan
def cylinder_amplitude(radius_m: float, length_m: float, tilt_rad: ArrayLike, wavelength_m: float) -> Floats:
    """Signed amplitude of a large conducting cylinder by physical optics, sqrt(m^2), without its ends.

    ``sqrt(k r) L sqrt(cos t) sinc(k L sin t)``, with t from broadside: 2 pi r L^2 / lambda at its maximum (thesis Table
    2.5). Zero along the axis, where only the ends reflect. Source: Knott, Shaeffer and Tuley, Radar Cross Section.
    """
    _positive("radius_m", radius_m)
    _positive("length_m", length_m)
    _positive("wavelength_m", wavelength_m)
    tilt = np.asarray(tilt_rad, dtype=np.float64)
    slanted = np.sqrt(2 * np.pi * radius_m / wavelength_m * np.maximum(np.cos(tilt), 0.0))
    return np.asarray(slanted * length_m * np.sinc(2 * length_m * np.sin(tilt) / wavelength_m))


@undefined_is_nan
def cylinder_rcs(radius_m: float, length_m: float, wavelength_m: float, tilt_rad: ArrayLike = 0.0) -> Floats:
    """RCS of a large conducting cylinder, m^2; 2 pi r L^2 / lambda broadside (thesis Table 2.5)."""
    return cylinder_amplitude(radius_m, length_m, tilt_rad, wavelength_m) ** 2


def cylinder_scattering(
    radius_m: float, length_m: float, wavelength_m: float, orientation_rad: float = 0.0, tilt_rad: float = 0.0
) -> Complexes:
    """S (2, 2) of a long conducting cylinder of any thickness, sqrt(m^2): thin ones answer to one polarization.

    Exact for an endless cylinder by normal modes at the direction's radial wavenumber k cos t; the length enters as
    physical optics has it. For a wave along the axis of the cylinder (E parallel) the modes are ``J_n / H_n``, across
    it ``J_n' / H_n'``. Phase from the axis. Source: Balanis, Advanced Engineering Electromagnetics, 11.5.

    Args:
        radius_m, length_m: m.
        wavelength_m: m.
        orientation_rad: angle of the axis from horizontal as the radar sees it.
        tilt_rad: of the line of sight from broadside.

    Raises:
        DataError: a size that is not positive, or a line of sight along the axis.
    """
    cosine = float(np.cos(tilt_rad))
    for name, value in (("radius_m", radius_m), ("length_m", length_m), ("wavelength_m", wavelength_m)):
        _positive(name, value)
    if not (cosine > 1e-9 and np.isfinite(orientation_rad)):
        raise DataError(
            f"the line of sight is {np.degrees(tilt_rad):.1f} degrees from broadside, along the cylinder's axis",
            "the modes of an endless cylinder hold below 90 degrees only",
        )
    size = 2 * np.pi * radius_m * cosine / wavelength_m
    n = np.arange(int(np.ceil(size + 4.05 * np.cbrt(size) + 10)) + 1)
    weight = np.where(n == 0, 1.0, 2.0) * (-1.0) ** n
    with np.errstate(over="ignore", invalid="ignore"):
        along = weight * jv(n, size) / hankel2(n, size)
        across = weight * jvp(n, size) / h2vp(n, size)
    along, across = (np.where(np.isfinite(modes), modes, 0.0) for modes in (along, across))
    # The current of a tilted, endless cylinder, cut to the length: sigma = 4 L^2 / pi |sum|^2 at any tilt.
    scale = 2 * length_m / np.sqrt(np.pi) * np.sinc(2 * length_m * np.sin(tilt_rad) / wavelength_m)
    parallel, perpendicular = scale * along.sum(), -scale * across.sum()
    c, s = np.cos(orientation_rad), np.sin(orientation_rad)
    axis = np.array([[c * c, c * s], [c * s, s * s]])
    # Turned so that a large cylinder has the sign of a plate at its front.
    return np.asarray(np.sqrt(1j) * (parallel * axis + perpendicular * (np.eye(2) - axis)))


@undefined_is_nan
def disc_amplitude(radius_m: float, tilt_rad: ArrayLike, wavelength_m: float) -> Floats:
    """Signed amplitude of a flat disc by physical optics, sqrt(m^2); zero from behind.

    ``sqrt(4 pi) A / lambda cos(t) 2 J1(x) / x`` with ``x = 2 k r sin t``. Source: Knott, Shaeffer and Tuley.
    """
    _positive("radius_m", radius_m)
    _positive("wavelength_m", wavelength_m)
    tilt = np.asarray(tilt_rad, dtype=np.float64)
    x = 4 * np.pi * radius_m * np.sin(tilt) / wavelength_m
    with np.errstate(invalid="ignore", divide="ignore"):
        pattern = np.where(np.abs(x) < 1e-8, 1.0, 2 * j1(x) / x)
    return np.asarray(np.sqrt(4 * np.pi) * np.pi * radius_m**2 / wavelength_m * np.maximum(np.cos(tilt), 0.0) * pattern)


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise DataError(f"{name} is {value}", f"give a positive, finite {name}")
