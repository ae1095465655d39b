"""Every device with every fault that it can have; writes ``docs/fault-matrix.md`` (not with ``--quick``)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from benchmarks.fault_matrix import CASES, Trial, attempt, table
from benchmarks.fault_stands import missing, standing
from benchmarks.rows import Row

PAGE = Path(__file__).resolve().parent.parent / "docs" / "fault-matrix.md"
QUICK_TIMEOUT_S = 0.6
DEVICES = tuple(dict.fromkeys(case.device for case in CASES))


def run(quick: bool) -> list[Row]:
    """Try all cases: with the drivers' own time-outs, or shorter ones when quick."""
    trials = try_all(quick=quick)
    rows = [_row(trial) for trial in trials]
    absent = [
        Row(f"reliability.faults.{device}", "", None, False, why) for device in DEVICES if (why := missing(device))
    ]
    rows += absent
    if not quick and all(row.ok for row in rows):
        PAGE.write_text(table(trials), encoding="utf-8")
    return rows


def try_all(*, quick: bool) -> list[Trial]:
    """Try all cases on this machine, in the order of :data:`CASES`; when quick, all devices at the same time."""
    devices = [device for device in DEVICES if not missing(device)]
    with ThreadPoolExecutor(max_workers=len(devices) if quick else 1) as pool:
        return [trial for trials in pool.map(partial(_try_device, quick=quick), devices) for trial in trials]


def _try_device(device: str, *, quick: bool) -> list[Trial]:
    with standing(device, QUICK_TIMEOUT_S if quick else None) as stand:
        return [attempt(case, stand) for case in CASES if case.device == device]


def _row(trial: Trial) -> Row:
    ratio = None if trial.detected_s is None else trial.detected_s / trial.limit_s
    name = f"reliability.faults.{trial.case.key}"
    target = f"noticed within {trial.limit_s:g} s" if trial.case.raises else trial.case.after.value
    return Row(name, "", ratio, trial.ok, target, error="; ".join(trial.problems) or None)
