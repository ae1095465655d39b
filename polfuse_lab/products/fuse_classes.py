"""Classes of the fused vector: found without knowing any, or learnt from regions and judged on the rest of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.region_statistics import Region
from processing.fusion.confusion import Confusion, confusion
from processing.fusion.isodata import IsodataSettings, isodata
from processing.fusion.kmeans import UNCLASSIFIED, kmeans
from processing.fusion.regions import polygon_mask
from processing.fusion.supervised import gaussian_mixture, learn

Floats = NDArray[np.float64]
Labels = NDArray[np.int64]

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
    regions: tuple[Region, ...],
    x_m: Floats,
    y_m: Floats,
) -> Classified:
    """The class of every pixel.

    Args:
        features: (d, ny, nx) fused vectors; NaN where undefined.
        method: how.
        classes: how many, for K-means; for ISODATA and mixtures to begin with, or at most.
        seed: of anything random.
        start: of K-means.
        regions: what classes are learnt from.
        x_m: (nx,).
        y_m: (ny,).

    Raises:
        PolfuseError: classes to be learnt without regions, or regions too small to learn from and to judge.
        DataError: data that cannot be classified.
    """
    shape = features.shape[1:]
    samples = features.reshape(len(features), -1).T
    if method in LEARNT:
        return _learnt(features, samples, method, regions, x_m, y_m, seed)
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


def _learnt(
    features: Floats, samples: Floats, method: Any, regions: tuple[Region, ...], x_m: Floats, y_m: Floats, seed: int
) -> Classified:
    if len(regions) < 2:
        raise PolfuseError(
            f"classes are learnt by {method} from regions, and there are none",
            where="classifier",
            advice="add --regions with two or more regions",
        )
    shape = features.shape[1:]
    row, column = np.indices(shape)
    learnt_from = ((row // BLOCK_PX + column // BLOCK_PX) % 2 == 0).ravel()
    defined = np.isfinite(samples).all(axis=1)
    inside = [polygon_mask(region.polygon_m, x_m, y_m).ravel() & defined for region in regions]
    for region, mask in zip(regions, inside, strict=True):
        if min((mask & learnt_from).sum(), (mask & ~learnt_from).sum()) < 2:
            raise PolfuseError(
                f"region '{region.name}' holds {mask.sum()} defined pixels, too few to learn from and to judge",
                where="classifier",
                advice=f"draw it larger: it is parted in squares of {BLOCK_PX} pixels",
            )
    classifier = learn([samples[mask & learnt_from] for mask in inside], method, seed=seed)
    labels = classifier(samples)
    truth = np.full(len(samples), UNCLASSIFIED, dtype=np.int64)
    for k, mask in enumerate(inside):
        truth[mask & ~learnt_from] = k
    names = tuple(region.name for region in regions)
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
