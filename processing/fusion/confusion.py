"""How often a classifier is right: confusion matrix, accuracies and kappa (Congalton 1991)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Confusion:
    """Counts of what was taken for what."""

    counts: NDArray[np.int64]
    """(classes, classes): row true class, column told class."""
    undecided: NDArray[np.int64]
    """(classes,) samples of each true class that were told no class."""

    @property
    def accuracy(self) -> float:
        """Share of decided samples that were told right; NaN without any."""
        total = int(self.counts.sum())
        return float(np.trace(self.counts)) / total if total else float("nan")

    @property
    def accuracy_sd(self) -> float:
        """Standard error of the accuracy, of a binomial with one success and one failure more (Agresti, Coull 1998)."""
        total = int(self.counts.sum()) + 4
        share = (float(np.trace(self.counts)) + 2) / total
        return float(np.sqrt(share * (1 - share) / total))

    @property
    def producers(self) -> Floats:
        """(classes,) share of each true class that was told right; NaN for classes without samples."""
        return _share(np.diag(self.counts), self.counts.sum(axis=1))

    @property
    def users(self) -> Floats:
        """(classes,) share of what was told to be a class that is; NaN for classes that were never told."""
        return _share(np.diag(self.counts), self.counts.sum(axis=0))

    @property
    def kappa(self) -> float:
        """Cohen's kappa: accuracy over chance; NaN where chance alone is always right."""
        total = float(self.counts.sum())
        if not total:
            return float("nan")
        chance = float(self.counts.sum(axis=1) @ self.counts.sum(axis=0)) / total**2
        return (self.accuracy - chance) / (1 - chance) if chance < 1 else float("nan")


def confusion(truth: ArrayLike, told: ArrayLike, classes: int) -> Confusion:
    """Count what was taken for what.

    Args:
        truth: class numbers, 0 to classes - 1; others are left out.
        told: class numbers of the same samples; others count as undecided.
        classes: number of classes.

    Raises:
        DataError: different numbers of samples.
    """
    true, said = np.asarray(truth).ravel(), np.asarray(told).ravel()
    if true.shape != said.shape or classes < 1:
        raise DataError(f"{true.size} true and {said.size} told classes", "give one of each for every sample")
    known = (true >= 0) & (true < classes)
    decided = known & (said >= 0) & (said < classes)
    pairs = true[decided].astype(np.int64) * classes + said[decided].astype(np.int64)
    counts = np.bincount(pairs, minlength=classes * classes).reshape(classes, classes)
    undecided = np.bincount(true[known & ~decided].astype(np.int64), minlength=classes)
    return Confusion(counts.astype(np.int64), undecided.astype(np.int64))


def _share(part: NDArray[np.int64], whole: NDArray[np.int64]) -> Floats:
    return np.asarray(np.divide(part, whole, out=np.full(len(whole), np.nan), where=whole > 0))
