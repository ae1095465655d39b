"""Classes of the fused vector: found without knowing any, or learnt from regions and judged on the rest of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from processing.fusion.confusion import Confusion, confusion
from processing.fusion.isodata import IsodataSettings, isodata
from processing.fusion.kmeans import UNCLASSIFIED, kmeans
from processing.fusion.supervised import gaussian_mixture, learn

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]
Mask = NDArray[np.bool_]

Classifier = Literal["kmeans", "isodata", "mixture", "likelihood", "svm", "forest"]
LEARNT = ("likelihood", "svm", "forest")
BLOCK_PX = 8
"""Regions are learnt from and judged in turn by squares of so many pixels: neighbours, which share a resolution cell,
are mostly on the same side."""


@dataclass(frozen=True)
class Classified:
    """Every pixel's class."""

    labels: Labels
    """(ny, nx); ``UNCLASSIFIED`` where the fused vector is undefined."""
    names: tuple[str, ...]
    iterations: int
    """0 for classes that were learnt."""
    judged: Confusion | None
    """Of learnt classes on pixels of the regions that were not learnt from."""


def classify(
    features: Floats,
    method: Classifier,
    *,
    classes: int,
    seed: int,
    start: Literal["k-means++", "even"],
    regions: Mapping[str, Mask],
) -> Classified:
    """The class of every pixel.

    Args:
        features: (d, ny, nx) fused vectors; NaN where undefined.
        method: how.
        classes: how many, for K-means; for ISODATA and mixtures to begin with, or at most.
        seed: of anything random.
        start: of K-means.
        regions: pixels (ny, nx) of what classes are learnt from, by name.

    Raises:
        PolfuseError: classes to be learnt without regions, or regions too small to learn from and to judge.
        DataError: data that cannot be classified.
    """
    shape = features.shape[1:]
    samples = features.reshape(len(features), -1).T
    if method in LEARNT:
        return _learnt(features.shape[1:], samples, method, regions, seed)
    iterations = 0
    if method == "mixture":
        labels = gaussian_mixture(samples, most=classes, seed=seed).labels
    else:
        found = (
            kmeans(samples, classes, seed=seed, start=start)
            if method == "kmeans"
            else isodata(samples, IsodataSettings(classes=classes), seed=seed)
        )
        labels, iterations = found.labels, found.iterations
    labels = _ordered(labels, samples)
    names = tuple(f"class {k + 1}" for k in range(int(labels.max(initial=-1)) + 1))
    return Classified(labels.reshape(shape), names, iterations, None)


def halves(mask: Mask) -> tuple[Mask, Mask]:
    """Pixels (ny, nx) of a region that are learnt from, and those that are judged, in squares in turn."""
    row, column = np.indices(mask.shape)
    first = (row // BLOCK_PX + column // BLOCK_PX) % 2 == 0
    return mask & first, mask & ~first


def _learnt(shape: tuple[int, ...], samples: Floats, method: Any, regions: Mapping[str, Mask], seed: int) -> Classified:
    if len(regions) < 2:
        raise PolfuseError(
            f"classes are learnt by {method} from regions, and there are {len(regions) or 'none'}",
            where="classifier",
            advice="add --regions with two or more regions",
        )
    defined = np.isfinite(samples).all(axis=1).reshape(shape)
    parts = {name: [half.ravel() for half in halves(mask & defined)] for name, mask in regions.items()}
    for name, (learnt, judged) in parts.items():
        if min(learnt.sum(), judged.sum()) < 2:
            raise PolfuseError(
                f"region '{name}' holds {learnt.sum() + judged.sum()} defined pixels, too few to learn from and to "
                "judge",
                where="classifier",
                advice=f"draw it larger: it is parted in squares of {BLOCK_PX} pixels",
            )
    classifier = learn([samples[learnt] for learnt, _ in parts.values()], method, seed=seed)
    labels = classifier(samples)
    truth = np.full(len(samples), UNCLASSIFIED, dtype=np.int64)
    for k, (_, judged) in enumerate(parts.values()):
        truth[judged] = k
    names = tuple(regions)
    return Classified(labels.reshape(shape), names, 0, confusion(truth, labels, len(names)))


def _ordered(labels: Labels, samples: Floats) -> Labels:
    """Classes in a fixed order: most even-bounce first."""
    present = np.unique(labels[labels != UNCLASSIFIED])
    means = [-float(samples[labels == k, 0].mean()) for k in present]
    ordered = np.full_like(labels, UNCLASSIFIED)
    for rank, k in enumerate(present[np.argsort(means, kind="stable")]):
        ordered[labels == k] = rank
    return ordered


def confusion_settings(judged: Confusion, names: tuple[str, ...]) -> dict[str, Any]:
    """A confusion matrix as plain values."""
    return {
        "names": list(names),
        "counts": judged.counts.tolist(),
        "undecided": judged.undecided.tolist(),
        "accuracy": judged.accuracy,
        "accuracy_sd": judged.accuracy_sd,
        "kappa": _number(judged.kappa),
        "producers": [_number(share) for share in judged.producers],
        "users": [_number(share) for share in judged.users],
    }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
