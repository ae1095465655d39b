"""Coherency and covariance matrices of images: as planes of real numbers, as matrices, and from one basis to another.

An image of 3 x 3 Hermitian matrices is held as nine real planes, (9, rows, columns), in the order of
:data:`PLANES`: that is how PolSARpro's folders hold it, half as large as complex matrices, and what kernels read.
T = <k k^H> of the Pauli vector, C = <w w^H> of the lexicographic vector (:mod:`processing.polarimetry.pauli`).
Everything broadcasts over the trailing axes of planes, and NaN stays NaN.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError, undefined_is_nan
from processing.polarimetry.pauli import SQRT2, Complexes, Floats

Planes = NDArray[np.floating[Any]]

PLANES = ("11", "12_real", "12_imag", "13_real", "13_imag", "22", "23_real", "23_imag", "33")
"""What each of the nine planes holds; the elements below the diagonal are conjugates of those above."""


def as_planes(values: ArrayLike) -> Planes:
    """Nine planes as contiguous float32 (from float32) or float64 (from all else), (9, rows, columns).

    Raises:
        DataError: another shape, or complex numbers.
    """
    found = np.asarray(values)
    if found.ndim != 3 or found.shape[0] != len(PLANES) or np.iscomplexobj(found):
        raise DataError(
            f"matrices must be nine real planes (9, rows, columns), not {found.dtype} {found.shape}",
            "make them with planes_of_matrix or planes_of_vector",
        )
    return np.ascontiguousarray(found, dtype=np.float32 if found.dtype == np.float32 else np.float64)


def planes_of_matrix(matrix: ArrayLike) -> Floats:
    """Planes (9, ...) of Hermitian matrices (..., 3, 3); what stands below the diagonal is not read."""
    m = np.asarray(matrix, dtype=np.complex128)
    m12, m13, m23 = m[..., 0, 1], m[..., 0, 2], m[..., 1, 2]
    return np.stack(
        [m[..., 0, 0].real, m12.real, m12.imag, m13.real, m13.imag, m[..., 1, 1].real, m23.real, m23.imag,
         m[..., 2, 2].real]
    )  # fmt: skip


@undefined_is_nan
def matrix_of_planes(planes: ArrayLike) -> Complexes:
    """Hermitian matrices (..., 3, 3) of planes (9, ...)."""
    p = np.asarray(planes, dtype=np.float64)
    matrix = np.empty((*p.shape[1:], 3, 3), dtype=np.complex128)
    for i, plane in ((0, 0), (1, 5), (2, 8)):
        matrix[..., i, i] = p[plane]
    for i, j, plane in ((0, 1, 1), (0, 2, 3), (1, 2, 6)):
        matrix[..., i, j] = p[plane] + 1j * p[plane + 1]
        matrix[..., j, i] = matrix[..., i, j].conj()
    return matrix


def planes_of_vector(vector: ArrayLike) -> Planes:
    """Planes (9, ...) of the single-look matrices ``k k^H`` of vectors (3, ...): float32 of complex64, else float64."""
    k = np.asarray(vector)
    made: Planes = np.empty((len(PLANES), *k.shape[1:]), dtype=np.float32 if k.dtype == np.complex64 else np.float64)
    one, two, three = k.astype(np.complex128, copy=False)
    for plane, value in ((0, one), (5, two), (8, three)):
        made[plane] = value.real**2 + value.imag**2
    for plane, first, second in ((1, one, two), (3, one, three), (6, two, three)):
        product = first * second.conj()
        made[plane], made[plane + 1] = product.real, product.imag
    return made


def covariance_of_coherency(planes: ArrayLike) -> Planes:
    """C (9, ...) of T (9, ...): C = U T U^H with the lexicographic vector w = U k, in float64, rounded to the input's.

    Its inverse is :func:`coherency_of_covariance`.
    """
    given = np.asarray(planes)
    t11, t12r, t12i, t13r, t13i, t22, t23r, t23i, t33 = given.astype(np.float64)
    half, part = (t11 + t22) / 2, 1 / SQRT2
    made = np.stack(
        [half + t12r, (t13r + t23r) * part, (t13i + t23i) * part, (t11 - t22) / 2, -t12i, t33, (t13r - t23r) * part,
         (t23i - t13i) * part, half - t12r]
    )  # fmt: skip
    return made.astype(given.dtype) if given.dtype == np.float32 else made


def coherency_of_covariance(planes: ArrayLike) -> Planes:
    """T (9, ...) of C (9, ...); the inverse of :func:`covariance_of_coherency`."""
    given = np.asarray(planes)
    c11, c12r, c12i, c13r, c13i, c22, c23r, c23i, c33 = given.astype(np.float64)
    half, part = (c11 + c33) / 2, 1 / SQRT2
    made = np.stack(
        [half + c13r, (c11 - c33) / 2, -c13i, (c12r + c23r) * part, (c12i - c23i) * part, half - c13r,
         (c12r - c23r) * part, (c12i + c23i) * part, c22]
    )  # fmt: skip
    return made.astype(given.dtype) if given.dtype == np.float32 else made


def total_power(planes: ArrayLike) -> Floats:
    """Span (...), the trace of T or C (9, ...), m^2."""
    p = np.asarray(planes)
    return np.asarray(p[0].astype(np.float64) + p[5] + p[8])


@undefined_is_nan
def coherency_turned(matrix: ArrayLike, angle_rad: ArrayLike) -> Complexes:
    """T (..., 3, 3) of targets turned by ``angle_rad`` (...) about the line of sight.

    ``R T R^T``, R a rotation by 2 angle in the plane of the second and third Pauli component (Lee and Pottier 2009,
    3.2); the matrices' counterpart of :func:`processing.polarimetry.targets.turned`.
    """
    angle = 2 * np.asarray(angle_rad, dtype=np.float64)
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(c), np.ones_like(c)
    r = np.stack([np.stack([one, zero, zero], -1), np.stack([zero, c, -s], -1), np.stack([zero, s, c], -1)], axis=-2)
    return np.asarray(r @ np.asarray(matrix, dtype=np.complex128) @ np.swapaxes(r, -1, -2))


def basis_vectors(orientation_rad: float, ellipticity_rad: float) -> Complexes:
    """Two orthogonal unit Jones vectors as columns (2, 2): a wave of that orientation and ellipticity, and the other.

    ``R(orientation) [[cos, j sin], [j sin, cos]]`` of the ellipticity (Lee and Pottier 2009, 2.2); determinant 1.
    Ellipticity +45 degrees is right-handed (S3 > 0, thesis Table 2.3).
    """
    c, s = np.cos(orientation_rad), np.sin(orientation_rad)
    a, b = np.cos(ellipticity_rad), 1j * np.sin(ellipticity_rad)
    return np.asarray(np.array([[c, -s], [s, c]]) @ np.array([[a, b], [b, a]]))


def scattering_in_basis(matrix: ArrayLike, basis: ArrayLike) -> Complexes:
    """Scattering matrices (..., 2, 2) from (h, v) into another basis: ``U^T S U``, U (2, 2) its unit vectors.

    Transposed, not conjugated: in backscatter alignment transmitted and received wave run in opposite directions
    (consimilarity; Lee and Pottier 2009, 3.1). The span does not change.
    """
    u = np.asarray(basis, dtype=np.complex128)
    return np.asarray(u.T @ np.asarray(matrix, dtype=np.complex128) @ u)


def covariance_in_basis(matrix: ArrayLike, basis: ArrayLike) -> Complexes:
    """C (..., 3, 3) from (h, v) into another basis: what ``U^T S U`` does to the lexicographic vectors."""
    u = np.asarray(basis, dtype=np.complex128)
    a, b, c, d = u[0, 0], u[0, 1], u[1, 0], u[1, 1]
    q = np.array(
        [[a * a, SQRT2 * a * c, c * c], [SQRT2 * a * b, a * d + b * c, SQRT2 * c * d], [b * b, SQRT2 * b * d, d * d]]
    )
    return np.asarray(q @ np.asarray(matrix, dtype=np.complex128) @ q.conj().T)
