"""What the benchmark ``accuracy.planners`` concludes from its trials, by hand; and one trial of the quick planners."""

from __future__ import annotations

import math

import pytest

from benchmarks.accuracy_planners import rows_of, verdict
from benchmarks.planner_trials import (
    Trial,
    demosaic_trial,
    registration_trial,
    resampling_trial,
    storage_trial,
    window_trial,
)


def test_verdict_by_hand() -> None:
    trials = [
        Trial("a", 1.0, True, True, 1.0, 1.0),
        Trial("a", -7.0, True, True, 3.0, 1.0),  # pessimistic by more than a factor of two, three times as dear
        Trial("b", 6.5, True, False, 1.0, 2.0),  # optimistic: cheap, and not kept
        Trial("b", 0.0, False, False, 9.0, math.inf),  # nothing keeps it, and nothing was promised
    ]
    told = verdict(trials)
    assert (told.scenes, told.within, told.lowest_db, told.highest_db) == (4, 0.5, -7.0, 6.5)
    assert (told.promised, told.kept) == (3, pytest.approx(2 / 3))
    assert (told.judged, told.cheap, told.dearest) == (3, pytest.approx(2 / 3), 3.0)
    assert told.together == pytest.approx(5 / 4)
    assert [row.ok for row in rows_of("x", told)] == [False, False, False, False]
    assert all(row.ok for row in rows_of("x", verdict(trials[:1])))
    nothing = verdict(trials[3:])
    assert (nothing.judged, nothing.kept, nothing.together) == (0, 1.0, 1.0)


@pytest.mark.parametrize("trial", [window_trial, demosaic_trial, registration_trial, resampling_trial, storage_trial])
def test_one_scene(trial) -> None:
    made = trial(3)
    assert abs(made.off_db) <= 6.02
    assert 0 < made.cost < 1
    assert made.kept or not made.promised
