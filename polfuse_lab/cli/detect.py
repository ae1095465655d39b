"""``polfuse detect``: targets in a polarimetric image at a constant rate of false alarms."""

from __future__ import annotations

from dataclasses import asdict
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result

SHOWN = 10
"""Detections in the text for people."""


class PowerName(StrEnum):
    """What is compared with its surroundings."""

    span = "span"
    whitened = "whitened"
    matched = "matched"


class TargetName(StrEnum):
    """Targets of the matched filter."""

    trihedral = "trihedral"
    dihedral = "dihedral"
    dihedral_45 = "dihedral_45"
    dipole_h = "dipole_h"
    dipole_v = "dipole_v"
    left_helix = "left_helix"
    right_helix = "right_helix"


class CfarName(StrEnum):
    """Kinds of threshold."""

    ca = "ca"
    os = "os"


@guarded
def detect(
    products: Annotated[Path, typer.Argument(help="Products file, calibrated or imported from PolSARpro.")],
    power: Annotated[
        PowerName, typer.Option(help="span, whitened (least speckle) or matched (to a target).")
    ] = PowerName.whitened,
    target: Annotated[TargetName, typer.Option(help="matched: what is looked for.")] = TargetName.trihedral,
    cfar: Annotated[
        CfarName, typer.Option(help="ca: mean of the ring; os: its ordered value, beside edges and other targets.")
    ] = CfarName.ca,
    false_alarm: Annotated[float, typer.Option(help="Probability that a pixel of clutter is detected.")] = 1e-6,
    window: Annotated[int, typer.Option(min=5, help="Odd outer width of the ring of clutter, pixels.")] = 21,
    guard: Annotated[int, typer.Option(min=1, help="Odd width of its middle that is left out, pixels.")] = 9,
    looks: Annotated[
        float | None, typer.Option(min=0.1, help="Equivalent looks of the power; 1 of S2 (whitened 3), else estimated.")
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Picture to draw; beside the products file if left out.")] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Detect targets in a polarimetric image: pixels above thresholds that clutter passes as rarely as told.

    Example: polfuse detect products.h5 --power matched --target dihedral --false-alarm 1e-6
    """
    from polfuse_lab.products import detect as stage
    from polfuse_lab.products.store import Products
    from polfuse_lab.products.style import save
    from processing.polarimetry.detection.cfar import Ring

    made = stage.detect(
        products, power=power.value, target=target.value, kind=cfar.value, false_alarm=false_alarm,
        ring=Ring(window, guard), looks=looks,
    )  # fmt: skip
    picture = figure or products.parent / f"{products.stem}_detection.png"
    drawn = save(stage.detection_figure(Products(products)), picture)
    values = {
        "detections": [asdict(found) for found in made.detections],
        "count": made.count,
        "pixels": made.pixels,
        "expected_false_pixels": made.expected_false_pixels,
        "looks": made.looks,
        "note": made.note,
        "files": [drawn],
        "products": made.products,
    }
    lines = [
        f"{made.count} detections ({made.pixels} pixels; clutter alone would give {made.expected_false_pixels:.2g})",
        *(
            f"  {_place(found.x_m, found.y_m, found.row, found.column)}: {found.over_threshold_db:.1f} dB above, "
            f"{found.pixels} pixels"
            for found in made.detections[:SHOWN]
        ),
        *([f"  and {made.count - SHOWN} more"] if made.count > SHOWN else []),
        *([f"note: {made.note}"] if made.note else []),
        f"figure:   {drawn}",
        f"products: {made.products}",
    ]
    result(values, as_json=json_, text="\n".join(lines))


def _place(x_m: float | None, y_m: float | None, row: int, column: int) -> str:
    return f"row {row}, column {column}" if x_m is None or y_m is None else f"x = {x_m:+.2f} m, y = {y_m:.2f} m"
