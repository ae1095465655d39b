"""``polfuse calibrate``: image amplitudes to RCS, crosstalk and imbalance."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from math import radians
from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, progress, result


class TargetKind(StrEnum):
    """Reflectors to calibrate on."""

    trihedral = "trihedral"
    trihedral_triangular = "trihedral_triangular"
    plate = "plate"
    sphere = "sphere"


class CheckKind(StrEnum):
    """Reflectors to measure with the calibration."""

    trihedral = "trihedral"
    trihedral_triangular = "trihedral_triangular"
    plate = "plate"
    sphere = "sphere"
    dihedral = "dihedral"


class ClutterMethod(StrEnum):
    """How distributed targets tell crosstalk."""

    quegan = "quegan"
    ainsworth = "ainsworth"


class Mode(StrEnum):
    """How power becomes RCS."""

    offset = "offset"
    thesis = "thesis"


@guarded
def calibrate(
    products: Annotated[Path, typer.Argument(help="Products file with a focused image.")],
    target: Annotated[
        TargetKind | None, typer.Option(help="What to calibrate on (a trihedral without more words has square faces).")
    ] = None,
    at: Annotated[
        str | None, typer.Option(metavar="X,Y", help="Its place: x along the rail, ground range y, metres.")
    ] = None,
    edge_m: Annotated[float, typer.Option(help="Edge of its faces (a sphere's diameter), metres.")] = 0.61,
    azimuth_deg: Annotated[
        float | None, typer.Option(help="Azimuth of the aperture's centre in its frame, deg [trihedral: 45, plate: 0].")
    ] = None,
    elevation_deg: Annotated[
        float | None, typer.Option(help="Elevation likewise, degrees [trihedral: 35.264, plate: 0].")
    ] = None,
    height_m: Annotated[float, typer.Option(help="Height of its apex (face's centre) above the ground, metres.")] = 0.0,
    angle_sd_deg: Annotated[
        float, typer.Option(min=0.0, help="How well angles of targets are known, degrees (sd); the thesis: 5.")
    ] = 0.0,
    position_sd_m: Annotated[float, typer.Option(min=0.0, help="How well the target's place is known, m (sd).")] = 0.0,
    edge_sd_m: Annotated[float, typer.Option(min=0.0, help="How well its edge is known, m (sd).")] = 0.0,
    also: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND@X,Y[@EDGE[@HEIGHT]]",
            help="A further target in the image: dihedral (fold upright), dihedral_45, trihedral or plate.",
        ),
    ] = None,
    series: Annotated[
        Path | None,
        typer.Option(help="Session of a calibration series: takes imbalance and crosstalk from its targets."),
    ] = None,
    clutter: Annotated[
        str | None, typer.Option(metavar="X0,X1,Y0,Y1", help="Region of vegetation that tells the crosstalk, metres.")
    ] = None,
    clutter_method: Annotated[
        ClutterMethod, typer.Option(help="quegan: vegetation without slope; ainsworth: any reciprocal scatterers.")
    ] = ClutterMethod.quegan,
    phase_sd_deg: Annotated[
        float, typer.Option(min=0.0, help="Phase noise between channels recorded one after the other, degrees (sd).")
    ] = 0.0,
    shift_sd_m: Annotated[
        float, typer.Option(min=0.0, help="How well the trolley comes back to a place for another channel, m (sd).")
    ] = 0.0,
    walk: Annotated[bool, typer.Option("--walk", help="Ask for the targets one after the other.")] = False,
    sky: Annotated[Path | None, typer.Option(help="Session of a look at the clear sky, for the noise.")] = None,
    check: Annotated[CheckKind | None, typer.Option(help="A second reflector to measure.")] = None,
    check_at: Annotated[str | None, typer.Option(metavar="X,Y", help="Its place, metres.")] = None,
    check_edge_m: Annotated[float | None, typer.Option(help="Its edge, metres [as the target's].")] = None,
    check_azimuth_deg: Annotated[
        float | None, typer.Option(help="Its azimuth, degrees [trihedral: 45, else 0: on its boresight].")
    ] = None,
    check_elevation_deg: Annotated[
        float | None, typer.Option(help="Its elevation, degrees [trihedral: 35.264, else 0].")
    ] = None,
    check_fold_deg: Annotated[float, typer.Option(help="Angle of a dihedral's fold from horizontal, degrees.")] = 0.0,
    check_height_m: Annotated[float, typer.Option(help="Height of its phase centre above the ground, metres.")] = 0.0,
    reference: Annotated[
        Path | None,
        typer.Option(help="Products file of the target by itself ('polfuse focus SERIES.h5 --target NAME')."),
    ] = None,
    mode: Annotated[
        Mode, typer.Option(help="offset: one constant (RCS is proportional to power); thesis: line through the noise.")
    ] = Mode.offset,
    search_radius_m: Annotated[float, typer.Option(min=0.01, help="How far from its place a peak may be, m.")] = 1.0,
    min_snr_db: Annotated[float, typer.Option(help="Least peak over background, dB.")] = 10.0,
    near_field: Annotated[
        bool,
        typer.Option(
            "--near-field", help="Expect what physical optics gives at the targets' distance, not closed forms."
        ),
    ] = False,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Turn focused amplitudes into RCS with reflectors of known size, and take imbalance and crosstalk off.

    One trihedral gives the constant and the imbalance; with a dihedral and one turned by 45 degrees (in the image:
    --also, or in a session of a calibration series: --series) the crosstalk is taken off as well. Each target is judged
    first, and a bad one is refused with the reason. With --walk the targets are asked for one by one.

    Example: polfuse calibrate products.h5 --target trihedral --at 0,8 --edge-m 0.61 --check dihedral --check-at 2,9
    """
    from polfuse_lab.cli import calibration_options as options

    if check is not None and check_at is None:
        raise typer.BadParameter("give the place of the second reflector", param_hint="--check-at")
    if check is None and check_at is not None:
        raise typer.BadParameter("say what the second reflector is", param_hint="--check")
    if (target is None) != (at is None):
        raise typer.BadParameter(
            "give a target and its place together", param_hint="--at" if at is None else "--target"
        )
    if target is None and series is None and not walk:
        raise typer.BadParameter(
            "say what to calibrate on: --target and --at, or --series, or --walk to be asked", param_hint="--target"
        )
    check_place = None if check_at is None else options.place(check_at, "--check-at")
    stated = None
    if target is not None and at is not None:
        stated = options.spec(
            target.value,
            options.place(at, "--at"),
            edge_m,
            azimuth_deg=azimuth_deg,
            elevation_deg=elevation_deg,
            height_m=height_m,
            angle_sd_deg=angle_sd_deg,
            position_sd_m=position_sd_m,
            edge_sd_m=edge_sd_m,
        )
    others = [options.further(text, edge_m, height_m, angle_sd_deg) for text in also or ()]
    if walk:
        from polfuse_lab.cli.calibration_walk import walk as ask

        asked = ask(products, radius_m=search_radius_m, min_snr_db=min_snr_db)
        stated, others = asked[0], asked[1:]
    check_spec = None
    if check is not None and check_place is not None:
        check_spec = options.spec(
            check.value,
            check_place,
            check_edge_m or edge_m,
            azimuth_deg=check_azimuth_deg,
            elevation_deg=check_elevation_deg,
            fold_deg=check_fold_deg,
            height_m=check_height_m,
        )
    if near_field:
        stated = stated and replace(stated, near_field=True)
        others = [replace(item, near_field=True) for item in others]
        check_spec = check_spec and replace(check_spec, near_field=True)
    from polfuse_lab.products import calibrate as stage

    made = stage.calibrate(
        products,
        stated,
        targets=others,
        series=series,
        clutter=None if clutter is None else options.region(clutter, clutter_method.value),
        sky=sky,
        check=check_spec,
        mode=mode.value,
        search_radius_m=search_radius_m,
        min_snr_db=min_snr_db,
        reference=reference,
        phase_sd_rad=radians(phase_sd_deg),
        shift_sd_m=shift_sd_m,
        near_field=near_field,
        on_target=lambda view: progress(options.told(view)),
    )
    from polfuse_lab.cli.calibration_told import lines, values

    result(values(made), as_json=json_, text="\n".join(lines(made)))
