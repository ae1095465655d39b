"""``polfuse fuse``: registration, fused vector, classes, separability, anomalies."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


class Start(StrEnum):
    """Where K-means begins."""

    plus_plus = "k-means++"
    even = "even"


class Method(StrEnum):
    """How classes are found."""

    kmeans = "kmeans"
    isodata = "isodata"
    mixture = "mixture"
    likelihood = "likelihood"
    svm = "svm"
    forest = "forest"


class Normalization(StrEnum):
    """What Pauli components are divided by."""

    pixel = "pixel"
    scene = "scene"


@guarded
def fuse(
    products: Annotated[Path, typer.Argument(help="Products file, calibrated and with optics, or simulated.")],
    regions: Annotated[
        Path | None, typer.Option(help="Regions file: [[region]] with name and polygon_m = [[x, y], ...].")
    ] = None,
    classifier: Annotated[
        Method,
        typer.Option(
            help="Found without knowing any: kmeans, isodata, mixture. Learnt from --regions or a simulation: others."
        ),
    ] = Method.kmeans,
    classes: Annotated[
        int, typer.Option(min=1, max=100, help="kmeans: classes; isodata: to begin with; mixture: at most.")
    ] = 3,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the classifier.")] = 0,
    start: Annotated[Start, typer.Option(help="Start of K-means; the thesis: even.")] = Start.plus_plus,
    min_snr_db: Annotated[float, typer.Option(help="Least span over noise of a radar pixel, dB.")] = 6.0,
    dynamic_range_db: Annotated[
        float, typer.Option(min=0.0, help="Leave out pixels this far below the brightest (side lobes), dB.")
    ] = 30.0,
    normalization: Annotated[
        Normalization, typer.Option(help="Pauli components over their own pixel's norm, or over the scene's largest.")
    ] = Normalization.pixel,
    angle_sd_deg: Annotated[float, typer.Option(min=0.0, help="Error of the camera's direction, degrees (sd).")] = 1.0,
    height_sd_m: Annotated[float, typer.Option(min=0.0, help="Height of scatterers above ground, metres (sd).")] = 0.3,
    refine: Annotated[
        bool, typer.Option("--refine", help="Correct the registration by what both pictures have in common.")
    ] = False,
    heights: Annotated[
        Path | None,
        typer.Option(help="Map of the ground's heights, as for 'focus --heights'; .npz may hold their sd_m too."),
    ] = None,
    camera: Annotated[
        Path | None, typer.Option(help="Products file of 'polfuse optics BOARDS --as camera': the camera's lens.")
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(help="Chooses lines or splines between the camera's pixels: dB, or preview, field, paper."),
    ] = None,
    explain: Annotated[bool, typer.Option("--explain", help="Tell why; with --tolerance.")] = False,
    figure: Annotated[Path | None, typer.Option(help="Picture to draw; beside the products file by default.")] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Put camera and radar on one grid, stack the fused vector, find classes and how well they can be told apart.

    A simulation's pictures share a grid, and its kinds of bodies stand for regions where no file of them is given.

    Example: polfuse fuse products.h5 --regions regions.toml
    """
    import math

    from polfuse_lab.products import fuse as stage
    from polfuse_lab.products.figures_fusion import draw_all
    from polfuse_lab.products.store import Products
    from polfuse_lab.tolerances import as_db

    made = stage.fuse(
        products,
        regions=regions,
        classifier=classifier.value,
        classes=classes,
        seed=seed,
        start=start.value,
        min_snr_db=min_snr_db,
        dynamic_range_db=dynamic_range_db,
        normalization=normalization.value,
        angle_sd_rad=math.radians(angle_sd_deg),
        height_sd_m=height_sd_m,
        refine=refine,
        heights=heights,
        camera=camera,
        tolerance_db=None if tolerance is None else as_db(tolerance, "picture"),
    )
    figures = draw_all(Products(products), figure or products.with_name(f"{products.stem}_fusion.png"))
    values = {
        "bhattacharyya": {pair: item.distance["pauli_dolp"] for pair, item in made.pairs.items()},
        "bhattacharyya_by_bands": {pair: item.distance for pair, item in made.pairs.items()},
        "bayes_bounds": {pair: list(item.bounds) for pair, item in made.pairs.items()},
        "jeffries_matusita": {pair: item.jeffries_matusita for pair, item in made.pairs.items()},
        "classes": {name: vars(item) for name, item in made.classes.items()},
        "regions": {name: vars(item) for name, item in made.regions.items()},
        "confusion": made.confusion,
        "figure": figures[0],
        "figures": figures,
        "pixels": made.pixels,
        "iterations": made.iterations,
        "registration": made.registration,
        "registration_error_px": made.registration_error_px,
        "registration_shift_px": None if made.shift is None else [made.shift.right_px, made.shift.down_px],
        "explanation": [] if made.resampling is None else made.resampling.explain(),
        "notes": list(made.notes),
        "products": made.products,
    }
    registered = (
        "on the simulation's own grid"
        if made.registration == "identity"
        else f"registered to {made.registration_error_px:.1f} px (median sd)"
    )
    lines = [f"{made.pixels} pixels fused, {registered}"]
    for name, item in {**made.classes, **made.regions}.items():
        lines.append(
            f"{name}: {item.pixels} pixels ({100 * item.fraction:.1f} %), {item.mechanism}, "
            f"DOLP {item.mean['DOLP']:.3f}"
        )
    for pair, separability in made.pairs.items():
        lines.append(
            f"{pair}: Bhattacharyya {separability.distance['pauli']:.2f} by radar alone, "
            f"{separability.distance['pauli_dolp']:.2f} with DOLP; Bayes error "
            f"{separability.bounds.lower:.2g} to {separability.bounds.upper:.2g}"
        )
    if made.confusion is not None:
        judged = made.confusion
        lines.append(
            f"{classifier.value}: {100 * judged['accuracy']:.1f} % right (+- {100 * judged['accuracy_sd']:.1f}) of "
            f"{sum(map(sum, judged['counts']))} pixels that were not learnt from, kappa {judged['kappa']:.2f}"
        )
    lines += made.resampling.explain() if made.resampling is not None and explain else []
    lines += [f"note: {note}" for note in made.notes]
    lines += [f"figure:   {path}" for path in figures]
    result(values, as_json=json_, text="\n".join([*lines, f"products: {made.products}"]))
