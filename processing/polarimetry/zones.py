"""The zones of the plane of entropy and alpha. Source: Cloude and Pottier 1997, IEEE TGRS 35(1) 68, Fig. 5."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

NAMES = (
    "undefined",
    "branches, crowns",
    "volume",
    "surface of high entropy",
    "double bounce, branches",
    "vegetation",
    "rough surface",
    "double bounce",
    "dipole",
    "surface",
)
"""What scatters in zone 1 to 9; zone 3 is out of reach of real eigenvalues, 0 stands for undefined pixels."""
ENTROPIES = (0.5, 0.9)
"""Entropy between low, medium and high."""
ALPHAS_DEG = ((42.5, 47.5), (40.0, 50.0), (40.0, 55.0))
"""Alpha between surface, dipole-like and multiple scattering, at low, medium and high entropy, degrees."""


def h_alpha_zones(entropy: ArrayLike, alpha_rad: ArrayLike) -> NDArray[np.uint8]:
    """Zone 1 to 9 of :data:`NAMES` of each pixel, 0 where entropy or alpha is undefined.

    A pixel on a border counts to the zone of larger alpha or entropy.

    Raises:
        DataError: different shapes.
    """
    h, alpha = np.asarray(entropy, dtype=np.float64), np.degrees(np.asarray(alpha_rad, dtype=np.float64))
    if h.shape != alpha.shape:
        raise DataError(f"entropy {h.shape} and alpha {alpha.shape} do not fit", "give both of the same pixels")
    level = np.digitize(h, ENTROPIES)
    borders = np.array(ALPHAS_DEG)[level]
    kind = (alpha >= borders[..., 0]).astype(int) + (alpha >= borders[..., 1])
    zone = np.array([[9, 8, 7], [6, 5, 4], [3, 2, 1]])[level, kind]
    return np.where(np.isfinite(h) & np.isfinite(alpha), zone, 0).astype(np.uint8)
