"""``polfuse import``: foreign recordings into sessions."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


class Format(StrEnum):
    """Formats that can be imported."""

    wav = "wav"


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
    files: Annotated[list[Path], typer.Argument(help="Recordings of one radar.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Session to write; must not exist.")],
    as_: Annotated[Format, typer.Option("--as", help="What they are: wav = stereo WAV with beat and sync.")],
    bandwidth_hz: Annotated[
        float | None, typer.Option(help="Frequency swept in one up-ramp, Hz; not told by a WAV (80e6 is assumed).")
    ] = None,
    centre_hz: Annotated[float | None, typer.Option(help="Centre frequency, Hz (2.4e9 is assumed).")] = None,
    sweep_period_s: Annotated[float, typer.Option(min=1e-4, help="Expected sweep period, s; it is measured.")] = 0.040,
    up_ramp: Annotated[UpRamp, typer.Option(help="Level of the sync during the up-ramp, if known.")] = UpRamp.auto,
    channel: Annotated[ChannelName, typer.Option(help="Polarimetric channel of the recordings.")] = ChannelName.VV,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Import foreign recordings. Which channel is the sync, its polarity and its period are measured.

    Example: polfuse import walk.wav -o walk.h5 --as wav --bandwidth-hz 80e6
    """
    from drivers.records import Channel
    from polfuse_lab.imports import import_wav

    done = import_wav(
        files,
        output,
        bandwidth_hz=bandwidth_hz,
        centre_hz=centre_hz,
        nominal_period_s=sweep_period_s,
        polarity=up_ramp.value,
        channel=Channel[channel.value],
    )
    values = {
        "session": done.session,
        "sweeps": done.sweeps,
        "sync_channel": done.sync_channel,
        "sync_inverted": done.sync_inverted,
        "sweep_period_s": done.sweep_period_s,
        "ramp_up_s": done.ramp_up_s,
        "jitter_s": done.jitter_s,
        "polarity_from": done.polarity_from,
        "bandwidth_hz": done.bandwidth_hz,
        "bandwidth_assumed": done.bandwidth_assumed,
        "centre_hz": done.centre_hz,
        "notes": done.notes,
    }
    level = "low" if done.sync_inverted else "high"
    text = "\n".join(
        [
            f"{done.sweeps} sweeps of {done.sweep_period_s * 1e3:.3f} ms; sync on channel {done.sync_channel}, "
            f"up-ramp while {level} (by {done.polarity_from})",
            f"centre {done.centre_hz / 1e9:.4g} GHz, bandwidth {done.bandwidth_hz / 1e6:.4g} MHz",
            *(f"note: {note}" for note in done.notes),
            f"session: {done.session}",
        ]
    )
    result(values, as_json=json_, text=text)
