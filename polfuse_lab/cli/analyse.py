"""``polfuse analyse``: the thesis's analysis of a calibration target."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


@guarded
def analyse(
    products: Annotated[Path, typer.Argument(help="Products file with a focused image, calibrated or not.")],
    repeats: Annotated[
        list[Path] | None, typer.Argument(help="Products files of further measurements of the same target.")
    ] = None,
    at: Annotated[
        str | None, typer.Option(metavar="X,Y", help="Place of the target in the image, m [the calibration target's].")
    ] = None,
    sky: Annotated[Path | None, typer.Option(help="Session of a look at the clear sky, for the noise.")] = None,
    strip_m: Annotated[
        float, typer.Option(min=0.01, help="Width of the strip across range, m (thesis: 2 ft).")
    ] = 0.6096,
    region_m: Annotated[float, typer.Option(min=0.01, help="Edge of the region, m (thesis: 2 ft).")] = 0.6096,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Folder for the pictures.")] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Look at a target as the thesis does: power and RCS against range, and its matrix relative to HH.

    Example: polfuse analyse products.h5 second.h5 third.h5 fourth.h5 --sky sky.h5 -o pictures
    """
    place = None
    if at is not None:
        try:
            x, y = (float(part) for part in at.split(","))
        except ValueError:
            raise typer.BadParameter(f"{at!r} is not X,Y, two numbers in metres", param_hint="--at") from None
        place = x, y
    from polfuse_lab.products.analysis import analyse as stage

    made = stage(products, place, repeats=repeats or (), sky=sky, strip_m=strip_m, region_m=region_m)
    figures: list[Path] = []
    if output is not None:
        from polfuse_lab.products import style
        from polfuse_lab.products.figures_analysis import figures_of
        from polfuse_lab.products.store import Products

        store = Products(products)
        drawn = figures_of(store.read("analysis"), store.settings("analysis"))
        figures = [style.save(figure, output / f"{name}.png") for name, figure in drawn.items()]
    values = {
        "products": made.products,
        "place_m": made.place_m,
        "repeats": made.power.count,
        "calibrated": made.calibrated,
        "peaks": made.peaks,
        "matrix_power": made.matrices.power,
        "matrix_complex": made.matrices.complex,
        "matrix_coherence": made.matrices.coherence,
        "near_field": made.near_field,
        "figures": figures,
    }
    lines = [f"target at x = {made.place_m[0]:+.2f} m, y = {made.place_m[1]:.2f} m, mean of {made.power.count}"]
    for name, peak in made.peaks.items():
        rcs = f", {peak.rcs_dbsm:.2f} dBsm" if made.calibrated else ""
        spread = f" +- {peak.sd_db:.2f} dB" if made.power.count > 1 else ""
        lines.append(f"{name}: {peak.power_db:.2f} dB{rcs}{spread} at y = {peak.y_m:.2f} m")
    for label, matrix in (("received power", made.matrices.power), ("amplitude", abs(made.matrices.complex))):
        lines.append(f"{label} relative to HH: " + "; ".join(" ".join(f"{v:.3f}" for v in row) for row in matrix))
    if made.near_field is not None and made.near_field.distance_m < made.near_field.far_field_m:
        near = ", ".join(f"{name} {value:+.2f} dB" for name, value in made.near_field.correction_db.items())
        lines.append(
            f"the calibration target stands {made.near_field.distance_m:.2f} m away, its far field begins at "
            f"{made.near_field.far_field_m:.1f} m: it returns {near} of the closed form"
        )
    lines += [f"figure:   {path}" for path in figures]
    result(values, as_json=json_, text="\n".join(lines))
