"""Radar and camera on one grid: the fused vector, classes, their separability and anomalies: stage ``"fusion"``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.fuse_classes import Classifier, classify, confusion_settings
from polfuse_lab.products.optics import pinhole_of
from polfuse_lab.products.region_statistics import (
    ClassSummary,
    Group,
    Separability,
    read_regions,
    region_samples,
    separabilities,
    statistics,
    summaries,
)
from polfuse_lab.products.store import Products
from processing.errors import DataError
from processing.fusion.anomalies import local_reed_xiaoli, reed_xiaoli
from processing.fusion.features import FEATURES, fused_vector, normalized_components
from processing.fusion.registration import GeometryErrors, ground_to_camera, registration_error, sample_bilinear
from processing.fusion.registration_refine import PictureShift, shift_by_pictures
from processing.fusion.separability import class_statistics
from processing.optics.debias import debias
from processing.radar.profiles import SPEED_OF_LIGHT_M_S

Floats = NDArray[np.float64]

STAGE = "fusion"
UNITS = {"u_px": "px", "v_px": "px", "registration_error_px": "px", "s0_on_ground": "counts", "x_m": "m", "y_m": "m"}


@dataclass(frozen=True)
class FuseResult:
    """Outcome of the fusion."""

    products: Path
    classes: dict[str, ClassSummary]
    """What the classifier found."""
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
    confusion: dict[str, Any] | None = None
    """Of learnt classes, on pixels that were not learnt from: counts (row true, column told), accuracy, kappa."""
    shift: PictureShift | None = None
    """By which the camera's picture was found displaced and corrected; None where it was not."""


def fuse(
    products_path: Path | str,
    *,
    regions: Path | str | None = None,
    classes: int = 3,
    seed: int = 0,
    start: Literal["k-means++", "even"] = "k-means++",
    min_snr_db: float = 6.0,
    dynamic_range_db: float = 30.0,
    classifier: Classifier = "kmeans",
    normalization: Literal["pixel", "scene"] = "pixel",
    angle_sd_rad: float = np.radians(1.0),
    height_sd_m: float = 0.3,
    refine: bool = False,
) -> FuseResult:
    """Register camera and radar on the ground, stack the fused vector (thesis 6.12), classify and compare.

    Writes stage "fusion": ``features`` (4, ny, nx) float32 in the order of the settings' ``features``, ``classes``
    (ny, nx) int8 (-1: none), ``s0_on_ground``, ``dolp_on_ground``, ``u_px``, ``v_px``, ``registration_error_px``,
    ``rx``, ``local_rx``, ``x_m``, ``y_m``. Undefined pixels are NaN.

    Args:
        products_path: products file with stages "calibration", "polarimetry" and "optics".
        regions: regions file; distances are then between its regions instead of the classes.
        classes: number of K-means classes; ISODATA begins with so many, a mixture has so many at most.
        seed: of anything random in the classifier.
        start: of K-means; "even" as in the thesis.
        min_snr_db: least span over noise of a radar pixel, dB; fainter pixels have no mechanism.
        dynamic_range_db: span below the brightest pixel's, dB, at which pixels end; fainter ones show side lobes.
        classifier: ``"kmeans"``, ``"isodata"``, ``"mixture"`` (of normal classes), or learnt from the regions and
            judged on pixels that were not learnt from: ``"likelihood"``, ``"svm"``, ``"forest"``.
        normalization: see :func:`processing.fusion.features.normalized_components`.
        angle_sd_rad: how well the camera's direction is known, rad.
        height_sd_m: how far above the ground scatterers may stand, m.
        refine: whether registration by geometry is corrected by the mutual information of both pictures, where it tells
            more of the camera's direction than ``angle_sd_rad`` does.

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
    notes: list[str] = []
    errors = _geometry_errors(products, settings, angle_sd_rad, height_sd_m)
    budget = registration_error(camera, x_m, y_m, z_m, errors)
    shift: PictureShift | None = None
    if refine:
        seen = np.isfinite(u)
        # A whole cell: its length is sqrt 12 standard deviations of a place in it.
        cells = np.sqrt(12) * np.hypot(budget.range_cell, budget.cross_range_cell)[seen]
        cell_px = float(np.median(cells)) if seen.any() else np.inf
        shift = _shift(polarimetry["span"], optics["s0"], (u, v), cell_px, camera.focal_length_px * angle_sd_rad, notes)
    if shift is not None:
        told = float(np.hypot(max(shift.right_sd_px, shift.down_sd_px), cell_px / np.sqrt(12))) / camera.focal_length_px
        errors = replace(errors, angle_rad=told)
        budget = registration_error(camera, x_m, y_m, z_m, errors)
        u, v = u + shift.right_px, v + shift.down_px
    s0, dolp = _stokes_on_ground(optics, u, v)
    error_px = np.where(np.isfinite(u), budget.total, np.nan)
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
    patches = () if regions is None else read_regions(regions)
    drawn = region_samples(patches, features, x_m, y_m, str(regions))
    found = classify(
        features, classifier, classes=classes, seed=seed, start=start, regions=patches, x_m=x_m, y_m=y_m
    )  # fmt: skip
    labels = found.labels.ravel()
    by_class = statistics({name: samples[labels == k] for k, name in enumerate(found.names)}, notes)
    by_region: dict[str, Group] = statistics(drawn, notes, strict=True)
    rx = _anomalies(features, notes)
    result = FuseResult(
        products=products.path,
        classes=summaries(by_class),
        regions=summaries(by_region),
        pairs=separabilities(by_region or by_class),
        pixels=int(fused.sum()),
        iterations=found.iterations,
        registration_error_px=float(np.median(error_px[fused])),
        notes=tuple(notes),
        confusion=None if found.judged is None else confusion_settings(found.judged, found.names),
        shift=shift,
    )
    arrays: dict[str, NDArray[Any]] = {
        "features": features.astype(np.float32),
        "classes": found.labels.astype(np.int8),
        "s0_on_ground": s0.astype(np.float32),
        "dolp_on_ground": dolp.astype(np.float32),
        "u_px": u.astype(np.float32),
        "v_px": v.astype(np.float32),
        "registration_error_px": error_px.astype(np.float32),
        "rx": rx.astype(np.float32),
        "local_rx": local_reed_xiaoli(features).astype(np.float32),
        "x_m": x_m,
        "y_m": y_m,
    }
    stored = {
        "features": list(FEATURES),
        "normalization": normalization,
        "z_m": z_m,
        "classifier": classifier,
        "class_names": list(found.names),
        "confusion": result.confusion,
        "seed": seed,
        "start": start,
        "min_snr_db": min_snr_db,
        "dynamic_range_db": dynamic_range_db,
        "iterations": found.iterations,
        "geometry_errors": vars(errors),
        "registration_shift_px": None if shift is None else vars(shift),
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


def _shift(
    span_m2: NDArray[Any],
    s0: NDArray[Any],
    at: tuple[Floats, Floats],
    cell_px: float,
    known_px: float,
    notes: list[str],
) -> PictureShift | None:
    """Displacement of the camera's picture, if both pictures tell it better than ``known_px``.

    They do not where the radar's cell, as long as the camera sees it (``cell_px``), is longer than that: the best shift
    follows single bright cells then.
    """
    if not cell_px < known_px:
        notes.append(
            f"registration by geometry alone: the radar's cell spans {cell_px:.1f} px of the camera's picture, whose "
            f"direction is known to {known_px:.1f} px already"
        )
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        level_db = np.where(span_m2 > 0, 10 * np.log10(span_m2), np.nan)
    try:
        shift = shift_by_pictures(level_db, s0, *at, largest_px=max(3 * known_px, 6.0), step_px=max(known_px / 3, 1.0))
    except DataError as error:
        notes.append(f"registration by geometry alone: {error}")
        return None
    if not max(shift.right_sd_px, shift.down_sd_px) < known_px:
        notes.append("registration by geometry alone: both pictures have too little in common")
        return None
    return shift


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


def _anomalies(features: Floats, notes: list[str]) -> Floats:
    try:
        samples = features.reshape(len(features), -1).T
        return reed_xiaoli(features, class_statistics(samples, "all fused pixels", singular="regularize"))
    except DataError as error:
        notes.append(f"no anomaly map: {error}")
        return np.full(features.shape[1:], np.nan)
