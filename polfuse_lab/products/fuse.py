"""Radar and camera on one grid: the fused vector, classes, their separability and anomalies: stage ``"fusion"``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.fuse_classes import LEARNT, Classifier, classify, confusion_settings, halves
from polfuse_lab.products.fuse_resampling import told
from polfuse_lab.products.fuse_sources import GEOMETRY, IDENTITY, Geometry, is_simulated, of_session, of_simulation
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
from processing.fusion.regions import polygon_mask
from processing.fusion.registration_refine import PictureShift
from processing.fusion.resampling_planner import ResamplingChoice
from processing.fusion.separability import class_statistics

Floats = NDArray[np.float64]

STAGE = "fusion"
LEAST_BODY = 32
"""Fused pixels of a kind of body, below which it is no class of its own."""
UNITS = {"u_px": "px", "v_px": "px", "registration_error_px": "px", "x_m": "m", "y_m": "m"}


@dataclass(frozen=True)
class FuseResult:
    """Outcome of the fusion."""

    products: Path
    classes: dict[str, ClassSummary]
    """What the classifier found."""
    regions: dict[str, ClassSummary]
    """Regions of the regions file; without one the kinds of bodies of a simulation, else nothing."""
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
    registration: str = GEOMETRY
    """``"geometry"``, or ``"identity"`` for a simulation, whose pictures share a grid."""
    resampling: ResamplingChoice | None = None
    """How a tolerance chose to look between the camera's pixels, and why."""


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
    heights: Path | str | None = None,
    camera: Path | str | None = None,
    tolerance_db: float | None = None,
) -> FuseResult:
    """Register camera and radar on the ground, stack the fused vector (thesis 6.12), classify and compare.

    Writes stage "fusion": ``features`` (4, ny, nx) float32 in the order of the settings' ``features``, ``classes``
    (ny, nx) int8 (-1: none), ``s0_on_ground``, ``dolp_on_ground``, ``u_px``, ``v_px``, ``registration_error_px``,
    ``rx``, ``local_rx``, ``x_m``, ``y_m``. Undefined pixels are NaN.

    Args:
        products_path: products file with stages "calibration", "polarimetry" and "optics", or those of a simulation.
        regions: regions file; distances are then between its regions instead of the classes. Without one, those of a
            simulation are between kinds of bodies, as its truth has them.
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
        heights: file of a height map (:mod:`polfuse_lab.products.heights_file`) that the scene stands on instead of a
            plane; a picture that was focused on heights has its own. What is hidden from either sensor is undefined
            then, and ``height_sd_m`` holds where the map tells no standard deviation.
        camera: products file with stage "camera", a calibration of the camera's lens that is used instead of the rig
            file's (:mod:`polfuse_lab.products.camera_lens`).
        tolerance_db: largest error of the camera's picture between its pixels, dB below it: chooses straight lines or
            splines (:func:`processing.fusion.resampling_planner.choose_resampling`). Straight lines if left out.

    Raises:
        PolfuseError: stages that are missing, a bad regions file, or too few pixels.
        DataError: data that cannot be classified or told apart.
    """
    products = Products(products_path)
    notes: list[str] = []
    if is_simulated(products) and not (heights is None and camera is None and tolerance_db is None):
        raise PolfuseError(
            "both pictures of a simulation are on one grid already",
            where=str(products.path),
            advice="leave --heights, --camera and --tolerance out",
        )
    both = (
        of_simulation(products, notes, refine=refine)
        if is_simulated(products)
        else of_session(products, notes, Geometry(angle_sd_rad, height_sd_m, refine, heights, camera, tolerance_db))
    )
    x_m, y_m = both.x_m, both.y_m
    with np.errstate(invalid="ignore"):
        usable = np.asarray(both.span_m2 > 10 ** (min_snr_db / 10) * both.noise_m2)
        usable &= both.span_m2 > 10 ** (-dynamic_range_db / 10) * np.nanmax(both.span_m2, initial=0.0)
    components = normalized_components(both.pauli, normalization=normalization, usable=usable)
    features = fused_vector(components, both.dolp)
    fused = np.isfinite(features[0])
    if not fused.any():
        raise PolfuseError(
            "no pixel is defined in both radar and camera pictures",
            where=str(products.path),
            advice="lower --min-snr-db or the scene file's noise"
            if both.registration == IDENTITY
            else "check the camera's place and direction in the rig file, or lower --min-snr-db",
        )
    samples = features.reshape(4, -1).T
    if regions is None:
        masks = _large_enough(both.bodies, fused, classifier, notes)
        drawn = {name: features[:, mask & fused].T for name, mask in masks.items()}
    else:
        patches = read_regions(regions)
        masks = {patch.name: polygon_mask(patch.polygon_m, x_m, y_m) for patch in patches}
        drawn = region_samples(patches, features, x_m, y_m, str(regions))
    found = classify(features, classifier, classes=classes, seed=seed, start=start, regions=masks)
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
        registration_error_px=float(np.median(both.error_px[fused])),
        notes=tuple(notes),
        confusion=None if found.judged is None else confusion_settings(found.judged, found.names),
        shift=both.shift,
        registration=both.registration,
        resampling=both.resampling,
    )
    arrays: dict[str, NDArray[Any]] = {
        "features": features.astype(np.float32),
        "classes": found.labels.astype(np.int8),
        "s0_on_ground": both.s0.astype(np.float32),
        "dolp_on_ground": both.dolp.astype(np.float32),
        "u_px": both.u_px.astype(np.float32),
        "v_px": both.v_px.astype(np.float32),
        "registration_error_px": both.error_px.astype(np.float32),
        "rx": rx.astype(np.float32),
        "local_rx": local_reed_xiaoli(features).astype(np.float32),
        "x_m": x_m,
        "y_m": y_m,
    }
    stored = {
        "features": list(FEATURES),
        "normalization": normalization,
        "z_m": both.z_m,
        "classifier": classifier,
        "class_names": list(found.names),
        "confusion": result.confusion,
        "seed": seed,
        "start": start,
        "min_snr_db": min_snr_db,
        "dynamic_range_db": dynamic_range_db,
        "iterations": found.iterations,
        "registration": both.registration,
        "heights": None if heights is None else Path(heights).name,
        "relief": both.relief,
        "camera": None if both.camera is None else asdict(both.camera),
        "geometry_errors": None if both.errors is None else vars(both.errors),
        "registration_shift_px": None if both.shift is None else vars(both.shift),
        **({} if both.resampling is None else told(both.resampling)),
        "classes": {name: vars(item) for name, item in result.classes.items()},
        "regions": {name: vars(item) for name, item in result.regions.items()},
        "bhattacharyya": {name: item.distance for name, item in result.pairs.items()},
        "bayes_bounds": {name: list(item.bounds) for name, item in result.pairs.items()},
        "notes": notes,
    }
    inputs = [products.path, *(Path(given) for given in (regions, heights, camera) if given is not None)]
    units = {**UNITS, "s0_on_ground": both.light_unit}
    products.write(STAGE, arrays, settings=stored, inputs=inputs, units=units)
    return result


def _large_enough(
    bodies: Mapping[str, NDArray[np.bool_]], fused: NDArray[np.bool_], classifier: Classifier, notes: list[str]
) -> dict[str, NDArray[np.bool_]]:
    """Kinds of bodies of which enough pixels are fused to say something."""
    kept, small = {}, []
    for name, mask in bodies.items():
        parts = [np.count_nonzero(part) for part in halves(mask & fused)]
        if sum(parts) < LEAST_BODY or (classifier in LEARNT and min(parts) < LEAST_BODY // 4):
            small.append(f"{name} ({sum(parts)})")
        else:
            kept[name] = mask
    if small:
        notes.append(f"of these bodies too few pixels are fused to compare them: {', '.join(small)}")
    return kept


def _anomalies(features: Floats, notes: list[str]) -> Floats:
    try:
        samples = features.reshape(len(features), -1).T
        return reed_xiaoli(features, class_statistics(samples, "all fused pixels", singular="regularize"))
    except DataError as error:
        notes.append(f"no anomaly map: {error}")
        return np.full(features.shape[1:], np.nan)
