"""``polfuse raytrace``: simulated polarization pictures of a scene file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, progress, result


@guarded
def raytrace(
    scene: Annotated[str, typer.Argument(help="Scene file (.toml), or the name of one that comes with the program.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Products file; other stages in it are kept.")],
    figures: Annotated[Path | None, typer.Option(help="Folder for pictures; beside the products by default.")] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help="Largest error below the picture: preview, field, paper, or dB; chooses rays and bounces in place of "
            "the scene's."
        ),
    ] = None,
    explain: Annotated[
        bool, typer.Option("--explain", help="Tell why so many rays and bounces; with --tolerance.")
    ] = False,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Simulate what a camera sees of a scene: Stokes parameters, DOLP and AOP with their errors (thesis chapter 4).

    Example: polfuse raytrace fig_4_13 -o products.h5 --tolerance field --explain
    """
    import time
    from dataclasses import asdict

    from polfuse_lab.raytrace.simulate import simulate, told
    from polfuse_lab.tolerances import as_db

    begun, shown = time.monotonic(), 0.0

    def tell(done: float) -> None:
        nonlocal shown
        now = time.monotonic() - begun
        if now - shown > 2 and done > 0:
            shown = now
            progress(f"{100 * done:.0f} %, about {now / done * (1 - done):.0f} s to go")

    limit = None if tolerance is None else as_db(tolerance, "picture")
    made = simulate(scene, output, figures=figures or output.parent, tolerance_db=limit, progress=tell)
    picture, plan = made.picture, made.plan
    values = {
        "products": made.products,
        "figures": list(made.figures),
        "samples": picture.samples,
        "rays": picture.rays,
        "seconds": picture.seconds,
        "rays_per_second": picture.rays / max(picture.seconds, 1e-9),
        "error": picture.error,
        "left_out": [asdict(part) for part in picture.left_out],
        **({} if plan is None else told(plan)),
        "notes": list(made.notes),
    }
    lines = [
        f"{picture.samples} samples, {picture.rays} rays in {picture.seconds:.2f} s, "
        f"standard error {100 * picture.error:.3g} % of the mean S0",
        *(f"note: {note}" for note in made.notes),
    ]
    if explain and plan is not None:
        lines += plan.explain()
    met = [part.error for part in picture.left_out if part.met]
    if met:
        lines.append(f"left out: {len(met)} of the pairs of source and bounces, together below {100 * sum(met):.2g} %")
    unmet = [part for part in picture.left_out if not part.met]
    if unmet:
        lines.append(f"{len(unmet)} pairs of source and bounces were {unmet[0].words()} each")
    lines += [f"products: {made.products}", *(f"figure:   {figure}" for figure in made.figures)]
    result(values, as_json=json_, text="\n".join(lines))
