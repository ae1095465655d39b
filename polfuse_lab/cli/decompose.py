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
        int | None, typer.Option(min=1, help="Odd width of the average, pixels (5; 1 for span, pauli, lexicographic).")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder for planes as PolSARpro writes them, and pictures.")
    ] = None,
    model: Annotated[ModelName, typer.Option(help="yamaguchi: variant.")] = ModelName.rotated,
    looks: Annotated[
        float | None, typer.Option(min=1.0, help="h-a-alpha: independent looks in an average (all pixels of it).")
    ] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Decompose a polarimetric image into what scatters: planes in the products file, pictures and PolSARpro files.

    Example: polfuse decompose products.h5 --method freeman --window 5 -o freeman
    """
    from polfuse_lab.products import decompose as stage
    from polfuse_lab.products.figures_decompose import draw_all
    from polfuse_lab.products.store import Products

    made = stage.decompose(
        products, method.value, window=window, model=model.value, looks=looks, folder=output
    )  # fmt: skip
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
        "products": made.products,
    }
    lines = [f"{'plane':<18}{'median':>12}{'min':>12}{'max':>12}"]
    for name, numbers in made.planes.items():
        shown = ("–" if number is None else f"{number:.4g}" for number in numbers.values())
        lines.append(f"{name:<18}" + "".join(f"{text:>12}" for text in shown))
    lines += [f"note: {made.note}"] if made.note else []
    lines += [f"figure:   {path}" for path in figures]
    lines += [f"planes:   {output} ({len(made.files)} files)"] if made.files else []
    result(values, as_json=json_, text="\n".join([*lines, f"products: {made.products}"]))
