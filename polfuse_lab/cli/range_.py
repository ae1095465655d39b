"""``polfuse range``: range-time and range-Doppler pictures, tracks and speeds."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from polfuse_lab.cli.output import Debug, Json, guarded, result


class WindowName(StrEnum):
    """Windows over the ramp."""

    hann = "hann"
    taylor = "taylor"
    rectangular = "rectangular"


@guarded
def range_(
    session: Annotated[Path, typer.Argument(help="Session with a record of many sweeps from one place.")],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Picture to draw; beside the session by default.")
    ] = None,
    record: Annotated[int | None, typer.Option(min=0, help="Audio record; by default that with most sweeps.")] = None,
    max_range_m: Annotated[float | None, typer.Option(help="End of the range axis, m (default 200).")] = None,
    max_speed_m_s: Annotated[float, typer.Option(min=0.1, help="Fastest range rate looked for, m/s.")] = 40.0,
    window: Annotated[WindowName, typer.Option(help="Window over the ramp.")] = WindowName.hann,
    json_: Json = False,
    debug: Debug = False,
) -> None:
    """Show range over time and Doppler, and track what moves (speeds: + receding, - approaching).

    Ranges of tracks are the mean of up- and down-ramp where both show the target: each alone is shifted by Doppler.

    Example: polfuse range walk.h5 -o walk.png
    """
    from polfuse_lab.products import style
    from polfuse_lab.products.figures_ranging import ranging_figure
    from polfuse_lab.products.ranging_time import assumed_note, range_time
    from processing.radar.tracks import TrackSettings

    data = range_time(
        session,
        record=record,
        max_range_m=max_range_m,
        window=window.value,
        settings=TrackSettings(max_speed_m_s=max_speed_m_s),
    )
    figure = style.save(ranging_figure(data, session.stem), output or session.with_name(f"{session.stem}_range.png"))
    tracks = [
        {
            "t0_s": target.track.t0_s,
            "t1_s": target.track.t1_s,
            "r0_m": target.r0_m,
            "r1_m": target.r1_m,
            "speed_m_s": target.track.speed_m_s,
            "speed_sd_m_s": target.track.speed_sd_m_s,
            "doppler_m_s": target.track.doppler_m_s,
            "doppler_sd_m_s": target.track.doppler_sd_m_s,
            "ramp_speed_m_s": target.ramp_speed_m_s,
            "ramp_speed_sd_m_s": target.ramp_speed_sd_m_s,
            "snr_db": target.track.snr_db,
        }
        for target in data.targets
    ]
    values = {
        "tracks": tracks,
        "figure": figure,
        "channel": data.channel.name,
        "sweeps": len(data.time_s),
        "sweep_period_s": data.period_s,
        "bandwidth_hz": data.waveform.bandwidth_hz,
        "bandwidth_assumed": data.bandwidth_assumed,
        "doppler_ambiguity_m_s": 2 * data.ambiguity_m_s,
    }
    lines = [f"{len(data.time_s)} sweeps of {data.period_s * 1e3:.3f} ms, {assumed_note(data)}"]
    lines += [
        f"track {number}: {t['t0_s']:.2f} to {t['t1_s']:.2f} s, {t['r0_m']:.1f} to {t['r1_m']:.1f} m, "
        f"{t['speed_m_s']:+.2f} +- {t['speed_sd_m_s']:.2f} m/s (Doppler {t['doppler_m_s']:+.2f}, "
        f"modulo {2 * data.ambiguity_m_s:.3f})"
        for number, t in enumerate(tracks, start=1)
    ]
    if not tracks:
        lines.append("no moving target found")
    if data.bandwidth_assumed:
        lines.append("the bandwidth is an assumption: ranges and speeds scale with 1 / bandwidth, Doppler does not")
    result(values, as_json=json_, text="\n".join([*lines, f"figure: {figure}"]))
