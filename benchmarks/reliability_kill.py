"""300 kills at random instants over all phases of a collect, of every process that it consists of.

Each is a whole collect (engine, writer, camera and guard are processes as in the field; switches, trolley and polarizer
are simulated at the wire, outside of what is killed), one blow, and a comparison of the file with an independent log of
what was confirmed to be flushed and of what the devices delivered: see :mod:`benchmarks.kill_trial`.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import random
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

from benchmarks.kill_check import LOSS_S
from benchmarks.kill_trial import Case, Trial, run_trial
from benchmarks.rows import Row

C = TypeVar("C")
T = TypeVar("T")

KILLS = 300
SEED = 20_261_122
WORKERS = 3
"""Trials at the same time: a collect mostly waits."""
PHASES = ("starting", "preparing", "moving", "recording", "optics", "flushing", "closing", "any")
QUICK = (
    Case(1, "engine", "moving"),
    Case(2, "engine", "flushing"),
    Case(3, "engine", "closing"),
    Case(4, "writer", "recording"),
    Case(5, "writer", "flushing"),
    Case(6, "writer", "preparing"),
    Case(7, "camera", "optics"),
    Case(8, "recover", "recording"),
    Case(9, "engine", "optics", "term"),
    Case(10, "writer", "moving", "stop"),
)


def cases(kills: int, seed: int = SEED) -> list[Case]:
    """So many kills, spread over processes and phases, and a tenth as many other blows; a seed gives the same."""
    chance = random.Random(seed)
    made = []
    for number in range(kills):
        process = chance.choices(("engine", "writer", "camera", "guard", "recover"), (44, 30, 14, 4, 8))[0]
        phases = PHASES if process == "engine" else PHASES[1:]
        phase = "any" if process in ("guard", "recover") else phases[number % len(phases)]
        made.append(Case(chance.getrandbits(32), process, phase))
    for number in range(max(kills // 10, 1)):
        process, blow = (("engine", "stop"), ("writer", "stop"), ("camera", "stop"), ("engine", "term"),
                         ("writer", "term"), ("camera", "term"))[number % 6]  # fmt: skip
        made.append(Case(chance.getrandbits(32), process, PHASES[1:][number % 7], blow))
    return made


def run(quick: bool) -> list[Row]:
    """All kills; a dozen when quick. POLFUSE_TRIAL_LOG in the environment names a file for a line of JSON for each."""
    if not sys.platform.startswith("linux"):
        return [Row("reliability.kill", "", None, True, "left out: processes are found by /proc, which is Linux's")]
    began = time.monotonic()
    trials = list(run_all(run_trial, QUICK if quick else cases(KILLS)))
    minutes = (time.monotonic() - began) / 60
    print(table(trials), file=sys.stderr)
    for trial in trials:
        for problem in trial.problems:
            print(f"{trial.case}: {problem}", file=sys.stderr)
    return rows(trials, minutes)


def run_all(trial: Callable[[C], T], chosen: Sequence[C], workers: int = WORKERS) -> Iterator[T]:
    """Carry out trials, some at the same time, in processes of their own: a trial changes its environment."""
    log = os.environ.get("POLFUSE_TRIAL_LOG")
    with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
        for done in pool.map(trial, chosen):
            if log:
                with Path(log).open("a", encoding="utf-8") as file:
                    file.write(json.dumps(asdict(done)) + "\n")  # type: ignore[call-overload]
            yield done


def rows(trials: Sequence[Trial], minutes: float) -> list[Row]:
    """One row for each promise."""
    kills = sum(trial.case.blow == "kill" for trial in trials)
    problems = [problem for trial in trials for problem in trial.problems]

    def row(name: str, beginnings: tuple[str, ...], target: str) -> Row:
        found = [problem for problem in problems if problem.startswith(beginnings)]
        return Row(f"reliability.kill.{name}", "", None, not found, target, error="; ".join(found[:5]) or None)

    worst = max((trial.lost_s for trial in trials if trial.lost_positions > 1), default=0.0)
    confirmed = sum(trial.confirmed for trial in trials)
    return [
        Row(
            "reliability.kill",
            "",
            None,
            not problems,
            f"{kills} kills and {len(trials) - kills} other blows in {minutes:.0f} min, no promise broken",
            error=f"{sum(bool(trial.problems) for trial in trials)} of {len(trials)} with problems"
            if problems
            else None,
        ),
        row("opens", ("cannot be",), "every file opens, after recover where it was left partial"),
        row(
            "confirmed", ("confirmed", "a collect that", "audio", "frame"), f"none of {confirmed} flushed records lost"
        ),
        Row(
            "reliability.kill.loss",
            "",
            worst / LOSS_S,
            worst <= LOSS_S,
            "at most one position or one second lost",
            error=f"largest loss beyond one position: {worst:.2f} s",
        ),
        row("safe", ("devices",), "switches at HH, trolley standing"),
        row("clean", ("left behind", "processes left", "a ballast"), "no process, shared memory, socket or file left"),
        row("ends", ("the ", "ended as"), "the collect ends, and says how"),
    ]


def table(trials: Sequence[Trial]) -> str:
    """Blows by what the collect was at and what was struck, as a table of Markdown; with problems in brackets."""
    columns = [("engine", "kill"), ("writer", "kill"), ("camera", "kill"), ("guard", "kill"), ("recover", "kill"),
               ("engine", "stop"), ("writer", "stop"), ("camera", "stop"), ("engine", "term"), ("writer", "term"),
               ("camera", "term")]  # fmt: skip
    columns = [column for column in columns if any((t.case.process, t.case.blow) == column for t in trials)]
    counts: Counter[tuple[str, str, str]] = Counter()
    bad: Counter[tuple[str, str, str]] = Counter()
    for trial in trials:
        key = (trial.phase, trial.case.process, trial.case.blow)
        counts[key] += 1
        bad[key] += bool(trial.problems)
    order = ("starting", "preparing", "moving", "recording", "optics", "flushing", "between", "recovering", "closing",
             "recover")  # fmt: skip
    lines = ["| struck while | " + " | ".join(f"{process}, {blow}" for process, blow in columns) + " | all |"]
    lines.append("|---|" + "---|" * (len(columns) + 1))
    for phase in (phase for phase in order if any(key[0] == phase for key in counts)):
        cells = [_cell(counts[phase, *column], bad[phase, *column]) for column in columns]
        total = sum(count for key, count in counts.items() if key[0] == phase)
        lines.append(f"| {phase} | " + " | ".join(cells) + f" | {total} |")
    sums = [str(sum(count for key, count in counts.items() if key[1:] == column)) for column in columns]
    lines.append("| all | " + " | ".join(sums) + f" | {len(trials)} |")
    return "\n".join(lines)


def _cell(count: int, bad: int) -> str:
    return f"{count} ({bad} bad)" if bad else str(count or "")
