"""Regions and classes of the fused picture: what they are like, and how well they can be told apart."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.store import Products
from polfuse_lab.rig import FileModel, read_model
from polfuse_lab.rig.toml_model import model_to_toml
from processing.errors import DataError
from processing.fusion.features import FEATURES
from processing.fusion.regions import polygon_mask
from processing.fusion.separability import (
    BayesBounds,
    Statistics,
    bayes_bounds,
    bhattacharyya,
    class_statistics,
    jeffries_matusita,
)

Floats = NDArray[np.float64]

BANDS = {"pauli": (0, 1, 2), "pauli_dolp": (0, 1, 2, 3), "even_odd_dolp": (0, 2, 3)}
"""Sets of features that are compared, as in thesis Table 7.3."""


class Region(FileModel):
    """A named patch of the ground."""

    name: str = Field(min_length=1)
    """A name for tables and figures."""
    polygon_m: tuple[tuple[float, float], ...] = Field(min_length=3)
    """Corners [x, y] in order, m: x along the rail, y ground range."""


class Regions(FileModel):
    """A regions file: ``[[region]]`` tables."""

    region: tuple[Region, ...] = Field(min_length=2)
    """Two or more regions to be told apart."""


@dataclass(frozen=True)
class Separability:
    """How well two classes can be told apart."""

    distance: dict[str, float]
    """Bhattacharyya distance by set of features (``BANDS``)."""
    bounds: BayesBounds
    """Of the Bayes error with equal priors, from all four features."""
    jeffries_matusita: float
    """From all four features."""


@dataclass(frozen=True)
class ClassSummary:
    """One class or region."""

    pixels: int
    fraction: float
    """Of the classified pixels."""
    mean: dict[str, float]
    """Mean of each feature, by name."""
    mechanism: str
    """Pauli component of the mean above 0.8 of its norm, or "mixed"."""
    regularized: str
    """Why its covariance had to be regularized, or empty."""


@dataclass(frozen=True)
class Group:
    """Samples of one class or region, and their statistics for each set of features."""

    samples: Floats
    by_band: dict[str, Statistics]


@dataclass(frozen=True)
class RegionReport:
    """What regions drawn by hand hold."""

    regions: dict[str, ClassSummary]
    pairs: dict[str, Separability]
    notes: tuple[str, ...]


def region_report(products: Products | Path | str, regions: tuple[Region, ...]) -> RegionReport:
    """Statistics of regions, and of each two of them, in a fused products file; writes nothing.

    Args:
        products: with the stage ``"fusion"``.
        regions: one or more; with two or more their separability is told as well.

    Raises:
        PolfuseError: not fused yet, or a region without a defined pixel.
        DataError: a region with too few pixels.
    """
    products = products if isinstance(products, Products) else Products(products)
    arrays = products.read("fusion")
    features = arrays["features"].astype(np.float64)
    samples = region_samples(regions, features, arrays["x_m"], arrays["y_m"], str(products.path))
    notes: list[str] = []
    groups = statistics(samples, notes, strict=True)
    return RegionReport(summaries(groups), separabilities(groups), tuple(notes))


def write_regions(path: Path | str, regions: tuple[Region, ...]) -> None:
    """Write a regions file. Raises :class:`PolfuseError` where that cannot be done, or for fewer than two regions."""
    if len(regions) < 2:
        raise PolfuseError(
            f"{len(regions)} regions cannot be told apart", where=str(path), advice="draw two or more, then save them"
        )
    try:
        Path(path).write_text(model_to_toml(Regions(region=regions)), encoding="utf-8")
    except OSError as error:
        raise PolfuseError(
            f"cannot be written ({error.strerror})", where=str(path), advice="choose another place for the regions"
        ) from error


def read_regions(path: Path | str) -> tuple[Region, ...]:
    """Regions of a regions file. Raises as :func:`polfuse_lab.rig.read_model`."""
    return read_model(path, Regions).region


def region_samples(
    regions: tuple[Region, ...], features: Floats, x_m: Floats, y_m: Floats, where: str
) -> dict[str, Floats]:
    """Feature vectors (n, 4) of the pixels in each region; ``where`` is for messages.

    Raises:
        PolfuseError: two regions of one name, or one without a defined pixel.
    """
    found: dict[str, Floats] = {}
    for region in regions:
        if region.name in found:
            raise PolfuseError(f"names region '{region.name}' twice", where=where, advice="give each its own name")
        inside = polygon_mask(region.polygon_m, x_m, y_m)
        samples = features[:, inside].T
        if not np.isfinite(samples).all(axis=1).any():
            raise PolfuseError(
                f"region '{region.name}' holds no pixel that both radar and camera define ({inside.sum()} inside)",
                where=where,
                advice="move or enlarge it, or lower --min-snr-db",
            )
        found[region.name] = samples
    return found


def statistics(groups: Mapping[str, Floats], notes: list[str], *, strict: bool = False) -> dict[str, Group]:
    """Statistics of each group for each set of features; groups that are too small are left out, or refused."""
    found = {}
    for name, samples in groups.items():
        defined = samples[np.isfinite(samples).all(axis=1)]
        try:
            by_band = {
                band: class_statistics(defined[:, columns], name, singular="regularize")
                for band, columns in BANDS.items()
            }
        except DataError as error:
            if strict:
                raise
            notes.append(str(error))
            continue
        if reason := by_band["pauli_dolp"].regularized:
            notes.append(f"the covariance of '{name}' was singular ({reason}) and was regularized")
        found[name] = Group(defined, by_band)
    return found


def summaries(groups: Mapping[str, Group]) -> dict[str, ClassSummary]:
    """What each group is like."""
    total = sum(len(group.samples) for group in groups.values())
    summaries = {}
    for name, group in groups.items():
        mean = group.by_band["pauli_dolp"].mean
        summaries[name] = ClassSummary(
            pixels=len(group.samples),
            fraction=len(group.samples) / total,
            mean={feature: float(value) for feature, value in zip(FEATURES, mean, strict=True)},
            mechanism=_mechanism(mean[:3]),
            regularized=group.by_band["pauli_dolp"].regularized,
        )
    return summaries


def _mechanism(components: Floats) -> str:
    share = components / max(float(np.linalg.norm(components)), 1e-300)
    return FEATURES[int(np.argmax(share))] if share.max() > 0.8 else "mixed"


def separabilities(groups: Mapping[str, Group]) -> dict[str, Separability]:
    """How well each two groups can be told apart, by ``"one - other"``."""
    pairs = {}
    for (name, one), (other_name, other) in itertools.combinations(groups.items(), 2):
        distance = {band: bhattacharyya(one.by_band[band], other.by_band[band]) for band in BANDS}
        pairs[f"{name} - {other_name}"] = Separability(
            distance, bayes_bounds(distance["pauli_dolp"]), jeffries_matusita(distance["pauli_dolp"])
        )
    return pairs
