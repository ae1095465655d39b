"""Fully developed speckle over a known truth: averages of complex Gaussian looks (complex Wishart matrices).

Source: Lee, Hoppel, Mango and Miller 1994, IEEE TGRS 32(5) 1017.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from processing.errors import DataError
from processing.polarimetry.matrices import matrix_of_planes
from processing.polarimetry.pauli import Complexes, Floats


def speckled(truth: ArrayLike, looks: int, generator: np.random.Generator) -> Floats:
    """Planes (9, rows, columns) of averages of ``looks`` independent looks at T or C of planes (9, rows, columns).

    The mean over many is the truth; a pixel whose truth has a NaN is NaN. Truths must not be indefinite beyond their
    rounding: negative eigenvalues count as zero.

    Raises:
        DataError: fewer than one look.
    """
    if looks < 1:
        raise DataError(f"{looks} looks are no image", "give one or more")
    planes = np.asarray(truth, dtype=np.float64)
    defined = np.isfinite(planes).all(axis=0)
    root = _root(matrix_of_planes(np.where(defined, planes, 0.0)))
    made = np.zeros_like(planes)
    for _ in range(looks):
        noise = generator.normal(size=(*root.shape[:-1], 2)) / np.sqrt(2)
        k = np.einsum("...ij,...j->i...", root, noise[..., 0] + 1j * noise[..., 1])
        for plane, (i, j) in ((0, (0, 0)), (5, (1, 1)), (8, (2, 2))):
            made[plane] += (k[i] * k[j].conj()).real
        for plane, (i, j) in ((1, (0, 1)), (3, (0, 2)), (6, (1, 2))):
            product = k[i] * k[j].conj()
            made[plane] += product.real
            made[plane + 1] += product.imag
    return np.where(defined, made / looks, np.nan)


def _root(matrix: Complexes) -> Complexes:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])
