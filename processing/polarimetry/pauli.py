"""Scattering vectors and their invariants: Pauli, lexicographic, span, and what they say in Stokes terms.

Two different things are called Pauli components in the thesis. Here they have different names: :func:`pauli_vector`
works on complex amplitudes (a dihedral shows in its second component whatever its phase), and
:func:`received_power_components` on received powers (thesis 6.11, 6.14, 6.17).
Every function broadcasts; NaN stays NaN.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import undefined_is_nan

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

SQRT2 = float(np.sqrt(2.0))


@undefined_is_nan
def pauli_vector(s_hh: ArrayLike, s_hv: ArrayLike, s_vv: ArrayLike) -> Complexes:
    """Pauli scattering vector of a reciprocal target from complex amplitudes.

    Args:
        s_hh, s_hv, s_vv: scattering amplitudes, any one shape, sqrt(m^2).

    Returns:
        (3, ...) ``(S_hh + S_vv, S_hh - S_vv, 2 S_hv) / sqrt 2``: odd bounce, even bounce, even bounce turned by 45
        degrees (and volume). Source: Cloude and Pottier 1996; display order in thesis 5.5.
    """
    hh, hv, vv = (np.asarray(s, dtype=np.complex128) for s in (s_hh, s_hv, s_vv))
    return np.stack([(hh + vv) / SQRT2, (hh - vv) / SQRT2, SQRT2 * hv])


def pauli_of_matrix(matrix: ArrayLike) -> Complexes:
    """Pauli vector (3, ...) of scattering matrices (..., 2, 2), with the mean of both cross-polarized elements."""
    s = np.asarray(matrix, dtype=np.complex128)
    return pauli_vector(s[..., 0, 0], (s[..., 0, 1] + s[..., 1, 0]) / 2, s[..., 1, 1])


def matrix_of_pauli(k: ArrayLike) -> Complexes:
    """Scattering matrices (..., 2, 2) of Pauli vectors (3, ...); the inverse of :func:`pauli_of_matrix`."""
    odd, even, cross = np.asarray(k, dtype=np.complex128) / SQRT2
    return np.stack([np.stack([odd + even, cross], axis=-1), np.stack([cross, odd - even], axis=-1)], axis=-2)


def lexicographic_vector(s_hh: ArrayLike, s_hv: ArrayLike, s_vv: ArrayLike) -> Complexes:
    """Lexicographic scattering vector (3, ...) ``(S_hh, sqrt 2 S_hv, S_vv)`` of a reciprocal target."""
    hh, hv, vv = (np.asarray(s, dtype=np.complex128) for s in (s_hh, s_hv, s_vv))
    return np.stack([hh, SQRT2 * hv, vv])


def span(vector: ArrayLike) -> Floats:
    """Total power (...) of Pauli or lexicographic vectors (3, ...): ``|S_hh|^2 + 2 |S_hv|^2 + |S_vv|^2``, m^2."""
    k = np.asarray(vector, dtype=np.complex128)
    return np.asarray(np.sum(k.real**2 + k.imag**2, axis=0))


def display_components(k: ArrayLike) -> Floats:
    """Amplitudes for display, (3, ...) in the order red, green, blue: ``|HH - VV|, |HV|, |HH + VV|`` (thesis 5.5).

    Args:
        k: (3, ...) Pauli vectors from complex amplitudes.
    """
    odd, even, cross = np.abs(np.asarray(k, dtype=np.complex128))
    return np.stack([even * SQRT2, cross / SQRT2, odd * SQRT2])


def received_power_components(p_hh: ArrayLike, p_hv: ArrayLike, p_vv: ArrayLike) -> Floats:
    """Power-difference components of the thesis (6.11, 6.14, 6.17): (3, ...) ``|HH - VV|, HV, HH + VV`` of powers.

    They are no Pauli components: an ideal dihedral (HH = -VV) has equal received powers and no difference.
    """
    hh, hv, vv = (np.asarray(p, dtype=np.float64) for p in (p_hh, p_hv, p_vv))
    return np.stack([np.abs(hh - vv), hv, hh + vv])


def received_power_dolp(p_hh: ArrayLike, p_hv: ArrayLike, p_vh: ArrayLike, p_vv: ArrayLike) -> Floats:
    """DOLP-like ratio of received powers, thesis 6.8: ``(HH + VH - HV - VV) / (HH + VH + HV + VV)``.

    Channel names are transmit-then-receive: HH and VH are received with H (6.6), HV and VV with V (6.7). The sign is
    kept; no power at all gives NaN.
    """
    hh, hv, vh, vv = (np.asarray(p, dtype=np.float64) for p in (p_hh, p_hv, p_vh, p_vv))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray((hh + vh - hv - vv) / (hh + vh + hv + vv))


def coherency_matrix(k: ArrayLike) -> Complexes:
    """Mean coherency matrix T = <k k^H>, (3, 3), of Pauli vectors (3, ...); pixels with a NaN are left out."""
    pixels = np.asarray(k, dtype=np.complex128).reshape(3, -1)
    pixels = pixels[:, np.isfinite(pixels).all(axis=0)]
    if not pixels.shape[1]:
        return np.full((3, 3), np.nan + 0j)
    return np.asarray(pixels @ pixels.conj().T / pixels.shape[1])


def equivalent_stokes(coherency: ArrayLike) -> Floats:
    """Stokes vector (S0, S1, S2) that a target would return of unpolarized illumination, from its T (..., 3, 3).

    ``S0 = Tr T / 2, S1 = Re T12, S2 = Re T13``: the first column of the Mueller matrix of S (thesis 2.32, 6.8).
    """
    t = np.asarray(coherency, dtype=np.complex128)
    s0 = np.trace(t, axis1=-2, axis2=-1).real / 2
    return np.stack([s0, t[..., 0, 1].real, t[..., 0, 2].real], axis=-1)


def equivalent_dolp(coherency: ArrayLike) -> Floats:
    """DOLP (...) that a target would show under unpolarized illumination, from its T (..., 3, 3).

    An ideal dihedral has 0, as a trihedral has, although its |HH - VV| is largest; a dipole has 1.
    """
    stokes = equivalent_stokes(coherency)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.hypot(stokes[..., 1], stokes[..., 2]) / stokes[..., 0])
