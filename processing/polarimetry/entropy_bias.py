"""What a window of few looks does to entropy and anisotropy, and the correction.

Eigenvalues of an average of n looks spread: on average the largest is too large and the smallest too small, so that
entropy comes out too low and anisotropy too high. To first order (Lawley 1956; for complex Wishart matrices
Lopez-Martinez, Pottier and Cloude 2005, IEEE TGRS 43(9) 2058)

    E[l_i] = lambda_i + 1/n sum_j lambda_i lambda_j / (lambda_i - lambda_j).

The series fails where two eigenvalues are nearer than their own spread, lambda / sqrt(n); there the correction goes to
zero and not to infinity. Entropy has a second bias, from its curvature, which follows from the eigenvalues' variances
lambda_i^2 / n. At 9 looks the two find 60 to 80 % of the whole bias, at 49 looks 66 to 100 %, least where all
eigenvalues are equal.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from processing.errors import DataError
from processing.polarimetry.pauli import Floats


def unbiased_eigenvalues(eigenvalues: ArrayLike, looks: float) -> Floats:
    """Eigenvalues (3, ...), the largest first, without their first-order bias; their sum is kept.

    Args:
        eigenvalues: of averages, (3, ...), not negative.
        looks: how many independent looks each average holds, at least 3.

    Raises:
        DataError: fewer than 3 looks: the average of fewer has no third eigenvalue.
    """
    if not looks >= 3:
        raise DataError(f"the bias of {looks:g} looks has no correction", "average over 3 looks or more")
    values = np.maximum(np.asarray(eigenvalues, dtype=np.float64), 0.0)
    moved = np.zeros_like(values)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        gap, product = values[i] - values[j], values[i] * values[j]
        with np.errstate(divide="ignore", invalid="ignore"):
            shift = np.where(product > 0, product * gap / (looks * gap**2 + product), 0.0)
        moved[i] -= shift
        moved[j] += shift
    return np.where(np.isfinite(values), np.sort(np.maximum(values + moved, 0.0), axis=0)[::-1], np.nan)


def entropy_of(eigenvalues: ArrayLike) -> Floats:
    """Entropy (...) of eigenvalues (3, ...); NaN without power."""
    values = np.maximum(np.asarray(eigenvalues, dtype=np.float64), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        p = values / values.sum(axis=0)
        return np.asarray(-np.where(p > 0, p * np.log(p), 0.0 * p).sum(axis=0) / np.log(3))


def entropy_bias(eigenvalues: ArrayLike, looks: float) -> Floats:
    """How much too low entropy is expected to be (...), of eigenvalues (3, ...) of averages: a positive number.

    Raises:
        DataError: fewer than 3 looks.
    """
    values = np.maximum(np.asarray(eigenvalues, dtype=np.float64), 0.0)
    better = unbiased_eigenvalues(values, looks)
    with np.errstate(divide="ignore", invalid="ignore"):
        p = better / better.sum(axis=0)
        # Half of the trace of the Hessian of -sum p ln p times the covariance of p = l / sum l.
        share = (p**2).sum(axis=0)
        curvature = (p * (1 - 2 * p + share)).sum(axis=0) / 2
        # And of p itself, because the sum that divides scatters with the eigenvalues.
        drift = np.where(p > 0, p * (share - p) * np.log(p), 0.0 * p).sum(axis=0)
    found = entropy_of(better) + (curvature + drift) / (looks * np.log(3))
    return np.asarray(np.maximum(np.minimum(found, 1.0) - entropy_of(values), 0.0))
