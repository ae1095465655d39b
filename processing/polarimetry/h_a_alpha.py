"""Cloude and Pottier's entropy, anisotropy and mean alpha from the eigenvalues and eigenvectors of coherency matrices.

Source: Cloude and Pottier 1997, IEEE TGRS 35(1) 68. Entropy is ``-sum p log3 p``, anisotropy ``(l2 - l3) / (l2 + l3)``,
alpha ``sum p_i arccos |v_i1|`` with ``p_i`` the eigenvalues over their sum.

Limits, of the kernel and the reference alike:

- Eigenvalues below zero, which rounding and noise subtraction make, count as zero. A pixel without power or with an
  undefined element is NaN.
- Eigenvalues that differ by less than rounding (:func:`resolution` of the largest) have no eigenvectors of their own,
  and alpha would be arbitrary. Of the vectors of their common space those are taken that are along, and at right angles
  to, the first Pauli component. So T of pure noise has entropy 1 and alpha 60 degrees, as the average over all vectors.
- Anisotropy is NaN where the second and third eigenvalue are rounding only (a single look, one mechanism).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from processing.polarimetry.eigen import hermitian_eigen
from processing.polarimetry.matrices import Planes, as_planes, matrix_of_planes
from processing.polarimetry.pauli import Floats

PARAMETERS = ("entropy", "anisotropy", "alpha", "alpha1", "lambda1", "lambda2", "lambda3")
"""What :func:`h_a_alpha` returns, in order: alpha and alpha1 (of the largest eigenvalue) in radians, lambda in m^2."""


def resolution(dtype: Any) -> float:
    """What counts as rounding of an eigenvalue, of the largest: eight units in the last place of the planes' type."""
    return 8 * float(np.finfo(dtype).eps)


def h_a_alpha(planes: Planes) -> Planes:
    """:data:`PARAMETERS` (7, rows, columns) of coherency planes (9, rows, columns), which should be averages; compiled.

    Float32 planes give float32 parameters (computed in float64 within), all others float64.
    """
    given = as_planes(planes)
    made = np.empty((len(PARAMETERS), *given.shape[1:]), dtype=given.dtype)
    _image(given, resolution(given.dtype), made)
    return made


def h_a_alpha_reference(planes: Planes) -> Floats:
    """The definition of :func:`h_a_alpha` in NumPy and float64, with LAPACK's eigenvectors."""
    given = as_planes(planes)
    small = resolution(given.dtype)
    sound = np.isfinite(given).all(axis=0)
    matrix = matrix_of_planes(np.where(sound, given, 0.0))
    values, vectors = (part[..., ::-1] for part in np.linalg.eigh(matrix))
    values = np.maximum(values, 0.0)
    total = values.sum(axis=-1)
    sound &= total > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        p = values / total[..., None]
        entropy = -np.sum(np.where(p > 0, p * np.log(np.where(p > 0, p, 1.0)), 0.0), axis=-1) / np.log(3)
        rest = values[..., 1] + values[..., 2]
        anisotropy = np.where(rest > small * values[..., 0], (values[..., 1] - values[..., 2]) / rest, np.nan)
    along = np.abs(vectors[..., 0, :]) ** 2
    across = np.abs(vectors[..., 1, :]) ** 2 + np.abs(vectors[..., 2, :]) ** 2
    for i in (1, 0):
        equal = values[..., i] - values[..., i + 1] <= small * values[..., 0]
        along[..., i] += np.where(equal, along[..., i + 1], 0.0)
        across[..., i] += np.where(equal, across[..., i + 1] - 1, 0.0)
        along[..., i + 1] = np.where(equal, 0.0, along[..., i + 1])
        across[..., i + 1] = np.where(equal, 1.0, across[..., i + 1])
    alphas = np.arctan2(np.sqrt(np.maximum(across, 0.0)), np.sqrt(along))
    found = np.stack(
        [np.clip(entropy, 0, 1), anisotropy, np.sum(p * alphas, axis=-1), alphas[..., 0], *np.moveaxis(values, -1, 0)]
    )
    return np.where(sound, found, np.nan)


@njit(cache=True, nogil=True, parallel=True, error_model="numpy")
def _image(t: NDArray[Any], small: float, made: NDArray[Any]) -> None:
    for row in prange(t.shape[1]):
        # prange counts unsigned; without the cast the row would be compiled for both kinds of numbers.
        _row(t, small, made, np.int64(row))


@njit(cache=True, nogil=True, error_model="numpy")
def _row(t: NDArray[Any], small: float, made: NDArray[Any], row: Any) -> None:
    values = np.empty(3)
    vectors = np.empty((3, 3), dtype=np.complex128)
    alphas, along, across = np.empty(3), np.empty(3), np.empty(3)
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
            for k in range(made.shape[0]):
                made[k, row, column] = np.nan
            continue
        for i in range(3):
            along[i] = _square(vectors[0, i])
            across[i] = _square(vectors[1, i]) + _square(vectors[2, i])
        for i in (1, 0):
            if values[i] - values[i + 1] <= small * values[0]:
                along[i] += along[i + 1]
                across[i] += across[i + 1] - 1.0
                along[i + 1], across[i + 1] = 0.0, 1.0
        entropy, alpha = 0.0, 0.0
        for i in range(3):
            p = values[i] / total
            alphas[i] = math.atan2(math.sqrt(max(across[i], 0.0)), math.sqrt(along[i]))
            alpha += p * alphas[i]
            if p > 0.0:
                entropy -= p * math.log(p)
        rest = values[1] + values[2]
        made[0, row, column] = min(max(entropy / _LOG3, 0.0), 1.0)
        made[1, row, column] = (values[1] - values[2]) / rest if rest > small * values[0] else np.nan
        made[2, row, column] = alpha
        made[3, row, column] = alphas[0]
        for i in range(3):
            made[4 + i, row, column] = values[i]


_LOG3 = math.log(3.0)


@njit(cache=True, nogil=True)
def _square(z: complex) -> float:
    return z.real * z.real + z.imag * z.imag
