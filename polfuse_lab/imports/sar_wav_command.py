"""The format ``sar-wav`` for the command line: rail recordings, alone or with polarizer frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.imports.formats import Imported
from polfuse_lab.imports.frames_session import frame_options, frames_for
from polfuse_lab.imports.options import channel_list, wishes_of
from polfuse_lab.imports.sar_wav import DEFAULT_STEP_M, import_sar_wav
from processing.radar.sync import Polarity


def run(
    files: Sequence[Path],
    output: Path,
    *,
    channel: str | None = None,
    channels: str | None = None,
    step_m: float = DEFAULT_STEP_M,
    positions: int | None = None,
    drop: Sequence[str] = (),
    repeats: Sequence[str] = (),
    rig: Path | None = None,
    bandwidth_hz: float | None = None,
    centre_hz: float | None = None,
    antenna_height_m: float | None = None,
    sweep_period_s: float = 0.040,
    up_ramp: Polarity = "auto",
    frames: Sequence[Path] = (),
    **frame_settings: Any,
) -> Imported:
    """:func:`polfuse_lab.imports.sar_wav.import_sar_wav` for the command line; see there.

    Raises:
        PolfuseError: as there, or options that do not go together.
    """
    names = _channels(files, channel, channels)
    dark = frame_settings.pop("dark", ())
    if not frames and (dark or frame_settings):
        raise PolfuseError(
            "settings of frames are given, but no frames", where="import", advice="name the frames with --frames"
        )
    done = import_sar_wav(
        files,
        output,
        channels=names,
        step_m=step_m,
        wishes=wishes_of(names, positions, drop, repeats),
        rig=rig,
        bandwidth_hz=bandwidth_hz,
        centre_hz=centre_hz,
        antenna_height_m=antenna_height_m,
        nominal_period_s=sweep_period_s,
        polarity=up_ramp,
        frames=frames_for(frames, dark, frame_options(**frame_settings), rig) if frames else None,
    )
    level = "low" if done.sync_inverted else "high"
    lines = [
        f"{done.positions} positions {abs(done.step_m):g} m apart in {', '.join(done.channels)}",
        f"{done.sweeps} sweeps of {done.sweep_period_s * 1e3:.3f} ms; sync on channel {done.sync_channel}, "
        f"up-ramp while {level} (by {done.polarity_from})",
        f"centre {done.centre_hz / 1e9:.4g} GHz, bandwidth {done.bandwidth_hz / 1e6:.4g} MHz",
        *([f"{done.frames} camera frames"] if done.frames else []),
        *(f"note: {note}" for note in done.notes),
        f"session: {done.session}",
    ]
    return Imported(asdict(done), "\n".join(lines))


def _channels(files: Sequence[Path], channel: str | None, channels: str | None) -> tuple[Channel, ...]:
    if channel is not None and channels is not None:
        raise PolfuseError("--channel and --channels are given", where="import", advice="give one of them")
    if channels is not None:
        return channel_list(channels)
    if channel is not None:
        return (Channel[channel],)
    advice = "add --channel VV" if len(files) == 1 else "name each file's channel in order: --channels HH,HV,VH,VV"
    raise PolfuseError("the polarimetric channel of the recording is not told", where="import", advice=advice)
