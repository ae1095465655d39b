"""``polfuse simulate``: what radar and camera see of a scene of bodies."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, progress, result


@guarded
def simulate(
    scene: Annotated[Path, typer.Argument(help="Scene file (.toml) of bodies, flight, radar, camera, light and grid.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Products file; other stages in it are kept.")],
    figure: Annotated[Path | None, typer.Option(help="Picture of both eyes and the truth (.png, .pdf, .svg).")] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help="Largest error below each eye's picture: preview, field, paper, or dB; chooses bounces, rays and "
            "segments in place of the file's."
        ),
    ] = None,
    explain: Annotated[bool, typer.Option("--explain", help="Tell why so fine; with --tolerance.")] = False,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Simulate a scene in both eyes: a focused quad-polarized picture and polarized light on one ground grid.

    Example: polfuse simulate examples/scenes/yard.toml -o yard.h5 --figure yard.png
    """
    import time

    from polfuse_lab.simulation.simulate import planned
    from polfuse_lab.simulation.simulate import simulate as run
    from polfuse_lab.tolerances import as_db

    begun = told = time.monotonic()

    def tell(eye: str, done: float) -> None:
        nonlocal told
        if time.monotonic() - told > 2:
            told = time.monotonic()
            progress(f"{eye}: {100 * done:.0f} %")

    limit = None if tolerance is None else as_db(tolerance, "picture")
    made = run(scene, output, figure=figure, tolerance_db=limit, progress=tell)
    seen, left = made.radar.simulated, made.left_out
    rows, columns = made.grid.shape
    values = {
        "products": made.products,
        "figure": made.figure,
        "rows": rows,
        "cols": columns,
        "bodies": len(made.scene.solids),
        "rays": seen.rays,
        "footprints": seen.footprints,
        "segments": seen.segments,
        "noise_span_m2": made.radar.noise,
        "samples": made.optics.picture.samples,
        "trace_error": made.optics.picture.error,
        "left_out": left,
        "notes": list(made.notes),
        **planned(made),
        "seconds": time.monotonic() - begun,
    }
    lines = [
        f"{len(made.scene.solids)} bodies on {columns} x {rows} pixels",
        f"radar: {seen.rays} rays in {seen.segments} segments, up to {seen.footprints} footprints",
        f"light: {made.optics.picture.samples} samples, standard error {100 * made.optics.picture.error:.2g} % of S0",
        *(line for eye in planned(made).values() if explain for line in eye["explanation"]),
        f"left out: bounce {left.bounces + 1} at {left.next_bounce_db:.0f} dB, {100 * left.parted:.2g} % of the lit "
        f"area at edges, wavefronts bent by {left.wavefront_rad:.2g} rad within a footprint",
        f"not modelled: {', '.join(left.not_modelled)}",
        *(f"note: {note}" for note in made.notes),
        *([f"figure:   {made.figure}"] if made.figure else []),
        f"products: {made.products}",
    ]
    result(values, as_json=json_, text="\n".join(lines))
