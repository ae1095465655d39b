"""Coherent decompositions of scattering matrices: Krogager's sphere, diplane and helix; Cameron's symmetric targets.

They look at one scattering matrix, not at an average. Sources: Krogager 1990, Electronics Letters 26(18) 1525;
Cameron, Youssef and Leung 1996, IEEE TGRS 34(3) 793. Undefined pixels are NaN (class 0).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError, undefined_is_nan
from processing.polarimetry.pauli import SQRT2, Complexes, Floats

Amplitudes = NDArray[np.complexfloating[Any, Any]]

KROGAGER = ("sphere", "diplane", "helix", "orientation")
"""What :func:`krogager` returns: amplitudes in sqrt(m^2), and the diplane's orientation in (-45, 45] degrees, rad."""
CAMERON = ("class", "symmetry", "orientation", "ratio")
"""What :func:`cameron` returns: number of the class, angle of symmetry (0 symmetric, 45 degrees helix) and orientation,
both rad, and the size of the symmetric part's smaller over its larger eigenvalue."""
CLASSES = (
    "undefined", "trihedral", "cylinder", "dipole", "narrow diplane", "dihedral", "quarter wave", "left helix",
    "right helix", "asymmetric", "non-reciprocal",
)  # fmt: skip
"""Names of Cameron's classes, by their numbers."""

_DIAGONALS = np.array([1.0, 0.5, 0.0, -0.5, -1.0, 1j])
"""Second over first diagonal element of classes 1 to 6."""


@undefined_is_nan
def krogager(scattering: ArrayLike) -> Floats:
    """:data:`KROGAGER` (4, ...) of scattering matrices (..., 2, 2) in (h, v); the mean of both cross elements counts.

    In circular polarization ``S_rr = j S_hv + (S_hh - S_vv)/2``, ``S_ll = j S_hv - (S_hh - S_vv)/2`` and
    ``S_rl = j (S_hh + S_vv)/2``: sphere |S_rl|, diplane the lesser of |S_rr| and |S_ll|, helix their difference. A pure
    helix or sphere has no orientation (NaN). The three are not orthogonal, so their powers do not sum to the span.
    """
    s = np.asarray(scattering, dtype=np.complex128)
    cross, half = (s[..., 0, 1] + s[..., 1, 0]) / 2, (s[..., 0, 0] - s[..., 1, 1]) / 2
    right, left = np.abs(1j * cross + half), np.abs(1j * cross - half)
    sphere = np.abs(s[..., 0, 0] + s[..., 1, 1]) / 2
    diplane = np.minimum(right, left)
    floor = 8 * np.finfo(float).eps * np.maximum(np.maximum(right, left), sphere)
    with np.errstate(invalid="ignore"):
        turn = np.angle((1j * cross + half) * np.conj(half - 1j * cross))
        # S_rr is proportional to exp(2j angle), -S_ll to exp(-2j angle).
        orientation = np.where(diplane > floor, turn / 4, np.nan)
    return np.stack([sphere, diplane, np.abs(right - left), orientation])


def krogager_powers(planes: ArrayLike) -> Floats:
    """Mean sphere, diplane and helix amplitudes squared, (3, ...), m^2, of coherency planes (9, ...).

    From <|S_rr|^2> and <|S_ll|^2> = (T22 + T33)/2 +- Im T23 and <|S_rl|^2> = T11/2; what Krogager's amplitudes are
    where only averages are left.
    """
    t = np.asarray(planes, dtype=np.float64)
    right = np.sqrt(np.maximum((t[5] + t[8]) / 2 + t[7], 0.0))
    left = np.sqrt(np.maximum((t[5] + t[8]) / 2 - t[7], 0.0))
    sound = np.where(np.isfinite(t).all(axis=0), 0.0, np.nan)
    return np.stack([t[0] / 2 + sound, np.minimum(right, left) ** 2 + sound, (right - left) ** 2 + sound])


def cameron(scattering: Amplitudes) -> Floats:
    """:data:`CAMERON` (4, rows, columns) of scattering matrices (4, rows, columns): HH, HV, VH, VV; compiled.

    A target is non-reciprocal where more than half of its power lies outside reciprocal matrices; asymmetric where its
    angle of symmetry is above 22.5 degrees, and then a helix if it is within 45 degrees of one; else the nearest of
    trihedral, cylinder, dipole, narrow diplane, dihedral and quarter wave. Orientation lies in (-90, 90] degrees
    (dihedral (-45, 45]); a trihedral has none (NaN), nor have classes above 6.

    Raises:
        DataError: matrices of another shape.
    """
    s = np.ascontiguousarray(_checked(scattering), dtype=np.complex128)
    made = np.empty((len(CAMERON), *s.shape[1:]))
    _image(s, made)
    return made


@undefined_is_nan
def cameron_reference(scattering: Amplitudes) -> Floats:
    """The definition of :func:`cameron` in NumPy."""
    hh, hv, vh, vv = _checked(scattering).astype(np.complex128)
    a, b, c, d = (hh + vv) / SQRT2, (hh - vv) / SQRT2, (hv + vh) / SQRT2, (hv - vh) / SQRT2
    reciprocal = np.abs(a) ** 2 + np.abs(b) ** 2 + np.abs(c) ** 2
    angle = np.arctan2(2 * (b * c.conj()).real, np.abs(b) ** 2 - np.abs(c) ** 2) / 2
    e, lost = b * np.cos(angle) + c * np.sin(angle), c * np.cos(angle) - b * np.sin(angle)
    symmetry = np.arctan2(np.abs(lost), np.hypot(np.abs(a), np.abs(e)))
    first, second = (a + e) / SQRT2, (a - e) / SQRT2
    orientation = angle / 2
    swap = np.abs(second) > np.abs(first) * (1 + 1e-12)
    first, second = np.where(swap, second, first), np.where(swap, first, second)
    orientation = np.where(swap, orientation + np.pi / 2, orientation)
    orientation = np.where(orientation > np.pi / 2, orientation - np.pi, orientation)
    norm = np.sqrt(np.abs(first) ** 2 + np.abs(second) ** 2)
    matches = np.stack([_match(first, second, z) for z in _DIAGONALS])
    kind = 1 + np.argmax(matches - 1e-9 * np.arange(6)[:, None, None] * norm, axis=0)
    orientation = np.where(kind == 5, np.where(np.abs(angle) > 0, angle / 2, 0.0), orientation)
    left, right = np.abs(b - 1j * c), np.abs(b + 1j * c)
    helical = np.where(
        np.maximum(left, right) ** 2 > reciprocal, np.where(left > right, 7, 8), 9
    )  # |<k, helix>|^2 = |b -+ j c|^2 / 2 is above half of the power
    kind = np.where(symmetry > np.pi / 8, helical, kind)
    kind = np.where(np.abs(d) ** 2 > reciprocal, 10, kind)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.abs(second) / np.abs(first)
    orientation = np.where((kind == 1) | (kind > 6), np.nan, orientation)
    found = np.stack([kind.astype(float), symmetry, orientation, ratio])
    sound = np.isfinite(reciprocal + np.abs(d)) & (reciprocal + np.abs(d) ** 2 > 0)
    return np.where(sound, found, np.array([0, np.nan, np.nan, np.nan])[:, None, None])


def _match(first: Complexes, second: Complexes, z: complex) -> Floats:
    """How near diag(first, second) is to diag(1, z) or diag(z, 1), whatever their phases: the overlap's size."""
    straight, swapped = np.abs(first + second * np.conj(z)), np.abs(first * np.conj(z) + second)
    return np.asarray(np.maximum(straight, swapped) / np.sqrt(1 + abs(z) ** 2))


def _checked(scattering: Amplitudes) -> Amplitudes:
    given = np.asarray(scattering)
    if given.ndim != 3 or given.shape[0] != 4:
        raise DataError(f"scattering matrices must be (4, rows, columns), not {given.shape}", "give HH, HV, VH, VV")
    return given


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def _image(s: NDArray[np.complex128], made: NDArray[np.float64]) -> None:
    for row in prange(s.shape[1]):
        for column in range(s.shape[2]):
            kind, symmetry, orientation, ratio = _pixel(
                s[0, row, column], s[1, row, column], s[2, row, column], s[3, row, column]
            )
            made[0, row, column], made[1, row, column] = kind, symmetry
            made[2, row, column], made[3, row, column] = orientation, ratio


@njit(cache=True, nogil=True, error_model="numpy")
def _pixel(hh: complex, hv: complex, vh: complex, vv: complex) -> tuple[float, float, float, float]:
    a, b, c = (hh + vv) / SQRT2, (hh - vv) / SQRT2, (hv + vh) / SQRT2
    outside = _square(hv - vh) / 2.0
    reciprocal = _square(a) + _square(b) + _square(c)
    if not (reciprocal + outside > 0.0 and reciprocal + outside < np.inf):
        return 0.0, np.nan, np.nan, np.nan
    angle = math.atan2(2.0 * (b * c.conjugate()).real, _square(b) - _square(c)) / 2.0
    cosine, sine = math.cos(angle), math.sin(angle)
    e, lost = b * cosine + c * sine, c * cosine - b * sine
    symmetry = math.atan2(abs(lost), math.hypot(abs(a), abs(e)))
    first, second, orientation = (a + e) / SQRT2, (a - e) / SQRT2, angle / 2.0
    if abs(second) > abs(first) * (1.0 + 1e-12):
        first, second = second, first
        orientation += math.pi / 2
        if orientation > math.pi / 2:
            orientation -= math.pi
    ratio = abs(second) / abs(first)
    if outside > reciprocal:
        return 10.0, symmetry, np.nan, ratio
    if symmetry > math.pi / 8:
        left, right = _square(b - 1j * c), _square(b + 1j * c)
        helix = 7.0 if left > right else 8.0
        return helix if max(left, right) > reciprocal else 9.0, symmetry, np.nan, ratio
    norm, best, kind = math.sqrt(_square(first) + _square(second)), -1.0, 0
    for n in range(6):
        z = _DIAGONALS[n].conjugate()
        match = max(abs(first + second * z), abs(first * z + second)) / math.sqrt(1.0 + _square(z)) - 1e-9 * n * norm
        if match > best:
            best, kind = match, n + 1
    if kind == 1:
        return 1.0, symmetry, np.nan, ratio
    # A dihedral turned by 90 degrees is the same but for its sign.
    return float(kind), symmetry, angle / 2.0 if kind == 5 else orientation, ratio


@njit(cache=True, nogil=True)
def _square(z: complex) -> float:
    return z.real * z.real + z.imag * z.imag
