"""DOLP against Pauli components (thesis 6.2): the relation as printed, the exact one, and where they part.

The thesis reasons that light from a source without polarization is received like the sum of H and V illumination, so
that DOLP is told by the received powers (6.8, 6.9): ``(|HH|^2 - |VV|^2) / (|HH|^2 + |VV|^2 + 2 |HV|^2)``, and then
that a high DOLP goes with a high Pauli component |HH - VV|. The first statement is S1 / S0 exactly; DOLP has S2 as
well, which bodies turned about the line of sight have. The second is another matter: |HH - VV| of complex amplitudes
depends on the phase between HH and VV, of which DOLP knows nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.polarimetry.pauli import equivalent_dolp, pauli_vector, received_power_dolp

Floats = NDArray[np.float64]


class Relation(NamedTuple):
    """Three measures of the same targets, each (...); NaN where nothing is returned."""

    exact: Floats
    """DOLP that the target shows under light (or waves) without polarization, 0 to 1."""
    printed: Floats
    """Thesis 6.9 from received powers, without its sign: |S1| / S0, at most the exact one."""
    even_share: Floats
    """|HH - VV|^2 over the Pauli vector's power: what red says in a Pauli picture, 0 to 1."""


def relation(s_hh: ArrayLike, s_hv: ArrayLike, s_vv: ArrayLike) -> Relation:
    """The three measures of targets from their scattering amplitudes (...), any unit."""
    hh, hv, vv = (np.asarray(s, dtype=np.complex128) for s in np.broadcast_arrays(s_hh, s_hv, s_vv))
    k = pauli_vector(hh, hv, vv)
    coherency = np.einsum("i...,j...->...ij", k, k.conj())
    powers = [np.abs(s) ** 2 for s in (hh, hv, vv)]
    span = np.sum(np.abs(k) ** 2, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.abs(k[1]) ** 2 / span
    printed = np.abs(received_power_dolp(powers[0], powers[1], powers[1], powers[2]))
    return Relation(equivalent_dolp(coherency), printed, np.asarray(share))


def agreement_phase(ratio: ArrayLike) -> Floats:
    """Phase between HH and VV (...), rad, at which the even share equals DOLP, without cross-polarization.

    With ``g = |VV| / |HH|`` (or its inverse) DOLP is ``(1 - g^2) / (1 + g^2)`` and the share is
    ``1/2 - g cos(phase) / (1 + g^2)``: equal at ``cos(phase) = (3 g^2 - 1) / 2 g``. Below g = 1/3 DOLP is more than any
    phase makes of the share: NaN.

    Raises:
        DataError: a ratio outside 0 to 1.
    """
    g = np.asarray(ratio, dtype=np.float64)
    if not np.all((g >= 0) & (g <= 1)):
        raise DataError("a ratio of amplitudes lies outside 0 to 1", "give the weaker over the stronger one")
    with np.errstate(divide="ignore", invalid="ignore"):
        cosine = (3 * g * g - 1) / (2 * g)
        # Rounding at the ends of the range, 1/3 and 1, is no reason for a NaN.
        rounded = np.where(np.abs(cosine) <= 1 + 1e-12, np.clip(cosine, -1, 1), np.nan)
    return np.asarray(np.arccos(rounded))
