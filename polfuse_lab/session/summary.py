"""What is inside a session, and whether it is whole."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from drivers.records import Channel
from polfuse_lab.clocks.pieces import STEP_S
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans.listing import planned
from polfuse_lab.records import SUPERSEDED, FrameFlag, SweepFlag
from polfuse_lab.session.contents import flag_counts, gaps, written
from polfuse_lab.session.layout import CONTINUES
from polfuse_lab.session.reader import Session, open_session

WRONG_SHARE = 0.25
"""Share of readings of a clock beyond which their being left out is told as a problem."""


def info(path: Path | str) -> dict[str, Any]:
    """Summarise a session.

    Returns:
        ``schema``, ``complete``, ``state``, ``reason``, ``source``, ``positions``, ``channels``, ``sweeps`` (audio
        records), ``frames``, ``samples_lost``, ``frames_lost``, ``duration_s``, ``sync_rms_s`` (largest residual of a
        clock), ``clock_drift_ppm`` by device, ``sync`` (see :meth:`SessionSync.summary`), ``flags`` (records that
        carry each), ``gaps`` (unusual pauses), ``notes`` (and marks, with their time), ``started``, ``devices``, and
        ``problems``, sentences that say what is missing or doubtful (empty for a sound session).

    Raises:
        PolfuseError: the file cannot be read as a session.
    """
    with open_session(path) as session:
        sweeps = session.sweeps
        return {
            "schema": session.schema,
            "complete": session.complete,
            "state": session.state,
            "reason": session.reason,
            "source": session.config["source"],
            "positions": len(np.unique(sweeps["position"])),
            "channels": [channel.name for channel in Channel if channel in sweeps["channel"]],
            "sweeps": len(sweeps),
            "frames": len(session.frames),
            "samples_lost": session.samples_lost,
            "frames_lost": session.frames_lost,
            "duration_s": duration_s(session),
            "sync_rms_s": session.sync.residual_rms_s,
            "clock_drift_ppm": {name: clock.drift_ppm for name, clock in session.sync.clocks.items()},
            "sync": session.sync.summary(),
            "flags": flag_counts(session),
            "gaps": gaps(session),
            "notes": written(session),
            "started": session.config.get("started", ""),
            "devices": session.config["identities"],
            "problems": problems(session),
        }


def duration_s(session: Session) -> float:
    """Seconds from the first sample or frame to the end of the last."""
    starts = [session.sweeps["t_host_ns"], session.frames["t_host_ns"]]
    ends = [
        session.sweeps["t_host_ns"] + (session.sweeps["samples"] * (1e9 / session.sample_rate_hz)).astype(np.int64),
        session.frames["t_host_ns"] + (session.frames["exposure_s"] * 1e9).astype(np.int64),
    ]
    start, end = np.concatenate(starts), np.concatenate(ends)
    return float(end.max() - start.min()) * 1e-9 if len(start) else 0.0


def problems(session: Session) -> list[str]:
    """What is missing or doubtful in a session, one sentence each."""
    found = []
    sweeps, frames = session.sweeps, session.frames
    if session.state == "recording":
        found.append("the file was never closed: it is being written, or was left by a crash (see 'polfuse recover')")
    elif session.state != "finished":
        found.append(f"the collect ended as '{session.state}': {session.reason or 'no reason was stored'}")
    if session.missing_records:
        found.append(f"{session.missing_records} records point at data that are not in the file")
    if not len(sweeps) and not len(frames):
        found.append("there is no record in it")
    before = session.config["extra"].get(CONTINUES)
    if before is not None:
        found.append(f"it continues {before['session']}: 'polfuse join' makes one session of both")
    found.extend(_missing_from_plan(session))
    for flag, text in (
        (SweepFlag.LOST, "lost audio frames and were taken again or given up"),
        (SweepFlag.OVERFLOW, "carry the audio device's overflow flag"),
        (SweepFlag.SWITCH_CHANGED, "saw the switches in another state than they began with"),
        (SweepFlag.MOVED, "saw the trolley move where it should have stood"),
    ):
        count = int(np.count_nonzero(sweeps["flags"] & int(flag)))
        if count:
            found.append(f"{count} audio records {text}")
    moved = int(np.count_nonzero(frames["flags"] & int(FrameFlag.MOVED)))
    if moved:
        found.append(f"{moved} camera frames saw a polarizer move")
    incomplete = int(frames["incomplete"].sum())
    if incomplete:
        found.append(f"{incomplete} camera frames are incomplete")
    found.extend(_clock_problems(session))
    return found


def _clock_problems(session: Session) -> list[str]:
    found = []
    for name, clock in session.sync.clocks.items():
        # Beyond that, the device was opened again or its counter wrapped round, which is no cause for doubt.
        found += [
            f"the {name}'s clock jumped by {step_s * 1e3:+.1f} ms: times on both sides of it are fitted apart"
            for step_s in clock.jumps_s
            if abs(step_s) < STEP_S
        ]
        if clock.rejected > WRONG_SHARE * clock.pairs:
            found.append(f"{clock.rejected} of {clock.pairs} readings of the {name}'s clock do not fit the others")
    return found


def _missing_from_plan(session: Session) -> list[str]:
    try:
        steps = session.steps
    except PolfuseError as error:
        return [f"its plan cannot be read by this version ({error.what})"]
    good = session.sweeps[(session.sweeps["flags"] & int(SUPERSEDED)) == 0]
    have = {(int(row["position"]), int(row["channel"])) for row in good}
    # A pass of the trolley is there once its first record is.
    wanted = planned(steps)
    want = {(record.first_position, int(record.channel)) for record in wanted.records}
    found = []
    if want - have:
        found.append(f"{len(want - have)} of {len(want)} planned position-channel records are missing")
    if wanted.frames:
        moved = (session.frames["flags"] & int(FrameFlag.MOVED)) > 0
        taken = int(np.count_nonzero(~session.frames["dark"] & ~moved))
        if taken < wanted.frames:
            found.append(f"{wanted.frames - taken} of {wanted.frames} planned camera frames are missing")
    return found
