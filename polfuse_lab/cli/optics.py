"""``polfuse optics``: polarizer frames to Stokes parameters, DOLP and AOP."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


@guarded
def optics(
    session: Annotated[Path, typer.Argument(help="Session with a polarizer series.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Products file; other stages in it are kept.")],
    figure: Annotated[Path | None, typer.Option(help="Picture to draw; beside the products file by default.")] = None,
    zero_sd_deg: Annotated[
        float, typer.Option(min=0.0, help="How well the polarizer's zero mark is known, degrees (sd).")
    ] = 0.5,
    intensity_stability: Annotated[
        float, typer.Option(min=0.0, help="Relative sd of light and exposure between polarizer angles.")
    ] = 1e-3,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Turn a session's polarizer frames into Stokes parameters, DOLP and AOP, with their errors.

    Example: polfuse optics run.h5 -o products.h5
    """
    import math

    from polfuse_lab.products import optics as stage

    made = stage.optics(
        session,
        output,
        figure=figure or output.with_name(f"{output.stem}_optics.png"),
        zero_sd_rad=math.radians(zero_sd_deg),
        intensity_stability=intensity_stability,
    )
    angles = [math.degrees(angle) for angle in made.series.angles_rad]
    values = {
        "products": made.products,
        "dolp_median": made.dolp_median,
        "masked_fraction": made.masked_fraction,
        "figure": made.figure,
        "angles_deg": angles,
        "frames": made.frames,
        "incomplete_frames": made.incomplete_frames,
        "condition_number": made.series.condition,
    }
    text = (
        f"{made.frames} frames at {len(angles)} polarizer angles\n"
        f"median DOLP {made.dolp_median:.4f}, {100 * made.masked_fraction:.2f} % of the pixels masked\n"
        f"products: {made.products}\nfigure:   {made.figure}"
    )
    result(values, as_json=json_, text=text)
