"""The campaign of failing disks, short: ``python -m benchmarks reliability.disk_full`` does it at length."""

from __future__ import annotations

import sys

import pytest

from benchmarks.disk_trial import DiskCase, run_disk_trial
from benchmarks.reliability_kill import run_all

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are found by /proc")


@pytest.mark.timeout(300)
def test_a_collect_stops_in_good_order_and_goes_on_elsewhere():
    cases = (DiskCase(1), DiskCase(2), DiskCase(3, "deleted"), DiskCase(4, "EIO at the end too"))
    trials = list(run_all(run_disk_trial, cases, workers=4))
    if all(trial.skipped for trial in trials):
        pytest.skip(trials[0].skipped)
    assert {trial.case: trial.problems for trial in trials if trial.problems} == {}
    stopped = [trial for trial in trials if trial.outcome.startswith("failed")]
    assert stopped
    assert all(trial.rest.startswith("finished") for trial in stopped)
    assert all(0 < trial.kept <= trial.queued for trial in stopped)
