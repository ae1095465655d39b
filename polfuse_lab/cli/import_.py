"""``polfuse import``: foreign recordings into sessions and products."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result
from polfuse_lab.imports.formats import FORMATS, option_name, run_import

FORMAT_HELP = "What they are: " + "; ".join(f"{name} = {item.what}" for name, item in FORMATS.items()) + "."
COMMON = frozenset({"files", "output", "as_", "json_", "debug", "ctx"})
"""Parameters of the command that every format has."""


class UpRamp(StrEnum):
    """Which level of the sync is the up-ramp."""

    auto = "auto"
    high = "high"
    low = "low"


class ChannelName(StrEnum):
    """Polarimetric channel, transmit then receive."""

    HH = "HH"
    HV = "HV"
    VH = "VH"
    VV = "VV"


@guarded
def import_(
    ctx: typer.Context,
    files: Annotated[list[Path], typer.Argument(help="Recordings, or the folder that holds them.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write; a session must not exist yet.")],
    as_: Annotated[str, typer.Option("--as", help=FORMAT_HELP)],
    channel: Annotated[
        ChannelName | None, typer.Option(help="Polarimetric channel of the recording (wav: VV where left out).")
    ] = None,
    channels: Annotated[
        str | None, typer.Option(help="sar-wav: channel of each file, in their order: HH,HV,VH,VV.")
    ] = None,
    step_m: Annotated[
        float | None, typer.Option(help="sar-wav: distance of marks, m (0.0508); negative if pushed towards -x.")
    ] = None,
    positions: Annotated[int | None, typer.Option(min=2, help="sar-wav: how many positions there were.")] = None,
    drop: Annotated[
        list[str] | None, typer.Option(help="sar-wav: bursts of sweeps to leave out, from 1: 18 or HV:18.")
    ] = None,
    repeats: Annotated[
        list[str] | None, typer.Option(help="sar-wav: bursts that repeat the position before: 18 or HV:18.")
    ] = None,
    rig: Annotated[Path | None, typer.Option(help="Rig file of the radar and camera that were used.")] = None,
    bandwidth_hz: Annotated[
        float | None, typer.Option(help="Frequency swept in one up-ramp, Hz; not told by a WAV (80e6 is assumed).")
    ] = None,
    centre_hz: Annotated[float | None, typer.Option(help="Centre frequency, Hz (2.4e9 is assumed).")] = None,
    antenna_height_m: Annotated[
        float | None, typer.Option(help="sar-wav: height of the antennas above ground, m (1.069 is assumed).")
    ] = None,
    sweep_period_s: Annotated[
        float | None, typer.Option(min=1e-4, help="Expected sweep period, s (0.040); it is measured.")
    ] = None,
    up_ramp: Annotated[
        UpRamp | None, typer.Option(help="Level of the sync during the up-ramp, if known (auto: measured).")
    ] = None,
    frames: Annotated[
        list[Path] | None, typer.Option(help="sar-wav: frames of the same scene: files, folders or 'pol_*.tif'.")
    ] = None,
    dark: Annotated[
        list[Path] | None, typer.Option(help="Frames with the lens covered: files, folders or 'dark_*.tif'.")
    ] = None,
    angles: Annotated[
        str | None,
        typer.Option(help="Polarizer angle of each frame, degrees: 0,45,90,135 (or by name: pol_045.tif)."),
    ] = None,
    angle_pattern: Annotated[
        str | None, typer.Option(help="Where the angle stands in a name: 'scene_{angle}_*'.")
    ] = None,
    bits: Annotated[int | None, typer.Option(help="Bits of the camera, if files hold more: 10, 12, 14.")] = None,
    exposure_s: Annotated[float | None, typer.Option(help="Exposure of the frames, s.")] = None,
    angle_sd_deg: Annotated[
        float | None, typer.Option(help="How well each polarizer angle was met, degrees (sd; 1).")
    ] = None,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Import foreign recordings. Which channel is the sync, its polarity and its period are measured.

    Example: polfuse import walk.wav -o walk.h5 --as wav --bandwidth-hz 80e6

    Example: polfuse import hh.wav hv.wav vh.wav vv.wav -o S.h5 --as sar-wav --channels HH,HV,VH,VV

    Example: polfuse import pol_*.tif -o optics.h5 --as frames --dark dark.tif
    """
    if as_ not in FORMATS:
        raise typer.BadParameter(f"{as_!r} is not one of {', '.join(FORMATS)}", param_hint="--as")
    given: dict[str, Any] = {
        name: value.value if isinstance(value, StrEnum) else value
        for name, value in ctx.params.items()
        if name not in COMMON and value is not None and value != [] and value != ()
    }
    if foreign := sorted(set(given) - FORMATS[as_].options):
        raise typer.BadParameter(f"means nothing with --as {as_}", param_hint=", ".join(map(option_name, foreign)))
    done = run_import(as_, files, output, given)
    result(done.values, as_json=json_, text=done.text)
