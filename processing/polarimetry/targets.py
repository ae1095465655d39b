"""Canonical targets: their scattering matrices S[rx, tx] of unit amplitude, backscatter alignment, (h, v) basis.

Source: Cloude and Pottier 1996 (review of target decompositions); thesis 5.12 for trihedral and dihedral.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.complex128]


def trihedral() -> Matrix:
    """Odd bounce: sphere, plate, trihedral."""
    return np.eye(2, dtype=np.complex128)


def dihedral(fold_rad: float = 0.0) -> Matrix:
    """Even bounce: dihedral whose fold lies at ``fold_rad`` from horizontal."""
    c, s = np.cos(2 * fold_rad), np.sin(2 * fold_rad)
    return np.array([[c, s], [s, -c]], dtype=np.complex128)


def dipole(angle_rad: float = 0.0) -> Matrix:
    """Thin dipole at ``angle_rad`` from horizontal."""
    d = np.array([np.cos(angle_rad), np.sin(angle_rad)])
    return np.outer(d, d).astype(np.complex128)


def helix(sense: Literal["left", "right"]) -> Matrix:
    """Helix: returns one circular polarization, whatever is sent; ``1/2 [[1, +-j], [+-j, -1]]`` (left: +)."""
    j = 1j if sense == "left" else -1j
    return np.array([[1, j], [j, -1]], dtype=np.complex128) / 2


def turned(matrix: Matrix, angle_rad: float) -> Matrix:
    """The target (..., 2, 2) turned by ``angle_rad`` about the line of sight: ``R S R^T``."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    rotation = np.array([[c, -s], [s, c]])
    return np.asarray(rotation @ matrix @ rotation.T)
