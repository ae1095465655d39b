"""How well classes can be told apart: Bhattacharyya distance and the Bayes error that it bounds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import digamma

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


def bhattacharyya_unbiased(a: Statistics, b: Statistics) -> float:
    """Bhattacharyya distance with the bias of few samples taken off; may be below zero for classes that are alike.

    Of n samples of a normal class the expected logarithm of the covariance's determinant is too small by
    ``sum_i psi((n - i) / 2) + d ln(2 / (n - 1)), i = 1 ... d`` (Wishart; Mardia, Kent and Bibby 1979, 3.4), and the
    expected squared distance of means is ``nu / (nu - d - 1) (D^2 + d (1/n1 + 1/n2) ...)`` (Fukunaga 1990, 5.1). The
    mean of two covariances is taken for a Wishart matrix with Satterthwaite's degrees of freedom.

    Raises:
        DataError: as :func:`bhattacharyya`, or too few samples: each class needs three more than features.
    """
    dimensions = len(a.mean)
    if min(a.samples, b.samples) < dimensions + 3:
        raise DataError(
            f"{min(a.samples, b.samples)} samples of {dimensions} features do not tell the bias",
            f"draw regions of {dimensions + 3} pixels or more",
        )
    told = bhattacharyya(a, b)
    pooled = (a.covariance + b.covariance) / 2
    freedom = _pooled_freedom(a, b, pooled)
    difference = a.mean - b.mean
    squared = float(difference @ np.linalg.solve(pooled, difference))
    inverse = np.linalg.inv(pooled)
    # What the means' own scatter adds to the squared distance.
    scatter = float(np.trace(inverse @ (a.covariance / a.samples + b.covariance / b.samples)))
    by_means = squared * (freedom - dimensions - 1) / freedom - scatter
    logarithms = (
        _log_bias(freedom, dimensions)
        - (_log_bias(a.samples - 1, dimensions) + _log_bias(b.samples - 1, dimensions)) / 2
    )
    return told + (by_means - squared) / 8 - logarithms / 2


def _pooled_freedom(a: Statistics, b: Statistics, pooled: Floats) -> float:
    """Satterthwaite's degrees of freedom of the mean of two covariances (Nel and van der Merwe 1986)."""

    def spread(matrix: Floats) -> float:
        return float(np.trace(matrix @ matrix) + np.trace(matrix) ** 2)

    white = np.linalg.inv(np.linalg.cholesky(pooled))
    parts = [white @ known.covariance @ white.T / 2 for known in (a, b)]
    whole = spread(parts[0] + parts[1])
    return whole / sum(spread(part) / (known.samples - 1) for part, known in zip(parts, (a, b), strict=True))


def _log_bias(freedom: float, dimensions: int) -> float:
    """Expected ``ln |S| - ln |C|`` of a covariance estimated with so many degrees of freedom."""
    terms = digamma((freedom - np.arange(dimensions)) / 2)
    return float(np.sum(terms) + dimensions * np.log(2 / freedom))


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
