"""Radar and camera on one grid: the fused vector, classes, their separability and anomalies: stage ``"fusion"``."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.optics import pinhole_of
from polfuse_lab.products.store import Products
from polfuse_lab.rig import FileModel, read_model
from processing.errors import DataError
from processing.fusion.features import FEATURES, fused_vector, normalized_components
from processing.fusion.kmeans import UNCLASSIFIED, Classes, kmeans
from processing.fusion.regions import polygon_mask
from processing.fusion.registration import GeometryErrors, ground_to_camera, registration_error, sample_bilinear
from processing.fusion.separability import (
    BayesBounds,
    Statistics,
    bayes_bounds,
    bhattacharyya,
    class_statistics,
    jeffries_matusita,
    reed_xiaoli,
)
from processing.optics.debias import debias
from processing.radar.profiles import SPEED_OF_LIGHT_M_S

Floats = NDArray[np.float64]

STAGE = "fusion"
BANDS = {"pauli": (0, 1, 2), "pauli_dolp": (0, 1, 2, 3), "even_odd_dolp": (0, 2, 3)}
"""Sets of features that are compared, as in thesis Table 7.3."""
UNITS = {"u_px": "px", "v_px": "px", "registration_error_px": "px", "s0_on_ground": "counts", "x_m": "m", "y_m": "m"}


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
class FuseResult:
    """Outcome of the fusion."""

    products: Path
    classes: dict[str, ClassSummary]
    """K-means classes."""
    regions: dict[str, ClassSummary]
    """Regions of the regions file; empty without one."""
    pairs: dict[str, Separability]
    """Between the regions, or between the classes where there is no regions file."""
    pixels: int
    """Pixels with a fused vector."""
    iterations: int
    registration_error_px: float
    """Median over the fused pixels."""
    notes: tuple[str, ...]
    """What could not be done, and why."""


def fuse(
    products_path: Path | str,
    *,
    regions: Path | str | None = None,
    classes: int = 3,
    seed: int = 0,
    start: Literal["k-means++", "even"] = "k-means++",
    min_snr_db: float = 6.0,
    dynamic_range_db: float = 30.0,
    normalization: Literal["pixel", "scene"] = "pixel",
    angle_sd_rad: float = np.radians(1.0),
    height_sd_m: float = 0.3,
) -> FuseResult:
    """Register camera and radar on the ground, stack the fused vector (thesis 6.12), classify and compare.

    Writes stage "fusion": ``features`` (4, ny, nx) float32 in the order of the settings' ``features``, ``classes``
    (ny, nx) int8 (-1: none), ``s0_on_ground``, ``dolp_on_ground``, ``u_px``, ``v_px``, ``registration_error_px``,
    ``rx``, ``x_m``, ``y_m``. Undefined pixels are NaN.

    Args:
        products_path: products file with stages "calibration", "polarimetry" and "optics".
        regions: regions file; distances are then between its regions instead of the classes.
        classes: number of K-means classes.
        seed: of K-means.
        start: of K-means; "even" as in the thesis.
        min_snr_db: least span over noise of a radar pixel, dB; fainter pixels have no mechanism.
        dynamic_range_db: span below the brightest pixel's, dB, at which pixels end; fainter ones show side lobes.
        normalization: see :func:`processing.fusion.features.normalized_components`.
        angle_sd_rad: how well the camera's direction is known, rad.
        height_sd_m: how far above the ground scatterers may stand, m.

    Raises:
        PolfuseError: stages that are missing, a bad regions file, or too few pixels.
        DataError: data that cannot be classified or told apart.
    """
    products = Products(products_path)
    polarimetry, calibration = products.read("polarimetry"), products.read("calibration")
    settings = products.settings("calibration")
    optics, camera = products.read("optics"), pinhole_of(products.settings("optics"))
    x_m, y_m, z_m = polarimetry["x_m"], polarimetry["y_m"], float(settings["z_m"])

    u, v = ground_to_camera(camera, x_m, y_m, z_m)
    s0, dolp = _stokes_on_ground(optics, u, v)
    errors = _geometry_errors(products, settings, angle_sd_rad, height_sd_m)
    error_px = np.where(np.isfinite(u), registration_error(camera, x_m, y_m, z_m, errors).total, np.nan)
    usable = _above_noise(polarimetry["span"], calibration["noise_equivalent_rcs_m2"], settings, min_snr_db)
    usable &= polarimetry["span"] > 10 ** (-dynamic_range_db / 10) * np.nanmax(polarimetry["span"], initial=0.0)
    components = normalized_components(polarimetry["pauli"], normalization=normalization, usable=usable)
    features = fused_vector(components, dolp)
    fused = np.isfinite(features[0])
    if not fused.any():
        raise PolfuseError(
            "no pixel is defined in both radar and camera pictures",
            where=str(products.path),
            advice="check the camera's place and direction in the rig file, or lower --min-snr-db",
        )
    samples = features.reshape(4, -1).T
    found = _ordered(kmeans(samples, classes, seed=seed, start=start))
    notes: list[str] = []
    by_class = _statistics({f"class {i + 1}": samples[found.labels == i] for i in range(classes)}, notes)
    by_region = {} if regions is None else _statistics(_region_samples(regions, features, x_m, y_m), notes, strict=True)
    rx = _anomalies(features, notes)
    result = FuseResult(
        products=products.path,
        classes=_summaries(by_class),
        regions=_summaries(by_region),
        pairs=_pairs(by_region or by_class),
        pixels=int(fused.sum()),
        iterations=found.iterations,
        registration_error_px=float(np.median(error_px[fused])),
        notes=tuple(notes),
    )
    arrays: dict[str, NDArray[Any]] = {
        "features": features.astype(np.float32),
        "classes": found.labels.reshape(fused.shape).astype(np.int8),
        "s0_on_ground": s0.astype(np.float32),
        "dolp_on_ground": dolp.astype(np.float32),
        "u_px": u.astype(np.float32),
        "v_px": v.astype(np.float32),
        "registration_error_px": error_px.astype(np.float32),
        "rx": rx.astype(np.float32),
        "x_m": x_m,
        "y_m": y_m,
    }
    stored = {
        "features": list(FEATURES),
        "normalization": normalization,
        "z_m": z_m,
        "seed": seed,
        "start": start,
        "min_snr_db": min_snr_db,
        "dynamic_range_db": dynamic_range_db,
        "iterations": found.iterations,
        "geometry_errors": vars(errors),
        "classes": {name: vars(item) for name, item in result.classes.items()},
        "regions": {name: vars(item) for name, item in result.regions.items()},
        "bhattacharyya": {name: item.distance for name, item in result.pairs.items()},
        "bayes_bounds": {name: list(item.bounds) for name, item in result.pairs.items()},
        "notes": notes,
    }
    inputs = [products.path, *([] if regions is None else [Path(regions)])]
    products.write(STAGE, arrays, settings=stored, inputs=inputs, units=UNITS)
    return result


def _stokes_on_ground(optics: Mapping[str, NDArray[Any]], u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """S0 and debiased DOLP at camera pixels: Stokes parameters are interpolated, never DOLP."""
    masked = ~np.isfinite(optics["dolp"])
    planes = [np.where(masked, np.nan, optics[name]) for name in ("s0", "s1", "s2", "s0_sd")]
    s0, s1, s2, sd = (sample_bilinear(plane, u, v) for plane in planes)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Behind angles that are spread evenly, S1 and S2 have twice the variance of S0.
        return s0, debias(np.hypot(s1, s2), 2 * sd**2) / s0


def _geometry_errors(
    products: Products, settings: Mapping[str, Any], angle_sd_rad: float, height_sd_m: float
) -> GeometryErrors:
    """A scatterer may lie anywhere in its resolution cell: sd is the cell over sqrt 12."""
    antenna = products.read("ranging")["antenna_m"]
    y_m = products.read("polarimetry")["y_m"]
    aperture = float(np.ptp(antenna[:, 0]))
    range_cell = SPEED_OF_LIGHT_M_S / (2 * float(settings["bandwidth_hz"]))
    slant = float(np.hypot(np.median(y_m), float(settings["z_m"])))
    wavelength = SPEED_OF_LIGHT_M_S / float(settings["centre_hz"])
    # Exact for any aperture: lambda / (4 sin(half the aperture's angle)).
    cross_cell = wavelength / (4 * np.sin(np.arctan2(aperture / 2, slant))) if aperture > 0 else slant
    return GeometryErrors(range_cell / np.sqrt(12), float(cross_cell) / np.sqrt(12), angle_sd_rad, height_sd_m)


def _above_noise(
    span_m2: NDArray[Any], noise: NDArray[Any], settings: Mapping[str, Any], min_snr_db: float
) -> NDArray[np.bool_]:
    by_name = dict(zip(settings["channels"], noise, strict=True))
    crosses = [by_name[name] for name in ("HV", "VH") if name in by_name]
    # The cross-polarized element is the mean of its channels and counts twice in the span.
    level = by_name["HH"] + by_name["VV"] + 2 * sum(crosses) / len(crosses) ** 2
    with np.errstate(invalid="ignore"):
        return np.asarray(span_m2 > 10 ** (min_snr_db / 10) * level[:, None])


def _ordered(found: Classes) -> Classes:
    """Classes in a fixed order: most even-bounce first."""
    order = np.argsort(-found.centres[:, 0], kind="stable")
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    labels = np.where(found.labels == UNCLASSIFIED, UNCLASSIFIED, rank[found.labels])
    return Classes(labels, found.centres[order], found.iterations, found.changed, found.inertia)


def _region_samples(path: Path | str, features: Floats, x_m: Floats, y_m: Floats) -> dict[str, Floats]:
    found: dict[str, Floats] = {}
    for region in read_model(path, Regions).region:
        if region.name in found:
            raise PolfuseError(f"names region '{region.name}' twice", where=str(path), advice="give each its own name")
        inside = polygon_mask(region.polygon_m, x_m, y_m)
        samples = features[:, inside].T
        if not np.isfinite(samples).all(axis=1).any():
            raise PolfuseError(
                f"region '{region.name}' holds no pixel that both radar and camera define ({inside.sum()} inside)",
                where=str(path),
                advice="move or enlarge it, or lower --min-snr-db",
            )
        found[region.name] = samples
    return found


@dataclass(frozen=True)
class _Group:
    samples: Floats
    by_band: dict[str, Statistics]


def _statistics(groups: Mapping[str, Floats], notes: list[str], *, strict: bool = False) -> dict[str, _Group]:
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
        found[name] = _Group(defined, by_band)
    return found


def _summaries(groups: Mapping[str, _Group]) -> dict[str, ClassSummary]:
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


def _pairs(groups: Mapping[str, _Group]) -> dict[str, Separability]:
    pairs = {}
    for (name, one), (other_name, other) in itertools.combinations(groups.items(), 2):
        distance = {band: bhattacharyya(one.by_band[band], other.by_band[band]) for band in BANDS}
        pairs[f"{name} - {other_name}"] = Separability(
            distance, bayes_bounds(distance["pauli_dolp"]), jeffries_matusita(distance["pauli_dolp"])
        )
    return pairs


def _anomalies(features: Floats, notes: list[str]) -> Floats:
    try:
        samples = features.reshape(len(features), -1).T
        return reed_xiaoli(features, class_statistics(samples, "all fused pixels", singular="regularize"))
    except DataError as error:
        notes.append(f"no anomaly map: {error}")
        return np.full(features.shape[1:], np.nan)
