"""Touzi's target scattering vector model: each eigenvector of T as a turned, helical, partly odd and even scatterer.

Source: Touzi 2007, IEEE TGRS 45(1) 73. An eigenvector is, but for its phase, the Pauli vector

    (cos a cos 2t, sin a e^(j f), -j cos a sin 2t), turned by psi about the line of sight,

with a the scattering type's magnitude (0 odd bounce, 90 degrees dihedral), f its phase, t the helicity
(-45 to 45 degrees, 0 for a symmetric target) and psi the orientation. Mean values weigh by the eigenvalues.
psi and psi + 90 degrees with t and f + 180 degrees turned around are the same target; psi within -45 to 45 degrees
is given here.

Limits: an eigenvector without a first component has no phase to refer to; it is turned so that its linear part is real
(dihedral at psi: a = 90 degrees, f = t = 0). Rounding is cut off: components below :func:`resolution` count as zero.
Eigenvectors of equal eigenvalues are arbitrary and so are the values of each; undefined and powerless pixels are NaN.
"""

from __future__ import annotations

import cmath
import math
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from processing.polarimetry.eigen import hermitian_eigen
from processing.polarimetry.h_a_alpha import resolution
from processing.polarimetry.matrices import Planes, as_planes, matrix_of_planes
from processing.polarimetry.pauli import Floats

_ANGLES = ("alpha_s", "phi_s", "tau", "psi")
PARAMETERS = tuple(f"{name}{n}" for name in _ANGLES for n in (1, 2, 3)) + _ANGLES
"""What :func:`touzi` returns, in order, radians: each angle of the three eigenvectors, then the weighted means."""


def touzi(planes: Planes) -> Planes:
    """:data:`PARAMETERS` (16, rows, columns), rad, of coherency planes (9, rows, columns), as averages; compiled.

    Float32 planes give float32 parameters (computed in float64 within), all others float64.
    """
    given = as_planes(planes)
    made = np.empty((len(PARAMETERS), *given.shape[1:]), dtype=given.dtype)
    _image(given, resolution(given.dtype), made)
    return made


def touzi_reference(planes: Planes) -> Floats:
    """The definition of :func:`touzi` in NumPy and float64, with LAPACK's eigenvectors."""
    given = as_planes(planes)
    sound = np.isfinite(given).all(axis=0)
    values, vectors = (p[..., ::-1] for p in np.linalg.eigh(matrix_of_planes(np.where(sound, given, 0.0))))
    values = np.maximum(values, 0.0)
    total = values.sum(axis=-1)
    sound &= total > 0
    v1, v2, v3 = np.moveaxis(vectors, -2, 0)
    small = resolution(given.dtype)
    v1, v2, v3 = (np.where(np.abs(v) <= small, 0.0, v) for v in (v1, v2, v3))
    linear = v2**2 + v3**2
    phase = np.where(v1 != 0, np.angle(v1), np.where(np.abs(linear) > small, np.angle(linear) / 2, np.angle(v2)))
    v1, v2, v3 = (v * np.exp(-1j * phase) for v in (v1, v2, v3))
    psi = np.where((np.abs(v2.real) > small) | (np.abs(v3.real) > small), np.arctan2(v3.real, v2.real) / 2, 0.0)
    psi = np.where(psi > np.pi / 4, psi - np.pi / 2, np.where(psi <= -np.pi / 4, psi + np.pi / 2, psi))
    c, s = np.cos(2 * psi), np.sin(2 * psi)
    even, helical = v2 * c + v3 * s, v3.imag * c - v2.imag * s
    sign = np.where((v1 == 0) & (even.real < 0), -1.0, 1.0)
    even, helical = sign * even, sign * helical
    tau = np.arctan2(-helical, v1.real) / 2
    alpha = np.arctan2(np.abs(even), np.hypot(v1.real, helical))
    phi = np.where(np.abs(even) > small, np.angle(even), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        p = values / total[..., None]
    angles = (alpha, phi, tau, psi)
    found = np.stack([a[..., i] for a in angles for i in range(3)] + [np.sum(p * a, axis=-1) for a in angles])
    return np.where(sound, found, np.nan)


def target_vector(alpha_s: float, phi_s: float, tau: float, psi: float) -> NDArray[np.complex128]:
    """Unit Pauli vector (3,) of the model's angles, rad: the inverse of what :func:`touzi` finds."""
    k = np.array(
        [
            np.cos(alpha_s) * np.cos(2 * tau),
            np.sin(alpha_s) * np.exp(1j * phi_s),
            -1j * np.cos(alpha_s) * np.sin(2 * tau),
        ]
    )
    c, s = np.cos(2 * psi), np.sin(2 * psi)
    return np.array([k[0], c * k[1] - s * k[2], s * k[1] + c * k[2]])


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def _image(t: NDArray[Any], small: float, made: NDArray[Any]) -> None:
    for row in prange(t.shape[1]):
        # prange counts unsigned; without the cast the row would be compiled for both kinds of numbers.
        _row(t, small, made, np.int64(row))


@njit(cache=True, nogil=True, error_model="numpy")
def _row(t: NDArray[Any], small: float, made: NDArray[Any], row: Any) -> None:
    values = np.empty(3)
    vectors = np.empty((3, 3), dtype=np.complex128)
    means = np.empty(4)
    for column in range(t.shape[2]):
        sound = 0.0
        for plane in range(9):
            sound += t[plane, row, column] * 0.0
        total = 0.0
        if sound == 0.0:
            hermitian_eigen(
                np.float64(t[0, row, column]), complex(t[1, row, column], t[2, row, column]),
                complex(t[3, row, column], t[4, row, column]), np.float64(t[5, row, column]),
                complex(t[6, row, column], t[7, row, column]), np.float64(t[8, row, column]), values, vectors,
            )  # fmt: skip
            for i in range(3):
                values[i] = max(values[i], 0.0)
                total += values[i]
        if not total > 0.0:
            made[:, row, column] = np.nan
            continue
        means[:] = 0.0
        for i in range(3):
            angles = _angles(vectors[0, i], vectors[1, i], vectors[2, i], small)
            for k in range(4):
                made[3 * k + i, row, column] = angles[k]
                means[k] += values[i] / total * angles[k]
        for k in range(4):
            made[12 + k, row, column] = means[k]


@njit(cache=True, nogil=True, error_model="numpy")
def _angles(v1: complex, v2: complex, v3: complex, small: float) -> tuple[float, float, float, float]:
    v1 = v1 if abs(v1) > small else 0j
    v2 = v2 if abs(v2) > small else 0j
    v3 = v3 if abs(v3) > small else 0j
    if v1 != 0j:
        turn = v1.conjugate() / abs(v1)
    else:
        linear = v2 * v2 + v3 * v3
        phase = cmath.phase(linear) / 2.0 if abs(linear) > small else cmath.phase(v2)
        turn = complex(math.cos(phase), -math.sin(phase))
    v1, v2, v3 = v1 * turn, v2 * turn, v3 * turn
    psi = 0.0
    if abs(v2.real) > small or abs(v3.real) > small:
        psi = math.atan2(v3.real, v2.real) / 2.0
    if psi > math.pi / 4:
        psi -= math.pi / 2
    elif psi <= -math.pi / 4:
        psi += math.pi / 2
    c, s = math.cos(2.0 * psi), math.sin(2.0 * psi)
    even, helical = v2 * c + v3 * s, v3.imag * c - v2.imag * s
    if v1 == 0j and even.real < 0.0:
        even, helical = -even, -helical
    size = abs(even)
    alpha = math.atan2(size, math.hypot(v1.real, helical))
    return alpha, cmath.phase(even) if size > small else 0.0, math.atan2(-helical, v1.real) / 2.0, psi
