"""K-means classes with the thesis's stop: iterate until fewer than 5 % of the samples change their class (7.3).

Deterministic: the same samples and seed give the same labels. Samples that hold a NaN belong to no class.
Source: Lloyd 1982; start by Arthur and Vassilvitskii 2007 (k-means++) or evenly spread (thesis 7.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

UNCLASSIFIED = -1
"""Label of samples that hold a NaN."""


@dataclass(frozen=True)
class Classes:
    """Outcome of K-means."""

    labels: Labels
    """(n,) class of each sample, 0 to classes - 1, or ``UNCLASSIFIED``."""
    centres: Floats
    """(classes, d) class means."""
    iterations: int
    changed: float
    """Fraction of samples that changed their class in the last iteration."""
    inertia: float
    """Sum of squared distances to the class means."""


def assign_reference(samples: Floats, centres: Floats) -> tuple[Labels, Floats]:
    """Nearest centre of each sample and its squared distance, in plain NumPy; ties go to the lower class."""
    squared = np.sum((samples[:, None, :] - centres[None, :, :]) ** 2, axis=2)
    labels = np.argmin(squared, axis=1)
    return labels.astype(np.int64), squared[np.arange(len(samples)), labels]


@njit(cache=True)
def assign(samples: Floats, centres: Floats) -> tuple[Labels, Floats]:
    """Nearest centre of each sample (n, d) and its squared distance; the compiled :func:`assign_reference`."""
    count, dimensions = samples.shape
    labels = np.zeros(count, dtype=np.int64)
    distances = np.empty(count)
    for i in range(count):
        best = np.inf
        for k in range(centres.shape[0]):
            squared = 0.0
            for d in range(dimensions):
                difference = samples[i, d] - centres[k, d]
                squared += difference * difference
            if squared < best:
                best = squared
                labels[i] = k
        distances[i] = best
    return labels, distances


def kmeans(
    samples: ArrayLike,
    classes: int,
    *,
    seed: int = 0,
    start: Literal["k-means++", "even"] | Floats = "k-means++",
    stop_change: float = 0.05,
    max_iterations: int = 100,
) -> Classes:
    """Cluster samples.

    Args:
        samples: (n, d).
        classes: number of classes.
        seed: of the k-means++ start.
        start: ``"k-means++"``, ``"even"`` (centres evenly spread from the smallest to the largest value of every
            dimension, as in the thesis) or the centres themselves, (classes, d).
        stop_change: stop when a smaller fraction of the samples changes its class; 0 iterates until none does.
        max_iterations: stop there at the latest.

    Raises:
        DataError: fewer distinct samples than classes, or a start of another shape.
    """
    every = np.asarray(samples, dtype=np.float64)
    if every.ndim != 2 or classes < 1:
        raise DataError(f"samples of shape {every.shape} cannot form {classes} classes", "give (n, d) and one or more")
    usable = np.isfinite(every).all(axis=1)
    x = np.ascontiguousarray(every[usable])
    if len(x) < classes or len(np.unique(x, axis=0)) < classes:
        raise DataError(
            f"there are too few distinct samples ({len(x)} defined) for {classes} classes",
            "ask for fewer classes, or check how much of the image is defined",
        )
    centres = _start(x, classes, seed, start)
    labels = np.full(len(x), UNCLASSIFIED, dtype=np.int64)
    changed, iterations, distances = 1.0, 0, np.zeros(len(x))
    while iterations < max_iterations:
        iterations += 1
        fresh, distances = assign(x, centres)
        changed = float(np.mean(fresh != labels))
        labels = fresh
        centres = _means(x, labels, centres, distances)
        if changed < stop_change or changed == 0:
            break
    labels, distances = assign(x, centres)
    full = np.full(len(every), UNCLASSIFIED, dtype=np.int64)
    full[usable] = labels
    return Classes(full, centres, iterations, changed, float(distances.sum()))


def _start(x: Floats, classes: int, seed: int, start: str | Floats) -> Floats:
    if not isinstance(start, str):
        centres = np.array(start, dtype=np.float64)
        if centres.shape != (classes, x.shape[1]) or not np.isfinite(centres).all():
            raise DataError(f"start centres have shape {centres.shape}", f"give finite ({classes}, {x.shape[1]})")
        return centres
    if start == "even":
        low, high = x.min(axis=0), x.max(axis=0)
        fractions = (np.arange(classes) + 0.5) / classes
        return np.asarray(low + fractions[:, None] * (high - low))
    random = np.random.default_rng(seed)
    chosen = [x[random.integers(len(x))]]
    squared = np.sum((x - chosen[0]) ** 2, axis=1)
    while len(chosen) < classes:
        # The next centre is drawn with a chance proportional to its squared distance from those there are.
        cumulative = np.cumsum(squared)
        index = int(np.searchsorted(cumulative, random.random() * cumulative[-1], side="right"))
        chosen.append(x[min(index, len(x) - 1)])
        squared = np.minimum(squared, np.sum((x - chosen[-1]) ** 2, axis=1))
    return np.stack(chosen)


def _means(x: Floats, labels: Labels, centres: Floats, distances: Floats) -> Floats:
    fresh = centres.copy()
    spare = np.argsort(-distances, kind="stable")
    taken = 0
    for k in range(len(centres)):
        members = x[labels == k]
        if len(members):
            fresh[k] = members.mean(axis=0)
        else:
            # A class without members starts again at the sample that fits its own class worst.
            fresh[k] = x[spare[taken]]
            taken += 1
    return fresh
