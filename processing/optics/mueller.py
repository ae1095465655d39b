"""Mueller calculus: elements, chains, and whether a matrix can belong to anything (thesis 2.16 to 2.18, Cloude 1986).

Linear polarizers, ideal and imperfect, are :func:`processing.optics.analyser.polarizer`. Matrices are (..., 4, 4)
in the frames of :mod:`processing.optics.stokes_vectors`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.optics import jones
from processing.optics.analyser import polarizer as polarizer

Floats = NDArray[np.float64]


def rotator(angle_rad: ArrayLike) -> Floats:
    """Matrices (..., 4, 4) that describe light in axes turned by ``angle_rad`` (counter-clockwise, as received)."""
    double = 2 * np.asarray(angle_rad, dtype=np.float64)
    matrix = np.zeros((*double.shape, 4, 4))
    matrix[..., 0, 0] = matrix[..., 3, 3] = 1.0
    matrix[..., 1, 1] = matrix[..., 2, 2] = np.cos(double)
    matrix[..., 1, 2] = np.sin(double)
    matrix[..., 2, 1] = -matrix[..., 1, 2]
    return matrix


def turned(matrix: ArrayLike, angle_rad: ArrayLike) -> Floats:
    """Matrices of elements that are turned by ``angle_rad`` from where ``matrix`` describes them."""
    angle = np.asarray(angle_rad, dtype=np.float64)
    return np.asarray(rotator(-angle) @ checked(matrix) @ rotator(angle))


def retarder(angle_rad: float, retardance_rad: float) -> Floats:
    """Matrix (4, 4) of a linear retarder with its fast axis at ``angle_rad``; see :func:`jones.retarder`."""
    return jones.mueller(jones.retarder(angle_rad, retardance_rad))


def imperfect_retarder(angle_rad: float, retardance_rad: float, q: float, r: float) -> Floats:
    """Matrix (4, 4) of a linear retarder that also transmits its fast axis by ``q`` and its slow axis by ``r``.

    Raises:
        DataError: a transmittance outside 0 to 1.
    """
    jones.check_transmittances(q, r)
    return jones.mueller(jones.polarizer(angle_rad, q, r) @ jones.retarder(angle_rad, retardance_rad))


def depolarizer(s1: float, s2: float | None = None, s3: float | None = None) -> Floats:
    """Matrix (4, 4) ``diag(1, s1, s2, s3)``; one number depolarizes all alike (0: wholly).

    Raises:
        DataError: factors that no matter has, such as ``(1, 1, -1)``.
    """
    matrix = np.diag([1.0, s1, s1 if s2 is None else s2, s1 if s3 is None else s3])
    if not is_realizable(matrix):
        raise DataError(
            f"a depolarizer with factors {s1}, {s2}, {s3} would make light that cannot be",
            "give factors from -1 to 1 with |s1 +- s2| <= 1 +- s3",
        )
    return matrix


def chain(*matrices: ArrayLike) -> Floats:
    """Matrix of elements that light passes in the order given (thesis 2.17: the product has the last one first).

    Raises:
        DataError: no element at all, or one that is not (..., 4, 4).
    """
    if not matrices:
        raise DataError("a chain of no elements was asked for", "give the Mueller matrices that light passes")
    product = checked(matrices[0])
    for matrix in matrices[1:]:
        product = checked(matrix) @ product
    return product


def eigenvalues(matrix: ArrayLike) -> Floats:
    """Cloude's four eigenvalues (..., 4), falling, of Mueller matrices; their sum is M00.

    All are zero or more exactly where the matrix is a sum of matrices with a Jones matrix; a single one that is not
    zero means that it does not depolarize (Cloude 1986, Optik 75, 26).
    """
    return np.asarray(np.linalg.eigvalsh(jones.covariance_of_mueller(checked(matrix)))[..., ::-1] / 2)


def is_realizable(matrix: ArrayLike, tolerance: float = 1e-9) -> NDArray[np.bool_]:
    """Whether matrices (..., 4, 4) can belong to matter: no eigenvalue below ``-tolerance`` of M00."""
    m = checked(matrix)
    return np.asarray((m[..., 0, 0] >= 0) & (eigenvalues(m)[..., -1] >= -tolerance * m[..., 0, 0]))


def nearest_realizable(matrix: ArrayLike) -> Floats:
    """The realizable matrices (..., 4, 4) nearest to given ones: Cloude's negative eigenvalues are set to zero."""
    covariance = jones.covariance_of_mueller(checked(matrix))
    values, vectors = np.linalg.eigh(covariance)
    kept = np.maximum(values, 0.0)
    return jones.mueller_of_covariance((vectors * kept[..., None, :]) @ np.swapaxes(vectors, -1, -2).conj())


def depolarization_index(matrix: ArrayLike) -> Floats:
    """Gil and Bernabeu's index (...): 1 for matrices that do not depolarize, 0 for the ideal depolarizer."""
    m = checked(matrix)
    total = np.sum(m * m, axis=(-2, -1))
    with np.errstate(divide="ignore", invalid="ignore"):
        inside = (total - m[..., 0, 0] ** 2) / (3 * m[..., 0, 0] ** 2)
    return np.asarray(np.sqrt(np.maximum(inside, 0.0)))


def diattenuation(matrix: ArrayLike) -> Floats:
    """(Tmax - Tmin) / (Tmax + Tmin) (...) over all polarizations of the light that comes in."""
    m = checked(matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sqrt(np.sum(m[..., 0, 1:] ** 2, axis=-1)) / m[..., 0, 0])


def polarizance(matrix: ArrayLike) -> Floats:
    """Degree of polarization (...) that unpolarized light is given."""
    m = checked(matrix)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sqrt(np.sum(m[..., 1:, 0] ** 2, axis=-1)) / m[..., 0, 0])


def extinction_scale(extinction_ratio: float) -> float:
    """Factor ``(e - 1) / (e + 1)`` by which a polarizer of that extinction ratio scales a measured DOLP.

    Raises:
        DataError: a ratio of 1 or less.
    """
    if not extinction_ratio > 1:
        raise DataError(f"the extinction ratio is {extinction_ratio}", "give a number above 1")
    return 1.0 if math.isinf(extinction_ratio) else (extinction_ratio - 1) / (extinction_ratio + 1)


def checked(matrix: ArrayLike) -> Floats:
    """As float64. Raises :class:`DataError` unless the last two axes are 4 by 4 and all elements are finite."""
    m = np.asarray(matrix, dtype=np.float64)
    if m.shape[-2:] != (4, 4):
        raise DataError(f"Mueller matrices have shape {m.shape}", "give 4 by 4 elements along the last two axes")
    if not np.isfinite(m).all():
        raise DataError("a Mueller matrix holds elements that are not finite", "leave undefined pixels out")
    return m
