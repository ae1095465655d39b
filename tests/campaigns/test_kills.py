"""The kill campaign, short: the same trials as ``python -m benchmarks reliability.kill``, fewer of them."""

from __future__ import annotations

import sys

import pytest

from benchmarks.kill_trial import Case, Trial
from benchmarks.reliability_kill import QUICK, cases, rows, run_all, run_trial, table

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are found by /proc")

# Killed early in the collect: by then nothing has been written unless somebody flushed it.
DEFECT = Case(21, "writer", "recording", early_answers=True)


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    """All trials at once; they mostly wait."""
    return list(run_all(run_trial, (*QUICK, DEFECT), workers=4))


@pytest.mark.timeout(300)
def test_no_kill_breaks_a_promise(trials):
    good = [trial for trial in trials if trial.case != DEFECT]
    assert {trial.case: trial.problems for trial in good if trial.problems} == {}
    assert all(row.ok for row in rows(good, 1.0))
    # The trials were real ones: data had been delivered and confirmed, and some of it was lost where it may be.
    assert sum(trial.confirmed for trial in good) > 100
    assert sum(trial.delivered for trial in good) > 50
    assert {trial.how for trial in good} >= {"closed", "recovered"}


@pytest.mark.timeout(300)
def test_a_writer_that_answers_before_it_flushes_is_found_out(trials):
    (trial,) = [trial for trial in trials if trial.case == DEFECT]
    assert trial.confirmed > 0
    assert any(problem.startswith("confirmed and lost") for problem in trial.problems)
    assert not all(row.ok for row in rows([trial], 1.0))
    assert "(1 bad)" in table([trial])


def test_a_seed_gives_the_same_kills_over_all_processes_and_phases():
    chosen = cases(300)
    assert chosen == cases(300)
    assert chosen != cases(300, seed=1)
    assert sum(case.blow == "kill" for case in chosen) == 300
    kills = {(case.process, case.phase) for case in chosen if case.blow == "kill"}
    assert {process for process, _ in kills} == {"engine", "writer", "camera", "guard", "recover"}
    for process in ("engine", "writer", "camera"):
        assert {phase for name, phase in kills if name == process} >= {
            "preparing", "moving", "recording", "optics", "flushing", "closing"}  # fmt: skip
