"""Polarizers as analysers: Mueller matrices, and what a series of polarizer angles measures of the Stokes vector.

Only linear polarization is measured: a rotating linear polarizer does not see S3.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError, undefined_is_nan

Floats = NDArray[np.float64]

CONDITION_LIMIT = 50.0
"""Largest accepted condition number: at it, noise in the worst combination of S0, S1 and S2 is amplified fiftyfold."""


def transmittances(extinction_ratio: float) -> tuple[float, float]:
    """Maximum and minimum transmittance (q, r) of a polarizer that passes its own axis wholly, r = q / extinction.

    ``extinction_ratio`` may be infinite (the ideal polarizer).

    Raises:
        DataError: a ratio of 1 or less, which does not polarize.
    """
    if not extinction_ratio > 1:
        raise DataError(
            f"a polarizer with extinction ratio {extinction_ratio} does not polarize",
            "give the maximum over the minimum transmittance, above 1",
        )
    return 1.0, 1.0 / extinction_ratio


def polarizer(angle_rad: float, q: float = 1.0, r: float = 0.0) -> Floats:
    """Mueller matrix of a linear polarizer, (4, 4).

    Ideal (q = 1, r = 0): thesis 2.18. Imperfect: Goldstein, "Polarized Light", maximum and minimum transmittances
    ``q`` and ``r``.

    Args:
        angle_rad: transmission axis from horizontal, counter-clockwise looking into the beam, radians.
        q: transmittance along the axis.
        r: transmittance across the axis.
    """
    c, s = math.cos(2 * angle_rad), math.sin(2 * angle_rad)
    both, difference, mixed = q + r, q - r, 2 * math.sqrt(q * r)
    return 0.5 * np.array(
        [
            [both, difference * c, difference * s, 0.0],
            [difference * c, both * c * c + mixed * s * s, (both - mixed) * s * c, 0.0],
            [difference * s, (both - mixed) * s * c, both * s * s + mixed * c * c, 0.0],
            [0.0, 0.0, 0.0, mixed],
        ]
    )


def measurement_matrix(angles_rad: ArrayLike, extinction_ratio: float = math.inf) -> Floats:
    """Rows that give the intensity behind a polarizer from (S0, S1, S2): the first rows of its Mueller matrices.

    Args:
        angles_rad: (K,) transmission axes from horizontal, radians.
        extinction_ratio: maximum over minimum transmittance.

    Returns:
        (K, 3): ``[(q + r), (q - r) cos 2t, (q - r) sin 2t] / 2``.

    Raises:
        DataError: an extinction ratio of 1 or less, or an angle that is not finite.
    """
    q, r = transmittances(extinction_ratio)
    double = 2 * np.atleast_1d(np.asarray(angles_rad, dtype=np.float64))
    if not np.all(np.isfinite(double)):
        raise DataError("a polarizer angle is not a finite number", "look at the polarizer's readings in the session")
    return 0.5 * np.stack(
        [np.full(double.shape, q + r), (q - r) * np.cos(double), (q - r) * np.sin(double)],
        axis=-1,
    )


def condition_number(matrix: Floats) -> float:
    """Largest over smallest singular value of a (K, 3) measurement matrix; infinite where singular or not finite."""
    if matrix.shape[0] < 3:
        return math.inf
    if not np.isfinite(matrix).all() or not matrix.size:
        return math.inf
    singular = np.linalg.svd(matrix, compute_uv=False)
    # Exact singularity leaves rounding errors of some eps in the smallest value.
    if singular[-1] <= singular[0] * 1e-12:
        return math.inf
    return float(singular[0] / singular[-1])


@undefined_is_nan
def least_squares(matrix: Floats, weights: ArrayLike | None = None, *, limit: float = CONDITION_LIMIT) -> Floats:
    """The (3, K) matrix that turns K intensities into the least-squares (S0, S1, S2).

    Args:
        matrix: (K, 3) measurement matrix.
        weights: (K,) weight of each intensity (frames averaged in it); equal when left out.
        limit: largest accepted condition number of ``matrix``.

    Raises:
        DataError: the angles do not determine S0, S1 and S2 (condition number above ``limit``), or a weight is not
            positive.
    """
    matrix = np.asarray(matrix, dtype=np.float64)
    condition = condition_number(matrix)
    if condition > limit:
        raise DataError(
            f"{matrix.shape[0]} polarizer angles have condition number {condition:.3g} (at most {limit:.3g})",
            "use three or more angles spread over 180 degrees, such as 0, 45, 90 and 135",
        )
    weight = np.ones(matrix.shape[0]) if weights is None else np.asarray(weights, dtype=np.float64)
    if weight.shape != (matrix.shape[0],) or not np.all(weight > 0) or not np.all(np.isfinite(weight)):
        raise DataError("weights of the polarizer angles are not all positive", "give each angle the frames it has")
    root = np.sqrt(weight)
    solution: Floats = np.asarray(np.linalg.pinv(root[:, None] * matrix) * root, dtype=np.float64)
    return solution
