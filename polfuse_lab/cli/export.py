"""``polfuse export``: products in the formats of other programs."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


class FormatName(StrEnum):
    """Formats of other programs."""

    geotiff = "geotiff"
    kmz = "kmz"
    png = "png"
    envi = "envi"
    polsarpro = "polsarpro"
    sicd = "sicd"
    cphd = "cphd"


@guarded
def export(
    products: Annotated[Path, typer.Argument(help="Products file.")],
    to: Annotated[
        FormatName,
        typer.Option(
            help="geotiff, kmz (Google Earth), png (with world file), envi, polsarpro (a folder), sicd (one file for "
            "each channel), cphd (phase history)."
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write; a folder for polsarpro.")],
    layer: Annotated[
        str | None,
        typer.Option(
            help="scattering, db, pauli, detection or a decomposition such as freeman (geotiff: db; envi: scattering; "
            "kmz and png: pauli)."
        ),
    ] = None,
    rig: Annotated[
        Path | None, typer.Option(help="Rig file with [site]; that of the focused session if left out.")
    ] = None,
    matrix: Annotated[str | None, typer.Option(help="polsarpro: S2, C3 or T3; as it is if left out.")] = None,
    channels: Annotated[str | None, typer.Option(help="sicd, cphd: such as HH,VV; all if left out.")] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Export products to other programs: maps, pictures, raw bands, PolSARpro folders, SICD and CPHD.

    Example: polfuse export products.h5 --to kmz -o overlay.kmz --rig rig.toml
    """
    from polfuse_lab.exports.formats import Request
    from polfuse_lab.exports.formats import export as write
    from polfuse_lab.products.store import Products

    chosen = tuple(part.strip().upper() for part in channels.split(",")) if channels else ()
    made = write(Request(Products(products), output, layer, rig, matrix, chosen), to.value)
    values = {"files": list(made.files), "format": to.value, "layer": made.layer, "note": made.note, **made.values}
    lines = [f"{name}: {value:.6g}" for name, value in made.values.items() if isinstance(value, float)]
    lines += [f"note: {made.note}"] if made.note else []
    result(values, as_json=json_, text="\n".join([*lines, *(f"file: {path}" for path in made.files)]))
