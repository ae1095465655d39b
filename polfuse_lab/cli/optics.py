"""``polfuse optics``: polarizer frames to Stokes parameters, DOLP and AOP, and the camera's own calibrations."""

from __future__ import annotations

import enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, progress, result

if TYPE_CHECKING:
    from polfuse_lab.products.optics import OpticsResult
    from polfuse_lab.products.optics_active import ActiveResult


class Make(enum.StrEnum):
    """What is made of the session."""

    stokes = "stokes"
    flat = "flat"
    linearity = "linearity"
    analyser = "analyser"
    camera = "camera"


class Register(enum.StrEnum):
    """Whether shifts between the images are undone."""

    off = "off"
    auto = "auto"
    on = "on"


class Demosaic(enum.StrEnum):
    """How images behind each angle are made of a mosaic."""

    bilinear = "bilinear"
    newton = "newton"
    residual = "residual"


@guarded
def optics(
    session: Annotated[
        Path,
        typer.Argument(help="Session with a polarizer series, or of the active mode; --as camera: folder of pictures."),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Products file; other stages in it are kept.")],
    figure: Annotated[Path | None, typer.Option(help="Picture to draw; beside the products file by default.")] = None,
    make: Annotated[
        Make, typer.Option("--as", help="Stokes parameters, or a calibration of the camera from this session.")
    ] = Make.stokes,
    board: Annotated[
        str, typer.Option(metavar="ROWSxCOLUMNS", help="--as camera: inner corners of the chessboard in the pictures.")
    ] = "6x9",
    rig: Annotated[
        Path | None, typer.Option(help="--as camera: rig file, to print the lines of its [camera] that change.")
    ] = None,
    correct: Annotated[
        Path | None, typer.Option(help="Products file with calibrations (flat, linearity, analyser, camera) to apply.")
    ] = None,
    register: Annotated[
        Register | None,
        typer.Option(
            help="Measure shifts between the images and undo them: where significant, or all; off by default."
        ),
    ] = None,
    demosaic: Annotated[
        Demosaic | None,
        typer.Option(help="For a mosaic: bilinear (fastest, the default), newton, or residual (least error)."),
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(
            help="Chooses the demosaicer, or how a turning polarizer's images are put in place: largest error of the "
            "images, dB, or preview, field, paper."
        ),
    ] = None,
    explain: Annotated[bool, typer.Option("--explain", help="Tell why that was chosen; with --tolerance.")] = False,
    region_px: Annotated[
        int | None, typer.Option(min=1, help="Calibrate analysers in regions of this many pixels; one by default.")
    ] = None,
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

    A session of the active mode (polarizers before source and camera) becomes the channels HH, HV, VH and VV instead.
    Pictures of a chessboard (--as camera) tell the lens: focal length, optical axis and distortion.

    Example: polfuse optics run.h5 -o products.h5 --correct camera.h5 --register auto
    """
    import math

    if make is Make.camera:
        _lens(session, output, board, rig, json_)
        return
    if make is not Make.stokes:
        _calibrate(session, output, make, region_px, json_)
        return
    drawing = figure or output.with_name(f"{output.stem}_optics.png")
    from polfuse_lab.products import optics as stage
    from polfuse_lab.products.optics_frames import camera_of, is_active
    from polfuse_lab.session import open_session
    from polfuse_lab.tolerances import as_db

    tolerance_db = None if tolerance is None else as_db(tolerance, "picture")
    with open_session(session) as opened:
        camera_of(opened)
        active = is_active(opened)
    if active:
        given = {"--tolerance": tolerance, "--register": register, "--demosaic": demosaic}
        for option in (name for name, value in given.items() if value is not None):
            raise typer.BadParameter("the active mode has nothing to choose", param_hint=option)
        from polfuse_lab.products.optics_active import active_optics

        values, text = _of_active(active_optics(session, output, figure=drawing, corrections=correct))
    else:
        made = stage.optics(
            session,
            output,
            figure=drawing,
            zero_sd_rad=math.radians(zero_sd_deg),
            intensity_stability=intensity_stability,
            corrections=correct,
            register=register and register.value,
            demosaic=demosaic and demosaic.value,
            tolerance_db=tolerance_db,
        )
        values, text = _of_series(made, explain)
    result(values, as_json=json_, text=text)


def _of_series(made: OpticsResult, explain: bool) -> tuple[dict[str, Any], str]:
    import math

    angles = [math.degrees(angle) for angle in made.series.angles_rad]
    shifts = [[shift.down, shift.right] for shift in made.shifts]
    values = {
        "products": made.products,
        "dolp_median": made.dolp_median,
        "masked_fraction": made.masked_fraction,
        "figure": made.figure,
        "composite": made.composite,
        "angles_deg": angles,
        "frames": made.frames,
        "incomplete_frames": made.incomplete_frames,
        "condition_number": made.series.condition,
        "shifts_px": shifts,
        "explanation": [] if made.choice is None else made.choice.explain(),
    }
    largest = f"largest shift between images {max(s.size for s in made.shifts):.3f} px\n" if made.shifts else ""
    why = "".join(f"{line}\n" for line in made.choice.explain()) if made.choice and explain else ""
    text = (
        f"{made.frames} frames at {len(angles)} polarizer angles\n"
        f"median DOLP {made.dolp_median:.4f}, {100 * made.masked_fraction:.2f} % of the pixels masked\n{largest}{why}"
        f"products: {made.products}\nfigure:   {made.figure}"
    )
    return values, text


def _of_active(made: ActiveResult) -> tuple[dict[str, Any], str]:
    import math

    values = {
        "products": made.products,
        "dolp_median": made.dolp_median,
        "masked_fraction": made.masked_fraction,
        "figure": made.figure,
        "source_angles_deg": [math.degrees(angle) for angle in made.source_rad],
        "angles_deg": [math.degrees(angle) for angle in made.sensor_rad],
        "frames": made.frames,
        "ambient_frames": made.ambient_frames,
    }
    text = (
        f"active mode: {made.frames} frames at {len(made.source_rad)} x {len(made.sensor_rad)} angles, "
        f"{made.ambient_frames} of ambient light\n"
        f"median of |HH + VH - HV - VV| / sum {made.dolp_median:.4f}, "
        f"{100 * made.masked_fraction:.2f} % of the pixels masked\n"
        f"products: {made.products}\nfigure:   {made.figure}"
    )
    return values, text


def _calibrate(session: Path, output: Path, make: Make, region_px: int | None, as_json: bool) -> None:
    from polfuse_lab.products.optics_calibration import calibrate_analysers, calibrate_flat, calibrate_linearity

    if make is Make.flat:
        made = calibrate_flat(session, output)
    elif make is Make.linearity:
        made = calibrate_linearity(session, output)
    else:
        made = calibrate_analysers(session, output, region_px=region_px)
    lines = [f"{name.replace('_', ' ')}: {_said(value)}" for name, value in made.values.items()]
    text = "\n".join([f"stage '{made.stage}' from {made.frames} frames", *lines, f"products: {made.products}"])
    values = {"products": made.products, "stage": made.stage, "frames": made.frames, **made.values}
    result(values, as_json=as_json, text=text)


def _lens(folder: Path, output: Path, board: str, rig: Path | None, as_json: bool) -> None:
    import re

    from polfuse_lab.products.camera_lens import calibrate_lens
    from polfuse_lab.rig import load_rig

    if (size := re.fullmatch(r"(\d+)x(\d+)", board)) is None:
        raise typer.BadParameter(f"found {board!r}, give rows and columns such as 6x9", param_hint="--board")
    camera = None if rig is None else load_rig(rig).camera
    if rig is not None and camera is None:
        raise typer.BadParameter("has no [camera]", param_hint="--rig")
    made = calibrate_lens(folder, output, int(size[1]), int(size[2]), progress=progress)
    found = made.found
    lines = [] if camera is None else made.rig_lines(camera.pixel_pitch_m)
    values = {
        "products": made.products,
        "pictures": len(made.used),
        "without_board": list(made.without_board),
        "focal_length_px": found.focal_length_px,
        "focal_length_sd_px": found.focal_length_sd_px,
        "principal_offset_px": list(made.principal_offset_px),
        "principal_offset_sd_px": list(found.principal_point_sd),
        "distortion": list(found.distortion),
        "distortion_sd": list(found.distortion_sd),
        "rms_px": found.rms_px,
        "rig_lines": lines,
    }
    right, down = made.principal_offset_px
    text = [
        f"{len(made.used)} boards, corners fit to {found.rms_px:.3f} px rms",
        *(f"note: no board was found in {name}" for name in made.without_board),
        f"focal length {found.focal_length_px:.2f} +- {found.focal_length_sd_px:.2g} px",
        f"optical axis {right:+.2f} +- {found.principal_point_sd[0]:.2g} px right, {down:+.2f} +- "
        f"{found.principal_point_sd[1]:.2g} px down of the sensor's middle",
        *(
            f"{name} {value:+.5f} +- {sd:.2g}"
            for name, value, sd in zip(("k1", "k2", "p1", "p2"), found.distortion, found.distortion_sd, strict=True)
        ),
        *(["in the rig file's [camera]:", *(f"    {line}" for line in lines)] if lines else []),
        f"products: {made.products}; use it with 'polfuse fuse --camera' or 'polfuse optics --correct'",
    ]
    result(values, as_json=as_json, text="\n".join(text))


def _said(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_said(item) for item in value)
    return f"{value:.5g}" if isinstance(value, float) else str(value)
