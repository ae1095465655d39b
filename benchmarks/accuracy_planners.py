"""All planners by the same measure, 200 random scenes each: ``accuracy.planners``.

Of every scene: the error (or size) that was foretold of the chosen setting against the measured one, whether a promised
tolerance is kept, and what the chosen setting costs over the cheapest that would have kept the tolerance, all costs
measured as the least processor time of several rounds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.planner_trials import (
    Trial,
    demosaic_trial,
    focus_trial,
    registration_trial,
    resampling_trial,
    storage_trial,
    window_trial,
)
from benchmarks.rows import Row

SCENES, QUICK = 200, 8
FACTOR_DB = 6.02
"""A factor of two."""
SHARE, COST = 0.95, 1.5

TASKS: dict[str, Callable[[int], Trial]] = {
    "focus": focus_trial,
    "decompose": window_trial,
    "demosaic": demosaic_trial,
    "registration": registration_trial,
    "resampling": resampling_trial,
    "storage": storage_trial,
}


@dataclass(frozen=True)
class Verdict:
    """What the trials of one task say."""

    scenes: int
    within: float
    """Share of the scenes whose expected error was within a factor of two."""
    lowest_db: float
    highest_db: float
    """Measured over expected."""
    promised: int
    kept: float
    """Share of the promised tolerances that were kept."""
    judged: int
    """Scenes in which a setting keeps the tolerance."""
    cheap: float
    """Share of these whose choice costs no more than 1.5 times the cheapest that keeps it."""
    together: float
    """Cost of all choices over that of all cheapest."""
    dearest: float


def verdict(trials: Sequence[Trial]) -> Verdict:
    """Of one task."""
    off = np.array([trial.off_db for trial in trials])
    promised = [trial for trial in trials if trial.promised]
    judged = [trial for trial in trials if math.isfinite(trial.least_cost)]
    ratios = np.array([trial.cost / trial.least_cost for trial in judged]) if judged else np.ones(1)
    return Verdict(
        scenes=len(trials),
        within=float(np.mean(np.abs(off) <= FACTOR_DB)),
        lowest_db=float(off.min()),
        highest_db=float(off.max()),
        promised=len(promised),
        kept=float(np.mean([trial.kept for trial in promised])) if promised else 1.0,
        judged=len(judged),
        cheap=float(np.mean(ratios <= COST)),
        together=sum(trial.cost for trial in judged) / max(sum(trial.least_cost for trial in judged), 1e-300)
        if judged
        else 1.0,
        dearest=float(ratios.max()),
    )


def rows_of(task: str, told: Verdict) -> list[Row]:
    """Four rows: the forecast, its optimism, the promises, the costs."""
    name = f"accuracy.planners.{task}"
    return [
        Row(
            name,
            "",
            None,
            told.within >= SHARE,
            f"expected within a factor of 2 of measured in 95 % of {told.scenes} scenes",
            error=f"{100 * told.within:.1f} %, {told.lowest_db:+.1f} to {told.highest_db:+.1f} dB",
        ),
        Row(
            f"{name}.optimism",
            "",
            None,
            told.highest_db <= FACTOR_DB,
            "never optimistic by more than 6 dB",
            error=f"{told.highest_db:+.1f} dB at most",
        ),
        Row(
            f"{name}.tolerance",
            "",
            None,
            told.kept >= SHARE,
            "promised tolerances are kept in 95 %",
            error=f"{100 * told.kept:.1f} % of {told.promised}",
        ),
        Row(
            f"{name}.cost",
            "cheapest that keeps the tolerance",
            told.together,
            told.cheap >= SHARE,
            "no more than 1.5 times the cheapest in 95 %",
            ratio_max=told.dearest,
            error=f"{100 * told.cheap:.1f} % of {told.judged}",
        ),
    ]


def run(quick: bool) -> list[Row]:
    """All tasks."""
    rows = []
    for task, trial in TASKS.items():
        rows += rows_of(task, verdict([trial(seed) for seed in range(QUICK if quick else SCENES)]))
    return rows
