"""Stokes vectors: the states of thesis Table 2.1, and what a vector says (thesis 2.11 to 2.15).

Vectors are (..., 4) ``(S0, S1, S2, S3)`` with x horizontal, S2 > 0 at +45 degrees and S3 > 0 for the field ``(1, i)``.
Average Stokes vectors, never degrees or angles. Light without intensity has no polarization: NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]

STATES: dict[str, tuple[float, float, float, float]] = {
    "unpolarized": (1.0, 0.0, 0.0, 0.0),
    "H": (1.0, 1.0, 0.0, 0.0),
    "V": (1.0, -1.0, 0.0, 0.0),
    "+45": (1.0, 0.0, 1.0, 0.0),
    "-45": (1.0, 0.0, -1.0, 0.0),
    "RHC": (1.0, 0.0, 0.0, 1.0),
    "LHC": (1.0, 0.0, 0.0, -1.0),
}
"""Stokes vectors of unit intensity (thesis Table 2.1)."""


def linear(angle_rad: ArrayLike, dolp: ArrayLike = 1.0) -> Floats:
    """Stokes vectors (..., 4) of unit intensity, linearly polarized along ``angle_rad`` to the degree ``dolp``."""
    angle, degree = np.broadcast_arrays(np.asarray(angle_rad, dtype=np.float64), np.asarray(dolp, dtype=np.float64))
    return np.stack(
        [np.ones_like(angle), degree * np.cos(2 * angle), degree * np.sin(2 * angle), np.zeros_like(angle)], axis=-1
    )


def dolp(stokes: ArrayLike) -> Floats:
    """Degree of linear polarization (...) (thesis 2.12)."""
    s = checked(stokes)
    return _over_s0(np.hypot(s[..., 1], s[..., 2]), s)


def dop(stokes: ArrayLike) -> Floats:
    """Degree of polarization (...) (thesis 2.13)."""
    s = checked(stokes)
    return _over_s0(np.sqrt(np.sum(s[..., 1:] ** 2, axis=-1)), s)


def docp(stokes: ArrayLike) -> Floats:
    """Signed degree of circular polarization (...) S3 / S0; thesis 2.15 has its magnitude."""
    s = checked(stokes)
    return _over_s0(s[..., 3], s)


def aop(stokes: ArrayLike) -> Floats:
    """Angle of polarization (...), radians in (-pi/2, pi/2] (thesis 2.14); NaN without linear polarization."""
    s = checked(stokes)
    angle = 0.5 * np.arctan2(s[..., 2], s[..., 1])
    angle = np.where(angle <= -np.pi / 2, np.pi / 2, angle)
    return np.where((s[..., 1] == 0) & (s[..., 2] == 0), np.nan, angle)


def ellipticity(stokes: ArrayLike) -> Floats:
    """Angle of ellipticity (...) ``asin(S3 / (DOP S0)) / 2``, radians in -pi/4 to pi/4; NaN for unpolarized light.

    Computed as ``atan2(S3, hypot(S1, S2)) / 2``, which is exact near circular light too.
    """
    s = checked(stokes)
    angle = 0.5 * np.arctan2(s[..., 3], np.hypot(s[..., 1], s[..., 2]))
    return np.where(np.any(s[..., 1:] != 0, axis=-1), angle, np.nan)


def is_physical(stokes: ArrayLike, tolerance: float = 1e-12) -> NDArray[np.bool_]:
    """Whether vectors (..., 4) can be light: ``S0 >= 0`` and ``S0^2 >= S1^2 + S2^2 + S3^2`` (thesis 2.11)."""
    s = checked(stokes)
    polarized = np.sqrt(np.sum(s[..., 1:] ** 2, axis=-1))
    return np.asarray((s[..., 0] >= 0) & (polarized <= s[..., 0] * (1 + tolerance)))


def checked(stokes: ArrayLike) -> Floats:
    """As float64. Raises :class:`DataError` unless the last axis holds four parameters."""
    s = np.asarray(stokes, dtype=np.float64)
    if s.ndim == 0 or s.shape[-1] != 4:
        raise DataError(f"Stokes vectors have shape {s.shape}", "give S0, S1, S2 and S3 along the last axis")
    return s


def _over_s0(part: Floats, stokes: Floats) -> Floats:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(stokes[..., 0] != 0, part / stokes[..., 0], np.nan))
