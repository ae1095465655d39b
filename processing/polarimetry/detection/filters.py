"""Intensities in which targets stand out of polarimetric clutter: whitening filter and matched filter.

Both need the clutter's matrix S, (9, ...) planes that broadcast against the image's: of a region, or of each pixel's
surroundings (:func:`processing.polarimetry.detection.cfar.ring_average`). Both give powers with the mean of 1 in
clutter of that matrix, so that one threshold holds everywhere (:mod:`processing.polarimetry.detection.cfar`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from processing.errors import DataError
from processing.polarimetry.matrices import matrix_of_planes
from processing.polarimetry.pauli import Complexes, Floats

CONDITION = 1e-12
"""Determinant, of the cube of a third of the trace, at and below which clutter has no inverse."""


def whitened(planes: ArrayLike, clutter: ArrayLike) -> Floats:
    """Polarimetric whitening filter, (rows, columns): ``tr(S^-1 T) / 3``, the power with the least speckle.

    In clutter of S with L looks its mean is 1 and its variance 1 / 3L, that of three independent channels, whatever S
    is; the span's is between that and 1 / L. Undefined pixels, and pixels whose clutter is singular, are NaN.

    Source: Novak and Burl 1990, IEEE TAES 26(2) 293; of averages: Lopes and Liu 1993, IGARSS.

    Args:
        planes: T or C, (9, rows, columns).
        clutter: S in the same basis, (9,), (9, 1, 1) or (9, rows, columns).

    Raises:
        DataError: other shapes.
    """
    given, inverse = _against(planes, clutter)
    return np.asarray(_trace_of_product(inverse, given) / 3)


def matched(planes: ArrayLike, clutter: ArrayLike, target: ArrayLike) -> Floats:
    """Polarimetric matched filter, (rows, columns): the power of ``w^H k`` over its mean in clutter, w = S^-1 t.

    Of all weights it lifts target t most above clutter of S: by ``t^H S^-1 t`` (:func:`gain`). In clutter its mean is 1
    and its variance 1 / L. Undefined pixels, and pixels whose clutter is singular, are NaN.

    Source: Novak, Sechtin and Cardullo 1989, IEEE TAES 25(2) 150.

    Args:
        planes: T or C, (9, rows, columns).
        clutter: S in the same basis, (9,), (9, 1, 1) or (9, rows, columns).
        target: (3,) scattering vector of the target in the same basis (Pauli for T, lexicographic for C), any length.

    Raises:
        DataError: other shapes, or a target that is zero or not finite.
    """
    given, inverse = _against(planes, clutter)
    vector = _target(target)
    weights = inverse @ vector
    norm = np.einsum("i,...i->...", vector.conj(), weights).real
    matrix = matrix_of_planes(given)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.einsum("...i,...ij,...j->...", weights.conj(), matrix, weights).real / norm)


def gain(clutter: ArrayLike, target: ArrayLike) -> Floats:
    """Target's power over clutter's behind the matched filter (...), ``t^H S^-1 t``, for clutter (9, ...).

    Raises:
        DataError: another shape, or a target that is zero or not finite.
    """
    vector = _target(target)
    inverse = _inverse(np.asarray(clutter, dtype=np.float64))
    return np.asarray(np.einsum("i,...ij,j->...", vector.conj(), inverse, vector).real)


def _target(target: ArrayLike) -> Complexes:
    vector = np.asarray(target, dtype=np.complex128)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not np.abs(vector).any():
        raise DataError("a target is a scattering vector of three finite numbers", "make it with pauli_of_matrix")
    return vector


def _against(planes: ArrayLike, clutter: ArrayLike) -> tuple[Floats, Complexes]:
    given, around = (np.asarray(part, dtype=np.float64) for part in (planes, clutter))
    if around.ndim == 1:
        around = around[:, None, None]
    if given.ndim != 3 or given.shape[0] != 9 or around.shape not in ((9, 1, 1), given.shape):
        raise DataError(
            f"planes {given.shape} and clutter {around.shape} do not fit",
            "give (9, rows, columns) and clutter of one matrix (9,) or one for each pixel",
        )
    return given, _inverse(around)


def _inverse(planes: Floats) -> Complexes:
    """Inverse matrices (..., 3, 3); NaN where there is none."""
    if planes.shape[0] != 9:
        raise DataError(f"clutter of shape {planes.shape} is no planes of matrices", "give (9, ...)")
    third = (planes[0] + planes[5] + planes[8]) / 3
    with np.errstate(divide="ignore", invalid="ignore"):
        matrix = matrix_of_planes(planes / third)
        sound = np.isfinite(planes).all(axis=0) & (third > 0)
        matrix = np.where(sound[..., None, None], matrix, np.eye(3))
        sound &= np.linalg.det(matrix).real > CONDITION
        matrix = np.where(sound[..., None, None], matrix, np.eye(3))
        inverse = np.linalg.inv(matrix) / third[..., None, None]
    return np.asarray(np.where(sound[..., None, None], inverse, np.nan))


def _trace_of_product(matrix: Complexes, planes: Floats) -> Floats:
    """tr(M T) of Hermitian matrices (..., 3, 3) and planes (9, ...)."""
    total = sum(matrix[..., i, i].real * planes[p] for i, p in ((0, 0), (1, 5), (2, 8)))
    for i, j, p in ((0, 1, 1), (0, 2, 3), (1, 2, 6)):
        total = total + 2 * (matrix[..., i, j].real * planes[p] + matrix[..., i, j].imag * planes[p + 1])
    return np.asarray(total)
