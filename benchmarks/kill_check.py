"""A session against the log of what was confirmed to be flushed and of what the devices delivered."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.kill_log import TapLog, Told
from benchmarks.kill_plugin import picture, samples
from polfuse_lab.errors import PolfuseError
from polfuse_lab.session import Session, info, open_session

if TYPE_CHECKING:
    from benchmarks.kill_trial import Trial

LOSS_S = 1.0
"""At most one position, or what is younger than this, may be lost."""
TABLES = {
    "TrolleyFix": "trolley",
    "SwitchState": "switches",
    "PolarizerFix": "polarizer",
    "SourceFix": "source_polarizer",
    "ClockFix": "clocks",
    "Note": "notes",
    "Event": "events",
}


def compare(trial: Trial, log: TapLog, path: Path | None, struck_ns: int) -> None:
    """Add to ``trial`` what was lost, and as problems what must not have been.

    Args:
        trial: takes the numbers and the problems.
        log: what was told.
        path: the session, None when there is none.
        struck_ns: when the blow fell.
    """
    queued, confirmed = log.queued, log.confirmed
    trial.confirmed = confirmed
    have: set[tuple[str, int]] = set()
    if path is not None:
        try:
            info(path)
            with open_session(path) as session:
                have = content(session, trial.problems)
        except PolfuseError as error:
            trial.problems.append(f"cannot be read: {error}")
            return
    for told in queued[:confirmed]:
        if _key(told) not in have:
            trial.problems.append(f"confirmed and lost: {told.kind} {told.number} (position {told.position})")
    if trial.outcome.startswith(("finished", "aborted")) and not all(_key(told) in have for told in queued):
        trial.problems.append(f"a collect that ended as {trial.outcome.split(':')[0]} lost records that it was given")
    _count_losses(trial, log, have, struck_ns)


def _count_losses(trial: Trial, log: TapLog, have: set[tuple[str, int]], struck_ns: int) -> None:
    delivered = log.delivered()
    positions = {_key(told): told.position for told in log.queued if told.kind == "audio"}
    lost = [(t_ns, kind, number) for t_ns, kind, number in delivered if (kind, number) not in have]
    trial.delivered, trial.lost = len(delivered), len(lost)
    if not lost:
        return
    trial.lost_s = (struck_ns - min(t_ns for t_ns, _, _ in lost)) * 1e-9
    trial.lost_positions = len(
        {positions.get((kind, number), log.moves_before(t_ns) - 1) for t_ns, kind, number in lost}
    )
    if trial.lost_positions > 1 and trial.lost_s > LOSS_S:
        trial.problems.append(f"lost {trial.lost_positions} positions, {trial.lost_s:.2f} s")


def content(session: Session, problems: list[str]) -> set[tuple[str, int]]:
    """What is in a file, as kinds and numbers; content that is not what the devices made of its number is a problem."""
    have: set[tuple[str, int]] = set()
    for index, row in enumerate(session.sweeps):
        first = int(row["device_frame"])
        if not np.array_equal(session.audio(index), samples(first, int(row["samples"]))):
            problems.append(f"audio record {index} holds other samples than were delivered")
        have.add(("audio", first))
    for index, row in enumerate(session.frames):
        number = int(row["frame_id"])
        if not np.array_equal(session.frame(index), picture(number)):
            problems.append(f"frame {index} holds another picture than was delivered")
        have.add(("frame", number))
    if session.missing_records:
        problems.append(f"{session.missing_records} rows point at nothing")
    for kind, table in TABLES.items():
        have |= {(kind, int(t_ns)) for t_ns in getattr(session, table)["t_host_ns"]}
    return have


def _key(told: Told) -> tuple[str, int]:
    return told.kind, told.number
