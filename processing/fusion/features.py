"""The fused vector of the thesis (6.12, 8.1): three normalized Pauli components and DOLP."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.polarimetry.pauli import display_components

Floats = NDArray[np.float64]

FEATURES = ("even bounce", "cross-polarized", "odd bounce", "DOLP")
"""Names of the fused vector's components: |HH-VV|, |HV|, |HH+VV| (normalized), DOLP."""


def normalized_components(
    k: ArrayLike, *, normalization: Literal["pixel", "scene"] = "pixel", usable: ArrayLike | None = None
) -> Floats:
    """Pauli display components |HH-VV|, |HV|, |HH+VV|, normalized.

    Args:
        k: (3, ...) Pauli vectors from complex amplitudes.
        normalization: ``"pixel"`` divides by each pixel's own Euclidean norm (the mechanism, whatever the brightness;
            thesis 6.12); ``"scene"`` by the largest norm of the scene.
        usable: (...) pixels that hold a signal; others become NaN. A pixel of noise has a norm, but no mechanism.

    Returns:
        (3, ...) in [0, 1]; NaN where there is nothing to normalize.

    Raises:
        DataError: no pixel is usable.
    """
    components = display_components(k)
    norm = np.sqrt(np.sum(components**2, axis=0))
    good = np.isfinite(norm) & (norm > 0)
    if usable is not None:
        good &= np.asarray(usable, dtype=bool)
    if not good.any():
        raise DataError("no radar pixel stands above the noise", "check the calibration, or lower the threshold")
    scale = norm if normalization == "pixel" else np.full_like(norm, norm[good].max())
    return np.where(good, components / np.where(good, scale, 1.0), np.nan)


def fused_vector(components: ArrayLike, dolp: ArrayLike) -> Floats:
    """Stack normalized Pauli components (3, ...) and DOLP (...) to (4, ...); NaN in one is NaN in all.

    Raises:
        DataError: shapes that differ.
    """
    pauli, polarization = np.asarray(components, dtype=np.float64), np.asarray(dolp, dtype=np.float64)
    if pauli.shape != (3, *polarization.shape):
        raise DataError(
            f"Pauli components have shape {pauli.shape} and DOLP {polarization.shape}",
            "sample DOLP onto the radar's grid first",
        )
    fused = np.concatenate([pauli, polarization[None]])
    fused[:, ~np.isfinite(fused).all(axis=0)] = np.nan
    return fused
