"""Radar cross-section of the canonical calibration targets (thesis chapter 5, Table 2.5), in the optical limit.

All sizes are many wavelengths; the far field begins at 2 D^2 / lambda. Angles are in radians, lengths in metres,
RCS in m^2. Amplitudes are ``S = sqrt(RCS)`` in m, signed where the scattering integral changes sign, so that they may
be averaged over an aperture. Every function broadcasts over arrays of angles.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError, undefined_is_nan

Floats = NDArray[np.float64]

TRIHEDRAL_AXIS_ELEVATION_RAD = 0.6154797086703874
"""Elevation of a trihedral's symmetry axis from its base, rad: asin(1 / sqrt 3), 35.264 degrees."""


def to_dbsm(rcs_m2: ArrayLike) -> Floats:
    """RCS in dB over one square metre (thesis 5.7). Zero gives -inf; negative values give NaN."""
    rcs = np.asarray(rcs_m2, dtype=np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(10.0 * np.log10(rcs))


@undefined_is_nan
def from_dbsm(rcs_dbsm: ArrayLike) -> Floats:
    """RCS in m^2 from dBsm."""
    return np.asarray(10.0 ** (np.asarray(rcs_dbsm, dtype=np.float64) / 10.0))


def sphere_rcs(radius_m: float) -> float:
    """RCS of a conducting sphere much larger than the wavelength, m^2: pi r^2 (thesis Table 2.5)."""
    _positive("radius_m", radius_m)
    return float(np.pi * radius_m**2)


@undefined_is_nan
def plate_amplitude(
    width_m: float, height_m: float, azimuth_rad: ArrayLike, elevation_rad: ArrayLike, wavelength_m: float
) -> Floats:
    """Signed scattering amplitude of a flat rectangular plate by physical optics, sqrt(m^2).

    ``sqrt(4 pi) (m n / lambda) cos(t) sinc(k m u) sinc(k n v)`` with ``u = cos(el) sin(az)``, ``v = sin(el)``,
    ``cos(t) = cos(el) cos(az)`` and ``sinc(x) = sin(x) / x``; zero from behind. Angles are measured from the normal.

    Source: thesis Table 2.5 (maximum); Knott, Shaeffer and Tuley, Radar Cross Section (angle dependence).
    """
    _positive("width_m", width_m)
    _positive("height_m", height_m)
    _positive("wavelength_m", wavelength_m)
    u, v, w = _boresight_cosines(azimuth_rad, elevation_rad)
    # np.sinc(x) is sin(pi x) / (pi x), and k = 2 pi / lambda.
    pattern = np.sinc(2 * width_m * u / wavelength_m) * np.sinc(2 * height_m * v / wavelength_m)
    return np.asarray(np.sqrt(4 * np.pi) * width_m * height_m / wavelength_m * np.maximum(w, 0.0) * pattern)


@undefined_is_nan
def plate_rcs(
    width_m: float,
    height_m: float,
    wavelength_m: float,
    azimuth_rad: ArrayLike = 0.0,
    elevation_rad: ArrayLike = 0.0,
) -> Floats:
    """RCS of a flat rectangular plate, m^2; 4 pi m^2 n^2 / lambda^2 along its normal (thesis Table 2.5)."""
    return plate_amplitude(width_m, height_m, azimuth_rad, elevation_rad, wavelength_m) ** 2


@undefined_is_nan
def dihedral_amplitude(
    fold_length_m: float,
    face_width_m: float,
    azimuth_rad: ArrayLike,
    elevation_rad: ArrayLike,
    wavelength_m: float,
    fold_rad: float = 0.0,
) -> Floats:
    """Signed double-bounce amplitude of a right-angled dihedral, sqrt(m^2).

    Along the fold the pattern is a plate's, ``cos(g) sinc(k L sin g)``. Across it the aperture is what is common to
    the projected faces and their mirror image through the fold, ``2 w sin(45 deg - |b|)``. Angles are measured from
    the boresight (the bisector of the faces); ``fold_rad`` is the fold's angle from horizontal. Double bounce only:
    zero beyond 45 degrees across the fold, where only single-bounce flashes remain.

    Source: thesis 5.10 (maximum 8 pi L^2 w^2 / lambda^2); geometrical optics across, physical optics along the fold.
    Exact by physical optics across the fold; tilted along it, the second face is lit only in part, which side lobes
    (not the main one) show: :mod:`processing.calibration.physical_optics` has it.
    """
    _positive("fold_length_m", fold_length_m)
    _positive("face_width_m", face_width_m)
    _positive("wavelength_m", wavelength_m)
    u, v, w = _boresight_cosines(azimuth_rad, elevation_rad)
    along = u * np.cos(fold_rad) + v * np.sin(fold_rad)
    across = v * np.cos(fold_rad) - u * np.sin(fold_rad)
    in_plane = np.hypot(across, w)
    tilt = np.abs(np.arctan2(across, w))
    aperture = 2 * face_width_m * np.sin(np.maximum(np.pi / 4 - tilt, 0.0))
    pattern = in_plane * np.sinc(2 * fold_length_m * along / wavelength_m)
    return np.asarray(np.sqrt(4 * np.pi) * fold_length_m * aperture / wavelength_m * pattern)


@undefined_is_nan
def dihedral_rcs(
    fold_length_m: float,
    face_width_m: float,
    wavelength_m: float,
    azimuth_rad: ArrayLike = 0.0,
    elevation_rad: ArrayLike = 0.0,
    fold_rad: float = 0.0,
) -> Floats:
    """RCS of a right-angled dihedral, m^2; 8 pi L^2 w^2 / lambda^2 on its boresight (thesis 5.10)."""
    return dihedral_amplitude(fold_length_m, face_width_m, azimuth_rad, elevation_rad, wavelength_m, fold_rad) ** 2


@undefined_is_nan
def square_trihedral_amplitude(
    edge_m: float, azimuth_rad: ArrayLike, elevation_rad: ArrayLike, wavelength_m: float
) -> Floats:
    """Triple-bounce amplitude of a trihedral with square faces, sqrt(m^2) (thesis 5.5, 5.6).

    Azimuth and elevation are measured from the edges (45 and 35.264 degrees are the symmetry axis). With the direction
    cosines sorted, ``c1 <= c2 <= c3``, the effective aperture over a^2 is ``4 c1 c2 / c3`` for ``c2 <= c3 / 2`` and
    ``c1 (4 - c3 / c2)`` beyond. Outside the first octant there is no triple bounce: zero.
    """
    c1, c2, c3 = _sorted_cosines(azimuth_rad, elevation_rad)
    with np.errstate(divide="ignore", invalid="ignore"):
        narrow = 4 * c1 * c2 / c3
        wide = c1 * (4 - c3 / c2)
    return _trihedral(edge_m, wavelength_m, np.where(c1 <= 0, 0.0, np.where(c2 <= c3 / 2, narrow, wide)))


@undefined_is_nan
def square_trihedral_rcs(
    edge_m: float,
    wavelength_m: float,
    azimuth_rad: ArrayLike = np.pi / 4,
    elevation_rad: ArrayLike = TRIHEDRAL_AXIS_ELEVATION_RAD,
) -> Floats:
    """RCS of a trihedral with square faces, m^2; at most 12 pi a^4 / lambda^2 (thesis 5.4, 5.5)."""
    return square_trihedral_amplitude(edge_m, azimuth_rad, elevation_rad, wavelength_m) ** 2


@undefined_is_nan
def triangular_trihedral_amplitude(
    edge_m: float, azimuth_rad: ArrayLike, elevation_rad: ArrayLike, wavelength_m: float
) -> Floats:
    """Triple-bounce amplitude of a trihedral with triangular faces, sqrt(m^2).

    Effective aperture over a^2 with sorted cosines and ``s = c1 + c2 + c3``: ``4 c1 c2 / s`` for ``c1 + c2 <= c3``,
    ``s - 2 / s`` beyond. Source: Doerry, Reflectors for SAR performance testing, SAND2014-0882, equations 2 and 3.
    """
    c1, c2, c3 = _sorted_cosines(azimuth_rad, elevation_rad)
    total = c1 + c2 + c3
    with np.errstate(divide="ignore", invalid="ignore"):
        aperture = np.where(c1 + c2 <= c3, 4 * c1 * c2 / total, total - 2 / total)
    return _trihedral(edge_m, wavelength_m, np.where(c1 <= 0, 0.0, aperture))


@undefined_is_nan
def triangular_trihedral_rcs(
    edge_m: float,
    wavelength_m: float,
    azimuth_rad: ArrayLike = np.pi / 4,
    elevation_rad: ArrayLike = TRIHEDRAL_AXIS_ELEVATION_RAD,
) -> Floats:
    """RCS of a trihedral with triangular faces, m^2; at most 4 pi a^4 / (3 lambda^2) (thesis Table 2.5)."""
    return triangular_trihedral_amplitude(edge_m, azimuth_rad, elevation_rad, wavelength_m) ** 2


class AngleError(NamedTuple):
    """Error of a computed RCS that comes from errors of the measured angles."""

    from_azimuth_m2: float
    """|d sigma / d az| d_az, m^2."""
    from_elevation_m2: float
    """|d sigma / d el| d_el, m^2."""
    quadrature_db: float
    """Both in quadrature (independent errors), dB, first order."""
    sum_db: float
    """Both added (worst case), dB, first order."""


def trihedral_angle_error(
    edge_m: float,
    wavelength_m: float,
    azimuth_rad: float,
    elevation_rad: float,
    azimuth_error_rad: float,
    elevation_error_rad: float,
) -> AngleError:
    """First-order error of the square trihedral's RCS from angle errors (thesis 5.16, 5.17).

    The direction cosines depend on the same two angles, so the derivative is taken with respect to the angles.

    Raises:
        DataError: the direction lies outside the trihedral's octant, where there is no triple bounce.
    """
    rcs = float(square_trihedral_rcs(edge_m, wavelength_m, azimuth_rad, elevation_rad))
    if rcs <= 0:
        raise DataError(
            f"a trihedral returns nothing at azimuth {np.degrees(azimuth_rad):.1f} and elevation "
            f"{np.degrees(elevation_rad):.1f} degrees",
            "give angles between 0 and 90 degrees from its edges",
        )
    step = 1e-6

    def rcs_at(azimuth: float, elevation: float) -> float:
        return float(square_trihedral_rcs(edge_m, wavelength_m, azimuth, elevation))

    slope_az = (rcs_at(azimuth_rad + step, elevation_rad) - rcs_at(azimuth_rad - step, elevation_rad)) / (2 * step)
    slope_el = (rcs_at(azimuth_rad, elevation_rad + step) - rcs_at(azimuth_rad, elevation_rad - step)) / (2 * step)
    by_az, by_el = abs(slope_az * azimuth_error_rad), abs(slope_el * elevation_error_rad)
    per_db = 10 / np.log(10) / rcs
    return AngleError(
        float(by_az), float(by_el), float(np.hypot(by_az, by_el) * per_db), float((by_az + by_el) * per_db)
    )


class Accuracy(NamedTuple):
    """A measured against an expected RCS."""

    error_db: float
    """Measured minus expected, dB: the honest figure."""
    power_ratio_percent: float
    """Measured over expected RCS in m^2, percent."""
    thesis_accuracy_percent: float
    """Ratio of the two dBsm numbers as thesis 5.13 prints it, percent; it depends on the unit and is kept only for
    comparison with the thesis. NaN where the expected RCS is 0 dBsm."""


def accuracy(measured_dbsm: float, expected_dbsm: float) -> Accuracy:
    """Compare a measured with an expected RCS, both in dBsm, as error in dB and as the thesis does (5.13)."""
    error = measured_dbsm - expected_dbsm
    percent = 100 * measured_dbsm / expected_dbsm if expected_dbsm else float("nan")
    return Accuracy(error, 100 * 10 ** (error / 10), percent)


def far_field_m(largest_dimension_m: float, wavelength_m: float) -> float:
    """Distance 2 D^2 / lambda from which the plane-wave formulas of this module hold, m."""
    _positive("largest_dimension_m", largest_dimension_m)
    _positive("wavelength_m", wavelength_m)
    return 2 * largest_dimension_m**2 / wavelength_m


def _trihedral(edge_m: float, wavelength_m: float, aperture: Floats) -> Floats:
    _positive("edge_m", edge_m)
    _positive("wavelength_m", wavelength_m)
    return np.asarray(np.sqrt(4 * np.pi) * edge_m**2 / wavelength_m * aperture)


def _boresight_cosines(azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> tuple[Floats, Floats, Floats]:
    azimuth = np.asarray(azimuth_rad, dtype=np.float64)
    elevation = np.asarray(elevation_rad, dtype=np.float64)
    u = np.cos(elevation) * np.sin(azimuth)
    v = np.sin(elevation) + 0.0 * azimuth
    return u, v, np.cos(elevation) * np.cos(azimuth)


def _sorted_cosines(azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> tuple[Floats, Floats, Floats]:
    c = np.stack(_boresight_cosines(azimuth_rad, elevation_rad))
    # Sorting would put what is undefined last and leave a corner that seems to look elsewhere.
    c[:, np.isnan(c).any(axis=0)] = np.nan
    c.sort(axis=0)
    return c[0], c[1], c[2]


def _positive(name: str, value: float) -> None:
    if not (np.isfinite(value) and value > 0):
        raise DataError(f"{name} is {value}", f"give a positive, finite {name}")
