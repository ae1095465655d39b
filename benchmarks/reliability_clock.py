"""Fitted clocks against simulated ones: is the error under half a millisecond, and does the uncertainty cover it?"""

from __future__ import annotations

import numpy as np
from scipy.stats import binom

from benchmarks.clock_cases import CASES, Case, Trial, run_trial
from benchmarks.rows import Row

TRIALS, QUICK_TRIALS = 400, 30
COVERAGE = 0.95
"""Share of errors that must lie within two reported uncertainties."""
CHANCE = 1e-4
"""Probability with which chance alone may fail a case that covers just as much."""


def run(quick: bool) -> list[Row]:
    """Try all cases."""
    trials = {case: [run_trial(case, seed) for seed in range(QUICK_TRIALS if quick else TRIALS)] for case in CASES}
    rows = [row for case, done in trials.items() for row in rows_of(case, done)]
    return [*rows, _coverage("all", [trial for done in trials.values() for trial in done])]


def rows_of(case: Case, trials: list[Trial]) -> list[Row]:
    """The rows of one case: its error with its limit, if it has one, and how often the uncertainty covers it."""
    rms = float(np.sqrt(np.mean([trial.rms_s**2 for trial in trials])))
    limit = case.limit_s
    error = Row(
        name=f"reliability.clock.{case.name}",
        peer="",
        ratio=None if limit is None else rms / limit,
        ok=limit is None or rms < limit,
        target="error told only" if limit is None else f"rms error under {limit * 1e3:g} ms",
        error=rms,
    )
    return [error, _coverage(case.name, trials)]


def _coverage(name: str, trials: list[Trial]) -> Row:
    covered = sum(abs(trial.error_s) <= 2 * trial.sd_s for trial in trials)
    least = least_covered(len(trials))
    return Row(
        name=f"reliability.clock.{name}.coverage",
        peer="",
        ratio=covered / len(trials) / COVERAGE,
        ok=covered >= least,
        target=f"{COVERAGE:.0%} within 2 sigma: at least {least} of {len(trials)}",
        error=f"{covered} of {len(trials)}",
    )


def least_covered(trials: int) -> int:
    """Fewest covered trials that a true coverage of :data:`COVERAGE` explains, but for :data:`CHANCE`."""
    return int(binom.ppf(CHANCE, trials, COVERAGE))
