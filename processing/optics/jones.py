"""Jones calculus of fully polarized light: fields, elements, and the way to Mueller matrices (thesis 2.19 to 2.32).

Fields are ``E = (Ex, Ey)`` of ``Re{E exp(i (k z - w t))}`` with x horizontal and (x, y, propagation) right-handed:
angles count from x, counter-clockwise as the receiver sees them. Every function broadcasts over leading axes.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError, undefined_is_nan

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

STATES: dict[str, tuple[complex, complex]] = {
    "H": (1.0, 0.0),
    "V": (0.0, 1.0),
    "+45": (math.sqrt(0.5), math.sqrt(0.5)),
    "-45": (math.sqrt(0.5), -math.sqrt(0.5)),
    "RHC": (math.sqrt(0.5), 1j * math.sqrt(0.5)),
    "LHC": (math.sqrt(0.5), -1j * math.sqrt(0.5)),
}
"""Jones vectors of unit intensity (thesis Table 2.3)."""

STOKES_OF_PRODUCTS: Complexes = np.array(
    [[1, 0, 0, 1], [1, 0, 0, -1], [0, 1, 1, 0], [0, 1j, -1j, 0]], dtype=np.complex128
)
"""A of thesis 2.24 and 2.25: Stokes parameters of ``(ExEx*, ExEy*, EyEx*, EyEy*)``; its inverse is ``A^H / 2``."""

_PRODUCTS_OF_STOKES: Complexes = STOKES_OF_PRODUCTS.conj().T / 2


def polarizer(angle_rad: float, q: float = 1.0, r: float = 0.0) -> Complexes:
    """Jones matrix (2, 2) of a linear polarizer (thesis Table 2.4 for q = 1, r = 0).

    Args:
        angle_rad: transmission axis from horizontal, radians.
        q: transmittance (of intensity) along the axis.
        r: transmittance across it.

    Raises:
        DataError: a transmittance outside 0 to 1, or an angle that is not finite.
    """
    check_transmittances(q, r)
    return _turned(np.diag([math.sqrt(q), math.sqrt(r)]).astype(np.complex128), angle_rad)


def retarder(angle_rad: float, retardance_rad: float) -> Complexes:
    """Jones matrix (2, 2) of a linear retarder, without loss and without the phase that both axes share.

    The component along the fast axis is multiplied by ``exp(+i d / 2)``, the other by ``exp(-i d / 2)``: a quarter-wave
    plate with its fast axis at 0 turns +45 degrees into S3 = -1, as pypolar's and polanalyser's do. Beside Fresnel
    amplitudes of ``n + i k`` the fast axis of a plate is the one that carries the smaller phase: give such a chain
    ``-retardance_rad``.

    Args:
        angle_rad: fast axis from horizontal, radians.
        retardance_rad: phase between the axes, radians; pi / 2 for a quarter-wave plate.
    """
    half = np.exp(0.5j * retardance_rad)
    return _turned(np.array([[half, 0], [0, np.conj(half)]]), angle_rad)


def rotator(angle_rad: float) -> Complexes:
    """Jones matrix (2, 2) that describes a field in axes turned by ``angle_rad`` (counter-clockwise)."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[c, s], [-s, c]], dtype=np.complex128)


@undefined_is_nan
def stokes(field: ArrayLike) -> Floats:
    """Stokes vectors (..., 4) of Jones vectors (..., 2) (thesis 2.7 to 2.10, 2.23, 2.24)."""
    e = _last(field, (2,), "Jones vectors")
    products = (e[..., :, None] * e[..., None, :].conj()).reshape(*e.shape[:-1], 4)
    return np.asarray((products @ STOKES_OF_PRODUCTS.T).real)


@undefined_is_nan
def mueller(matrix: ArrayLike) -> Floats:
    """Mueller matrices (..., 4, 4) of Jones matrices (..., 2, 2): ``A (J x J*) A^-1`` (thesis 2.32)."""
    j = _last(matrix, (2, 2), "Jones matrices")
    products = np.einsum("...ij,...kl->...ikjl", j, j.conj()).reshape(*j.shape[:-2], 4, 4)
    return np.asarray((STOKES_OF_PRODUCTS @ products @ _PRODUCTS_OF_STOKES).real)


@undefined_is_nan
def covariance_of_mueller(matrix: ArrayLike) -> Complexes:
    """Hermitian matrices (..., 4, 4) ``<vec(J) vec(J)^H>`` whose Mueller matrices are given; the trace is 2 M00.

    ``vec(J) = (Jxx, Jxy, Jyx, Jyy)``. It is Cloude's coherency matrix but for a unitary change of basis, so it has the
    same eigenvalues (Cloude 1986, Optik 75, 26).
    """
    m = _last(matrix, (4, 4), "Mueller matrices")
    products = _PRODUCTS_OF_STOKES @ m @ STOKES_OF_PRODUCTS
    lead = products.shape[:-2]
    return np.asarray(np.swapaxes(products.reshape(*lead, 2, 2, 2, 2), -3, -2).reshape(*lead, 4, 4))


def mueller_of_covariance(covariance: ArrayLike) -> Floats:
    """The inverse of :func:`covariance_of_mueller`."""
    h = _last(covariance, (4, 4), "covariances")
    lead = h.shape[:-2]
    products = np.swapaxes(h.reshape(*lead, 2, 2, 2, 2), -3, -2).reshape(*lead, 4, 4)
    return np.asarray((STOKES_OF_PRODUCTS @ products @ _PRODUCTS_OF_STOKES).real)


def of_mueller(matrix: ArrayLike) -> Complexes:
    """Jones matrices (..., 2, 2) nearest to Mueller matrices: exact (but for a phase) where these do not depolarize.

    The phase is chosen so that the largest element is real and positive.
    """
    covariance = covariance_of_mueller(matrix)
    if not np.isfinite(covariance).all():
        raise DataError("a Mueller matrix holds elements that are not finite", "leave undefined pixels out")
    values, vectors = np.linalg.eigh(covariance)
    nearest = vectors[..., -1] * np.sqrt(np.maximum(values[..., -1:], 0.0))
    largest = np.take_along_axis(nearest, np.abs(nearest).argmax(axis=-1)[..., None], axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        phase = np.where(largest != 0, largest.conj() / np.abs(largest), 1.0)
    return np.asarray((nearest * phase).reshape(*nearest.shape[:-1], 2, 2))


def check_transmittances(q: float, r: float) -> None:
    """Raise :class:`DataError` unless both transmittances are from 0 to 1."""
    if not (0 <= q <= 1 and 0 <= r <= 1):
        raise DataError(f"transmittances of a polarizer are {q} and {r}", "give both from 0 to 1")


def _turned(element: Complexes, angle_rad: float) -> Complexes:
    """An element whose own axes stand at ``angle_rad``."""
    if not math.isfinite(angle_rad):
        raise DataError(f"an element's axis stands at {angle_rad} rad", "give a finite angle")
    return np.asarray(rotator(-angle_rad) @ element @ rotator(angle_rad))


def _last(values: ArrayLike, shape: tuple[int, ...], what: str) -> Complexes:
    array = np.asarray(values, dtype=np.complex128)
    if array.shape[array.ndim - len(shape) :] != shape:
        raise DataError(f"{what} have shape {array.shape}", f"give {shape} along the last axes")
    return array
