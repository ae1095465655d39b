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
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Simulate what a camera sees of a scene: Stokes parameters, DOLP and AOP with their errors (thesis chapter 4).

    Example: polfuse raytrace fig_4_13 -o products.h5
    """
    import time

    from polfuse_lab.raytrace.simulate import simulate

    begun, told = time.monotonic(), 0.0

    def tell(done: float) -> None:
        nonlocal told
        now = time.monotonic() - begun
        if now - told > 2 and done > 0:
            told = now
            progress(f"{100 * done:.0f} %, about {now / done * (1 - done):.0f} s to go")

    made = simulate(scene, output, figures=figures or output.parent, progress=tell)
    picture = made.picture
    values = {
        "products": made.products,
        "figures": list(made.figures),
        "samples": picture.samples,
        "rays": picture.rays,
        "seconds": picture.seconds,
        "rays_per_second": picture.rays / max(picture.seconds, 1e-9),
        "error": picture.error,
        "left_out": [{"bounce": p.bounce, "source": p.source, "error": p.error} for p in picture.left_out],
        "notes": list(made.notes),
    }
    lines = [
        f"{picture.samples} samples, {picture.rays} rays in {picture.seconds:.2f} s, "
        f"standard error {100 * picture.error:.3g} % of the mean S0",
        *(f"note: {note}" for note in made.notes),
    ]
    if picture.left_out:
        sure = sum(part.error for part in picture.left_out)
        lines.append(
            f"left out: {len(picture.left_out)} of the pairs of source and bounces, together below {100 * sure:.2g} %"
        )
    lines += [f"products: {made.products}", *(f"figure:   {figure}" for figure in made.figures)]
    result(values, as_json=json_, text="\n".join(lines))
