"""Parts of a session's summary: what the operator wrote, what records carry, pauses, and the room that it takes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.records import FrameFlag, SweepFlag
from polfuse_lab.session.layout import TABLES
from polfuse_lab.session.reader import Session
from polfuse_lab.session.space import free_bytes

MARK = "mark"
"""Kind of the events that say what the records after them belong to."""
LONG_PAUSE_S = 10.0
"""Pauses are worth telling from this length on, if they are unusual besides."""
UNUSUAL = 5.0
"""A pause that is so many times the usual one is unusual."""
MOST_GAPS = 5
"""Pauses told at most: the longest."""


def written(session: Session) -> list[dict[str, Any]]:
    """Notes of the operator and marks of the plan in order of time: ``kind``, ``time_s`` (since the first record; below
    0 before it), ``text``.
    """
    marks = session.events[session.events["kind"] == MARK.encode()]
    found: list[dict[str, Any]] = []
    for kind, rows in (("note", session.notes), (MARK, marks)):
        last_ns: int | None = None
        for row in rows:
            text, t_ns = bytes(row["text"]).decode(errors="replace"), int(row["t_host_ns"])
            if kind == "note" and t_ns == last_ns:
                found[-1]["text"] += text  # a long note takes several rows
            else:
                found.append({"kind": kind, "time_s": (t_ns - session.first_host_ns) * 1e-9, "text": text})
            last_ns = t_ns
    return sorted(found, key=lambda item: float(item["time_s"]))


def flag_counts(session: Session) -> dict[str, int]:
    """How many audio records and frames carry each flag, by its name (``"SWEEP_LOST"``, ``"FRAME_MOVED"``, ...)."""
    found = {}
    kinds: tuple[tuple[str, NDArray[Any], type[SweepFlag] | type[FrameFlag]], ...] = (
        ("SWEEP", session.sweeps["flags"], SweepFlag),
        ("FRAME", session.frames["flags"], FrameFlag),
    )
    for prefix, flags, kind in kinds:
        for flag in kind:
            count = int(np.count_nonzero(flags & int(flag)))
            if flag.value and count:
                found[f"{prefix}_{flag.name}"] = count
    return found


def gaps(session: Session) -> list[dict[str, float]]:
    """The longest unusual pauses between records, in order of time: ``time_s`` since the first record, ``seconds``."""
    sweeps, frames = session.sweeps, session.frames
    start = np.concatenate([sweeps["t_host_ns"], frames["t_host_ns"]])
    lasted = np.concatenate([sweeps["samples"] / session.sample_rate_hz, frames["exposure_s"]])
    order = np.argsort(start, kind="stable")
    start, end = start[order], (start + np.round(lasted * 1e9).astype(np.int64))[order]
    if len(start) < 2:
        return []
    end = np.maximum.accumulate(end)
    pauses = (start[1:] - end[:-1]) * 1e-9
    least = max(LONG_PAUSE_S, UNUSUAL * float(np.median(pauses)))
    longest = np.argsort(-pauses)[: min(MOST_GAPS, int(np.count_nonzero(pauses >= least)))]
    since = (end[:-1] - session.first_host_ns) * 1e-9
    return [{"time_s": float(since[at]), "seconds": float(pauses[at])} for at in sorted(longest.tolist())]


def disk(session: Session) -> dict[str, int]:
    """Bytes: ``file``, ``free`` on its disk, and stored and raw sizes of ``audio`` and ``images``; ``tables``."""
    found = {"file": session.path.stat().st_size, "free": free_bytes(session.path.absolute())}
    stored = session.stored_bytes()
    for name in ("audio", "images"):
        if name in stored:
            found[name], found[f"{name}_raw"] = stored[name]
    return found | {"tables": sum(stored[name][0] for name in TABLES if name in stored)}
