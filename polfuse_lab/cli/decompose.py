"""``polfuse decompose``: what scatters in each pixel of a polarimetric image."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


class MethodName(StrEnum):
    """Decompositions."""

    span = "span"
    pauli = "pauli"
    lexicographic = "lexicographic"
    krogager = "krogager"
    cameron = "cameron"
    freeman = "freeman"
    yamaguchi = "yamaguchi"
    h_a_alpha = "h-a-alpha"
    touzi = "touzi"
    kennaugh = "kennaugh"
    zones = "zones"
    wishart = "wishart"
    whitening = "whitening"
    signature = "signature"


class FilterName(StrEnum):
    """Speckle filters."""

    boxcar = "boxcar"
    refined_lee = "refined-lee"
    nlm = "nlm"


class ModelName(StrEnum):
    """Variants of Yamaguchi's decomposition."""

    original = "original"
    rotated = "rotated"
    extended = "extended"


@guarded
def decompose(
    products: Annotated[Path, typer.Argument(help="Products file, calibrated or imported from PolSARpro.")],
    method: Annotated[MethodName, typer.Option("--method", "-m", help="What to compute.")],
    window: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Odd width of the average, pixels (5; 1 for span, pauli, lexicographic; refined-lee 7, nlm 15).",
        ),
    ] = None,
    filter_: Annotated[
        FilterName | None, typer.Option("--filter", help="How speckle is averaged: boxcar, refined-lee, nlm.")
    ] = None,
    filter_looks: Annotated[
        float | None,
        typer.Option(min=0.1, help="refined-lee, nlm: looks before the filter (1 of S2, else estimated)."),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for planes as PolSARpro writes them, and pictures.")
    ] = None,
    model: Annotated[ModelName, typer.Option(help="yamaguchi: variant.")] = ModelName.rotated,
    looks: Annotated[
        float | None, typer.Option(min=1.0, help="h-a-alpha: independent looks in an average (all pixels of it).")
    ] = None,
    region: Annotated[
        str | None,
        typer.Option(help="signature: FROM_X,TO_X,FROM_Y,TO_Y, m (columns and rows of imported images); all of it."),
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(help="Chooses the window: largest error that speckle may leave, dB, or preview, field, paper."),
    ] = None,
    explain: Annotated[bool, typer.Option("--explain", help="Tell why this window; with --tolerance.")] = False,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Decompose a polarimetric image into what scatters: planes in the products file, pictures and PolSARpro files.

    Example: polfuse decompose products.h5 --method freeman --filter refined-lee --window 7 -o freeman
    """
    place = None if region is None else _region(region)
    from polfuse_lab.products import decompose as stage
    from polfuse_lab.products.figures_decompose import draw_all
    from polfuse_lab.products.store import Products
    from polfuse_lab.tolerances import as_db

    made = stage.decompose(
        products,
        method.value,
        window=window,
        model=model.value,
        looks=looks,
        folder=output,
        speckle_filter=filter_ and filter_.value,
        filter_looks=filter_looks,
        region=place,
        tolerance_db=None if tolerance is None else as_db(tolerance, "estimate"),
    )
    beside = products.parent if output is None else output
    figures = draw_all(Products(products), made.stage, beside / f"{products.stem}_{made.stage.split('_', 1)[1]}.png")
    files = [*made.files, *figures]
    values = {
        "planes": made.planes,
        "files": files,
        "method": method.value,
        "stage": made.stage,
        "window": made.window,
        "note": made.note,
        "explanation": list(made.explanation),
        "products": made.products,
    }
    lines = [f"{'plane':<18}{'median':>12}{'min':>12}{'max':>12}"]
    for name, numbers in made.planes.items():
        shown = ("–" if number is None else f"{number:.4g}" for number in numbers.values())
        lines.append(f"{name:<18}" + "".join(f"{text:>12}" for text in shown))
    lines += [f"note: {made.note}"] if made.note else []
    lines += made.explanation if explain else []
    lines += [f"figure:   {path}" for path in figures]
    lines += [f"planes:   {output} ({len(made.files)} files)"] if made.files else []
    result(values, as_json=json_, text="\n".join([*lines, f"products: {made.products}"]))


def _region(text: str) -> tuple[float, float, float, float]:
    try:
        first_x, last_x, first_y, last_y = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not four numbers with commas", param_hint="--region") from None
    if not (first_x <= last_x and first_y <= last_y):
        raise typer.BadParameter("must be FROM_X,TO_X,FROM_Y,TO_Y, each from less to more", param_hint="--region")
    return first_x, last_x, first_y, last_y
