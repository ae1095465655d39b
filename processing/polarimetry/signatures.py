"""Polarimetric signatures: what a target returns against the ellipticity and orientation of the polarization (thesis
Fig. 2.16), and its Mueller and Kennaugh matrices.

Sources: van Zyl, Zebker and Elachi 1987, Radio Science 22(4) 529; thesis 2.32.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.polarimetry.matrices import basis_vectors
from processing.polarimetry.pauli import SQRT2, Complexes, Floats

_PAULI = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]]], dtype=np.complex128) / SQRT2
"""Matrices whose sum weighted by the Pauli vector is S."""
_STOKES = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]], dtype=np.complex128)
"""Matrices whose expectation E^H M E in a Jones vector is each Stokes parameter (S3 = -2 Im Ex Ey*, thesis 2.25)."""
_MUELLER = np.einsum("ixy,ayz,jzw,bxw->ijab", _STOKES, _PAULI, _STOKES, _PAULI.conj()) / 2
"""M_ij is this times T_ab: half the trace of sigma_i S sigma_j S^H, which is thesis 2.32."""


class Signature(NamedTuple):
    """Returned power against the transmitted polarization."""

    orientation_rad: Floats
    """(columns,), -90 to 90 degrees."""
    ellipticity_rad: Floats
    """(rows,), -45 to 45 degrees; positive is right-handed."""
    co: Floats
    """(rows, columns) RCS, m^2, received with the transmitted polarization."""
    cross: Floats
    """The same, received with the orthogonal polarization."""


def signature(coherency: ArrayLike, *, orientations: int = 91, ellipticities: int = 46) -> Signature:
    """Co- and cross-polarized signature of a target's coherency matrix (3, 3), or of its mean over a region.

    A co-polarized power is |J^T S J|^2 of the Jones vector J, a cross-polarized one |J'^T S J|^2 with J' orthogonal.

    Raises:
        DataError: another shape, or undefined elements.
    """
    t = np.asarray(coherency, dtype=np.complex128)
    if t.shape != (3, 3) or not np.isfinite(t).all():
        raise DataError("a signature needs one coherency matrix (3, 3) without NaN", "average T over defined pixels")
    psi = np.linspace(-np.pi / 2, np.pi / 2, orientations)
    chi = np.linspace(-np.pi / 4, np.pi / 4, ellipticities)
    bases = np.array([[basis_vectors(p, c) for p in psi] for c in chi])
    sent, other = bases[..., :, 0], bases[..., :, 1]
    powers = []
    for received in (sent, other):
        weights = np.einsum("...x,axy,...y->...a", received, _PAULI, sent)
        powers.append(np.maximum(np.einsum("...a,ab,...b->...", weights, t, weights.conj()).real, 0.0))
    return Signature(psi, chi, powers[0], powers[1])


def mueller_of_coherency(coherency: ArrayLike) -> Floats:
    """Mueller matrices (..., 4, 4) of T (..., 3, 3): the mean of thesis 2.32, in forward alignment of the axes."""
    t = np.asarray(coherency, dtype=np.complex128)
    return np.asarray(np.einsum("ijab,...ab->...ij", _MUELLER, t).real)


def kennaugh_of_coherency(coherency: ArrayLike) -> Floats:
    """Kennaugh matrices (..., 4, 4), symmetric: received power is ``s_r^T K s_t / 2`` of two Stokes vectors.

    The Mueller matrix with its last row turned around, because the antenna's own polarization is described looking
    along the wave that it sends (backscatter alignment).
    """
    return np.asarray(mueller_of_coherency(coherency) * np.array([1.0, 1.0, 1.0, -1.0])[:, None])


def coherency_of_kennaugh(kennaugh: ArrayLike) -> Complexes:
    """T (..., 3, 3) of Kennaugh matrices (..., 4, 4); the inverse of :func:`kennaugh_of_coherency`.

    Raises:
        DataError: another shape.
    """
    k: NDArray[np.float64] = np.asarray(kennaugh, dtype=np.float64)
    if k.shape[-2:] != (4, 4):
        raise DataError(f"Kennaugh matrices must be (..., 4, 4), not {k.shape}", "give all four Stokes components")
    m = k * np.array([1.0, 1.0, 1.0, -1.0])[:, None]
    # The sixteen matrices of the map are orthogonal with squares of 1 in each of the nine directions of T.
    return np.asarray(np.einsum("ijab,...ij->...ab", _MUELLER.conj(), m))
