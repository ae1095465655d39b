"""``polfuse calibrate``: image amplitudes to RCS, crosstalk and imbalance."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result

if TYPE_CHECKING:
    from polfuse_lab.products.calibrate import TargetSpec


class TargetKind(StrEnum):
    """Reflectors to calibrate on."""

    trihedral = "trihedral"
    plate = "plate"


class CheckKind(StrEnum):
    """Reflectors to measure with the calibration."""

    trihedral = "trihedral"
    plate = "plate"
    dihedral = "dihedral"


class Mode(StrEnum):
    """How power becomes RCS."""

    offset = "offset"
    thesis = "thesis"


@guarded
def calibrate(
    products: Annotated[Path, typer.Argument(help="Products file with a focused image.")],
    target: Annotated[TargetKind, typer.Option(help="What to calibrate on (square faces).")],
    at: Annotated[str, typer.Option(metavar="X,Y", help="Its place: x along the rail, ground range y, metres.")],
    edge_m: Annotated[float, typer.Option(help="Edge of its faces, metres.")] = 0.61,
    azimuth_deg: Annotated[
        float | None, typer.Option(help="Azimuth of the aperture's centre in its frame, deg [trihedral: 45, plate: 0].")
    ] = None,
    elevation_deg: Annotated[
        float | None, typer.Option(help="Elevation likewise, degrees [trihedral: 35.264, plate: 0].")
    ] = None,
    height_m: Annotated[float, typer.Option(help="Height of its apex (face's centre) above the ground, metres.")] = 0.0,
    angle_sd_deg: Annotated[
        float, typer.Option(min=0.0, help="How well those angles are known, degrees (sd); the thesis: 5.")
    ] = 0.0,
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
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Turn focused amplitudes into RCS with a reflector of known size, and tell crosstalk and imbalance.

    Example: polfuse calibrate products.h5 --target trihedral --at 0,8 --edge-m 0.61 --check dihedral --check-at 2,9
    """
    if check is not None and check_at is None:
        raise typer.BadParameter("give the place of the second reflector", param_hint="--check-at")
    if check is None and check_at is not None:
        raise typer.BadParameter("say what the second reflector is", param_hint="--check")
    place, check_place = _place(at, "--at"), None if check_at is None else _place(check_at, "--check-at")
    from polfuse_lab.products import calibrate as stage

    spec = _spec(target.value, place, edge_m, azimuth_deg, elevation_deg, 0.0, height_m, angle_sd_deg)
    check_spec = None
    if check is not None and check_place is not None:
        check_spec = _spec(
            check.value,
            check_place,
            check_edge_m or edge_m,
            check_azimuth_deg,
            check_elevation_deg,
            check_fold_deg,
            check_height_m,
            0.0,
        )
    made = stage.calibrate(
        products,
        spec,
        sky=sky,
        check=check_spec,
        mode=mode.value,
        search_radius_m=search_radius_m,
        min_snr_db=min_snr_db,
        reference=reference,
    )
    values: dict[str, object] = {
        "constant_db": made.constant_db,
        "constant_sd_db": made.constant_sd_db,
        "crosstalk_db": made.worst_crosstalk_db,
        "crosstalk_by_channel_db": made.crosstalk_db,
        "imbalance_db": made.imbalance_db,
        "imbalance_deg": made.imbalance_deg,
        "cross_imbalance_known": made.cross_imbalance is not None,
        "slope": made.slope,
        "target": {
            "x_m": made.target.x_m,
            "y_m": made.target.y_m,
            "snr_db": made.target.snr_db,
            "expected_dbsm": made.expected_dbsm,
        },
        "noise_equivalent_dbsm": made.noise_equivalent_dbsm,
        "noise_source": made.noise_source,
        "check": None,
        "products": made.products,
    }
    lines = [
        f"{target.value} at ({made.target.x_m:.2f}, {made.target.y_m:.2f}) m, {made.target.snr_db:.1f} dB above the "
        f"background, expected {made.expected_dbsm:.2f} dBsm",
        f"constant {made.constant_db:.2f} +- {made.constant_sd_db:.2f} dB, noise-equivalent RCS there "
        f"{made.noise_equivalent_dbsm:.1f} dBsm ({made.noise_source})",
        f"VV over HH {made.imbalance_db:+.2f} dB {made.imbalance_deg:+.1f} deg, crosstalk "
        + (", ".join(f"{name} {value:.1f} dB" for name, value in made.crosstalk_db.items()) or "not measured"),
    ]
    if made.cross_imbalance is None:
        lines.append("no reciprocal cross-polarized target: receive and transmit imbalance are taken as alike")
    if made.check is not None:
        values["check"] = {
            "rcs_dbsm": made.check.rcs_dbsm,
            "expected_dbsm": made.check.expected_dbsm,
            "error_db": made.check.error_db,
            "thesis_accuracy_percent": made.check.thesis_accuracy_percent,
            "sd_db": made.check.sd_db,
            "channel": made.check.channel,
            "x_m": made.check.x_m,
            "y_m": made.check.y_m,
        }
        lines.append(
            f"check: {made.check.rcs_dbsm:.2f} dBsm in {made.check.channel}, expected {made.check.expected_dbsm:.2f}: "
            f"{made.check.error_db:+.2f} +- {made.check.sd_db:.2f} dB "
            f"({made.check.thesis_accuracy_percent:.2f} % in the thesis's measure)"
        )
    lines.append(f"products: {made.products}")
    result(values, as_json=json_, text="\n".join(lines))


def _place(text: str, option: str) -> tuple[float, float]:
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(f"{text!r} is not X,Y, two numbers in metres", param_hint=option) from None
    return x, y


def _spec(
    kind: str,
    place: tuple[float, float],
    edge_m: float,
    azimuth_deg: float | None,
    elevation_deg: float | None,
    fold_deg: float,
    height_m: float,
    angle_sd_deg: float,
) -> TargetSpec:
    from math import radians

    from polfuse_lab.products.calibrate import TargetSpec
    from processing.calibration.rcs import TRIHEDRAL_AXIS_ELEVATION_RAD

    corner = kind == "trihedral"
    azimuth = radians(45.0 if corner else 0.0) if azimuth_deg is None else radians(azimuth_deg)
    elevation = TRIHEDRAL_AXIS_ELEVATION_RAD if corner else 0.0
    return TargetSpec(
        kind=kind,
        x_m=place[0],
        y_m=place[1],
        edge_m=edge_m,
        azimuth_rad=azimuth,
        elevation_rad=elevation if elevation_deg is None else radians(elevation_deg),
        fold_rad=radians(fold_deg),
        height_m=height_m,
        angle_sd_rad=radians(angle_sd_deg),
    )
