"""Disks that get full, or fail in other ways, at random moments of a collect, which then goes on in another place.

Each is a whole collect on a small file system: see :mod:`benchmarks.disk_trial`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

from benchmarks.disk_trial import KINDS, DiskCase, DiskTrial, run_disk_trial
from benchmarks.reliability_kill import run_all
from benchmarks.rows import Row

FULL = 50
OTHERS = 6
"""Trials of each other way in which a disk fails."""
SEED = 41


def cases(full: int, others: int, seed: int = SEED) -> list[DiskCase]:
    """So many disks that get full, and so many of each other kind of failure."""
    made = [DiskCase(seed + number) for number in range(full)]
    return made + [DiskCase(seed + 1000 + number, kind) for number in range(others) for kind in KINDS[1:]]


def run(quick: bool) -> list[Row]:
    """All trials; one of each kind when quick."""
    began = time.monotonic()
    trials = list(run_all(run_disk_trial, cases(1, 1) if quick else cases(FULL, OTHERS)))
    minutes = (time.monotonic() - began) / 60
    for trial in trials:
        for problem in trial.problems:
            print(f"{trial.case} ({trial.phase}): {problem}", file=sys.stderr)
    print(table(trials), file=sys.stderr)
    return [_row(kind, [trial for trial in trials if trial.case.kind == kind], minutes) for kind in KINDS]


def _row(kind: str, trials: Sequence[DiskTrial], minutes: float) -> Row:
    name = "reliability.disk_full" + ("" if kind == "full" else f".{kind.replace(' ', '_')}")
    skipped = next((trial.skipped for trial in trials if trial.skipped), "")
    if skipped:
        return Row(name, "", None, True, f"left out: {skipped}")
    bad = [trial for trial in trials if trial.problems]
    return Row(
        name,
        "",
        None,
        not bad,
        f"{len(trials)} times (all kinds: {minutes:.1f} min): all that was confirmed is there, a clear reason, and"
        " with what was collected elsewhere the session is whole",
        error="; ".join(f"{trial.case.seed}: {trial.problems[0]}" for trial in bad[:5]) or None,
    )


def table(trials: Sequence[DiskTrial]) -> str:
    """Trials by how the disk failed, as a table of Markdown."""
    lines = ["| the disk | trials | records given | kept | confirmed | went on and joined | problems |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for kind in KINDS:
        some = [trial for trial in trials if trial.case.kind == kind and not trial.skipped]
        numbers = [sum(getattr(trial, name) for trial in some) for name in ("queued", "kept", "confirmed")]
        joined = sum(trial.rest.startswith("finished") for trial in some)
        bad = sum(bool(trial.problems) for trial in some)
        lines.append(f"| {kind} | {len(some)} | {' | '.join(map(str, numbers))} | {joined} | {bad} |")
    return "\n".join(lines)
