"""Overlap of two classes that need not be normal: the bounds of Bayes' error from densities that are learnt.

The closed form (thesis 7.2, 7.3) takes classes for normal ones. Where they are not, its distance is that of two other
classes, and errors need not lie within its bounds (7.26). Here each class is a mixture of normal parts, and the
coefficient ``c = integral of sqrt(p1 p2)``, ``B = -ln c``, is a mean over samples that
the mixtures were not learnt from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import logsumexp

from processing.errors import DataError
from processing.fusion.kmeans import UNCLASSIFIED
from processing.fusion.separability import BayesBounds, Statistics, bayes_bounds
from processing.fusion.supervised import gaussian_mixture

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

LEARNT_FROM = 6000
"""Samples of a class that a mixture is learnt from, drawn by chance; more add nothing to so few parts."""


@dataclass(frozen=True, eq=False)
class Density:
    """A class as a mixture of normal parts."""

    parts: tuple[Statistics, ...]
    weights: Floats
    """(parts,) share of each."""

    def logarithm(self, samples: ArrayLike) -> Floats:
        """Natural logarithm of the density (n,) at samples (n, d); NaN where a sample has one."""
        x = np.atleast_2d(np.asarray(samples, dtype=np.float64))
        terms = np.empty((len(self.parts), len(x)))
        for row, part, weight in zip(terms, self.parts, self.weights, strict=True):
            factor = np.linalg.cholesky(part.covariance)
            white = np.linalg.solve(factor, (x - part.mean).T)
            scale = np.log(np.diag(factor)).sum() + 0.5 * len(part.mean) * np.log(2 * np.pi)
            row[:] = np.log(weight) - 0.5 * np.sum(white**2, axis=0) - scale
        total: Floats = logsumexp(terms, axis=0)
        return total


def learn_density(samples: ArrayLike, *, most: int = 6, seed: int = 0) -> Density:
    """Learn a class's density; the number of parts is the one with the least Bayesian information criterion.

    Args:
        samples: (n, d); those with a NaN are left out.
        most: largest number of parts.
        seed: of the start, and of the samples that are taken from many.

    Raises:
        DataError: too few defined samples.
    """
    every = np.asarray(samples, dtype=np.float64)
    x = every[np.isfinite(every).all(axis=1)] if every.ndim == 2 else every
    if len(x) > LEARNT_FROM:
        x = x[np.random.default_rng(seed).choice(len(x), LEARNT_FROM, replace=False)]
    found = gaussian_mixture(x, most=most, seed=seed)
    return Density(found.classes, found.weights)


@dataclass(frozen=True)
class Overlap:
    """How far two classes, equally likely, lie in one another."""

    distance: float
    """Bhattacharyya's."""
    bounds: BayesBounds
    """Of the least possible error, from the distance."""
    least_error: float
    """The least possible error itself, as the densities have it."""


def overlap(densities: Sequence[Density], samples: Sequence[ArrayLike]) -> Overlap:
    """Overlap of two classes.

    With ``m = (p1 + p2) / 2`` the coefficient is the mean of ``sqrt(p1 p2) / m`` over draws from m, and the least error
    that of ``min(p1, p2) / 2m``: both lie between 0 and 1, so that no sample outweighs the others.

    Args:
        densities: of both classes.
        samples: (n_k, d) of each class, others than those which the densities were learnt from.

    Raises:
        DataError: not two classes, or one without a defined sample.
    """
    if len(densities) != 2 or len(samples) != 2:
        raise DataError(f"an overlap of {len(densities)} classes", "give two")
    shared, smaller = [], []
    for number, item in enumerate(samples):
        x = np.asarray(item, dtype=np.float64)
        x = x[np.isfinite(x).all(axis=1)]
        if not len(x):
            raise DataError(f"class {number + 1} has no defined sample", "draw a larger region")
        first, second = (density.logarithm(x) for density in densities)
        # 1 / cosh and the logistic function of half and whole log ratio; large ratios end at 0.
        apart = np.abs(first - second)
        shared.append(float(np.mean(2 * np.exp(-apart / 2) / (1 + np.exp(-apart)))))
        smaller.append(float(np.mean(np.exp(-apart) / (1 + np.exp(-apart)))))
    # An overlap below the smallest number is told as that, not as an infinite distance.
    coefficient = max(sum(shared) / 2, np.finfo(float).tiny)
    distance = max(-float(np.log(coefficient)), 0.0)
    return Overlap(distance, bayes_bounds(distance), sum(smaller) / 2)


def likelier(densities: Sequence[Density], samples: ArrayLike) -> Labels:
    """The class (n,) whose density is largest at samples (n, d); ``UNCLASSIFIED`` where a sample has a NaN."""
    x = np.asarray(samples, dtype=np.float64)
    labels = np.full(len(x), UNCLASSIFIED, dtype=np.int64)
    defined = np.isfinite(x).all(axis=1)
    if defined.any():
        labels[defined] = np.argmax([density.logarithm(x[defined]) for density in densities], axis=0)
    return labels
