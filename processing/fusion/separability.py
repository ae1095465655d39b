"""How well classes can be told apart: Bhattacharyya distance, the Bayes error that it bounds, and anomalies (RX)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]

SINGULAR = 1e-10
"""Smallest over largest eigenvalue below which a covariance counts as singular in float64."""


@dataclass(frozen=True)
class Statistics:
    """A class as a normal distribution."""

    name: str
    mean: Floats
    """(d,)."""
    covariance: Floats
    """(d, d)."""
    samples: int
    regularized: str = ""
    """Why the covariance was regularized, or empty."""


def class_statistics(
    samples: ArrayLike, name: str = "class", *, singular: Literal["refuse", "regularize"] = "refuse"
) -> Statistics:
    """Mean and covariance of samples (n, d); samples with a NaN are left out.

    Args:
        samples: (n, d).
        name: for messages.
        singular: what to do with a singular covariance (constant or dependent features, too few samples): refuse it,
            or add the smallest multiple of the identity that makes it regular and say so.

    Raises:
        DataError: fewer than two samples, or a singular covariance that is to be refused.
    """
    every = np.asarray(samples, dtype=np.float64)
    x = every[np.isfinite(every).all(axis=1)]
    count, dimensions = x.shape
    if count < 2:
        raise DataError(f"'{name}' has {count} defined samples", "draw a larger region or ask for fewer classes")
    covariance = np.atleast_2d(np.cov(x, rowvar=False))
    eigenvalues = np.linalg.eigvalsh(covariance)
    if count > dimensions and eigenvalues[-1] > 0 and eigenvalues[0] > SINGULAR * eigenvalues[-1]:
        return Statistics(name, x.mean(axis=0), covariance, count)
    reason = (
        f"{count} samples for {dimensions} features"
        if count <= dimensions
        else "a feature is constant or depends on the others"
    )
    if singular == "refuse":
        raise DataError(
            f"the covariance of '{name}' is singular ({reason})", "use a larger region or leave features out"
        )
    # Relative to the largest spread; where there is none at all, to the resolution of single precision input.
    scale = eigenvalues[-1] if eigenvalues[-1] > 0 else max(float(np.abs(x).max()) * 1.2e-7, 1e-30) ** 2 / SINGULAR
    ridge = 10 * SINGULAR * scale - min(eigenvalues[0], 0.0)
    return Statistics(name, x.mean(axis=0), covariance + ridge * np.eye(dimensions), count, reason)


def bhattacharyya(a: Statistics, b: Statistics) -> float:
    """Bhattacharyya distance of two normal classes (thesis 7.2, 7.3).

    ``1/8 d^T C^-1 d + 1/2 ln(|C| / sqrt(|C1| |C2|))`` with ``C = (C1 + C2) / 2`` and ``d`` the means' difference.

    Raises:
        DataError: classes of different dimension, or a covariance that is not positive definite.
    """
    if a.mean.shape != b.mean.shape:
        raise DataError(f"'{a.name}' and '{b.name}' have different numbers of features", "use the same features")
    pooled = (a.covariance + b.covariance) / 2
    logarithms = []
    for covariance, name in ((pooled, f"{a.name} and {b.name}"), (a.covariance, a.name), (b.covariance, b.name)):
        sign, logarithm = np.linalg.slogdet(covariance)
        if sign <= 0 or not np.isfinite(logarithm):
            raise DataError(f"the covariance of '{name}' is not positive definite", "use a larger region")
        logarithms.append(float(logarithm))
    difference = a.mean - b.mean
    by_means = float(difference @ np.linalg.solve(pooled, difference)) / 8
    by_spreads = (logarithms[0] - (logarithms[1] + logarithms[2]) / 2) / 2
    # Rounding may leave a tiny negative number for equal classes.
    return max(by_means + by_spreads, 0.0)


class BayesBounds(NamedTuple):
    """Bounds of the least possible probability of misclassification."""

    lower: float
    upper: float


def bayes_bounds(distance: float, prior: float = 0.5) -> BayesBounds:
    """Bounds of the Bayes error from a Bhattacharyya distance (Fukunaga; thesis Fig. 7.26).

    ``(1 - sqrt(1 - 4 P1 P2 exp(-2B))) / 2 <= Pe <= sqrt(P1 P2) exp(-B)``, rearranged so that nothing cancels at
    large B.

    Args:
        distance: B >= 0.
        prior: P1, in (0, 1).

    Raises:
        DataError: arguments outside these ranges.
    """
    if not distance >= 0 or not 0 < prior < 1:
        raise DataError(f"distance {distance} and prior {prior}", "give a distance >= 0 and a prior between 0 and 1")
    product = 4 * prior * (1 - prior)
    overlap = product * np.exp(-2 * distance)
    rest = (2 * prior - 1) ** 2 - product * np.expm1(-2 * distance)
    lower = 0.5 * overlap / (1 + np.sqrt(rest))
    return BayesBounds(float(lower), float(0.5 * np.sqrt(product) * np.exp(-distance)))


def jeffries_matusita(distance: float) -> float:
    """Jeffries-Matusita distance ``sqrt(2 (1 - exp(-B)))``, from 0 to sqrt 2."""
    return float(np.sqrt(-2 * np.expm1(-distance)))


def reed_xiaoli(features: ArrayLike, background: Statistics | None = None) -> Floats:
    """RX anomaly score ``(x - mu)^T C^-1 (x - mu)`` of every pixel.

    Args:
        features: (d, ...) feature planes; NaN pixels get NaN.
        background: the background's statistics; those of all defined pixels if left out. For normal data the scores
            then follow a chi-square distribution with d degrees of freedom.

    Returns:
        (...) scores.

    Raises:
        DataError: a singular covariance.
    """
    planes = np.asarray(features, dtype=np.float64)
    samples = planes.reshape(len(planes), -1).T
    known = class_statistics(samples, "background") if background is None else background
    if known.mean.shape != (len(planes),):
        raise DataError(f"{len(planes)} features, background has {len(known.mean)}", "use the same features")
    try:
        factor = np.linalg.cholesky(known.covariance)
    except np.linalg.LinAlgError:
        raise DataError("the background's covariance is not positive definite", "use a larger background") from None
    whitened = np.linalg.solve(factor, (samples - known.mean).T)
    return np.asarray(np.sum(whitened**2, axis=0).reshape(planes.shape[1:]))
