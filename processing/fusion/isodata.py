"""ISODATA: K-means that splits wide classes, merges close ones and drops small ones (Ball and Hall 1965)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.fusion.kmeans import UNCLASSIFIED, Classes, assign, kmeans

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class IsodataSettings:
    """When classes are split, merged and dropped. Distances are in units of the features."""

    classes: int = 3
    """Number of classes to begin with; the outcome lies between a half and twice as many."""
    least_share: float = 0.01
    """Classes with a smaller share of the samples are dropped."""
    widest_sd: float = 0.2
    """A class with a larger standard deviation in any feature is split there."""
    closest: float = 0.2
    """Classes whose centres are nearer are merged."""
    max_iterations: int = 30


def isodata(samples: ArrayLike, settings: IsodataSettings | None = None, *, seed: int = 0) -> Classes:
    """Cluster samples (n, d) into as many classes as they have. Deterministic.

    Returns:
        As :func:`processing.fusion.kmeans.kmeans`; ``changed`` is the share of samples that changed class last.

    Raises:
        DataError: settings that make no sense, or fewer distinct samples than classes.
    """
    wish = IsodataSettings() if settings is None else settings
    if not (wish.widest_sd > 0 and wish.closest >= 0 and 0 <= wish.least_share < 1 and wish.max_iterations >= 1):
        raise DataError(f"{wish}", "give a positive spread, a distance of at least 0 and a share below 1")
    begun = kmeans(samples, wish.classes, seed=seed)
    every = np.asarray(samples, dtype=np.float64)
    usable = begun.labels != UNCLASSIFIED
    x = np.ascontiguousarray(every[usable])
    centres, labels = begun.centres, begun.labels[usable]
    changed, iterations = 1.0, 0
    for iterations in range(1, wish.max_iterations + 1):
        centres = _dropped(x, centres, labels, wish)
        labels_now, _ = assign(x, centres)
        centres = _of(x, labels_now)
        # Splits and merges take turns, so that one does not undo the other at once.
        few, many = 2 * len(centres) <= wish.classes, len(centres) >= 2 * wish.classes
        altered = centres
        if few or (iterations % 2 and not many):
            altered = _split(x, centres, assign(x, centres)[0], wish)
        if len(altered) == len(centres) and not few:
            altered = _merged(x, centres, assign(x, centres)[0], wish)
        grown = len(altered) != len(centres)
        centres = altered
        fresh, _ = assign(x, centres)
        changed = 1.0 if grown else float(np.mean(fresh != labels))
        labels = fresh
        if not grown and changed == 0 and iterations > 1:
            break
    centres = _of(x, labels)
    labels, distances = assign(x, centres)
    full = np.full(len(every), UNCLASSIFIED, dtype=np.int64)
    full[usable] = labels
    return Classes(full, centres, iterations, changed, float(distances.sum()))


def _of(x: Floats, labels: NDArray[np.int64]) -> Floats:
    """Means of the classes that have members."""
    return np.stack([x[labels == k].mean(axis=0) for k in np.unique(labels)])


def _dropped(x: Floats, centres: Floats, labels: NDArray[np.int64], wish: IsodataSettings) -> Floats:
    counts = np.bincount(labels, minlength=len(centres))
    keep = counts >= max(wish.least_share * len(x), 1)
    if not keep.any():
        keep[np.argmax(counts)] = True
    return centres[keep]


def _split(x: Floats, centres: Floats, labels: NDArray[np.int64], wish: IsodataSettings) -> Floats:
    made: list[Floats] = []
    for k, centre in enumerate(centres):
        members = x[labels == k]
        spread = members.std(axis=0) if len(members) else np.zeros(x.shape[1])
        widest = int(np.argmax(spread))
        room = len(centres) + len(made) - k < 2 * wish.classes
        if spread[widest] > wish.widest_sd and len(members) > 2 * max(wish.least_share * len(x), 1) and room:
            away = np.zeros_like(centre)
            away[widest] = spread[widest]
            made += [centre - away, centre + away]
        else:
            made.append(centre)
    return np.stack(made)


def _merged(x: Floats, centres: Floats, labels: NDArray[np.int64], wish: IsodataSettings) -> Floats:
    """The closest pair becomes its weighted mean, where it is too close."""
    if len(centres) < 2:
        return centres
    distance = np.sqrt(np.sum((centres[:, None] - centres[None]) ** 2, axis=2))
    distance[np.diag_indices(len(centres))] = np.inf
    i, j = np.unravel_index(int(np.argmin(distance)), distance.shape)
    if distance[i, j] >= wish.closest:
        return centres
    counts = np.bincount(labels, minlength=len(centres))
    weight = counts[i] + counts[j]
    mean = (counts[i] * centres[i] + counts[j] * centres[j]) / weight if weight else (centres[i] + centres[j]) / 2
    rest = np.delete(centres, [i, j], axis=0)
    return np.concatenate([rest, mean[None]])
