"""Every device with every fault that it can have, on a simulated device over its real wire, with short time-outs.

What is expected of each is stated in ``benchmarks.fault_matrix.CASES``; all devices are tried at the same time.
"""

from __future__ import annotations

import pytest

from benchmarks.fault_matrix import CASES, After, Case, Trial, attempt, combinations, table
from benchmarks.fault_stands import missing
from benchmarks.reliability_faults import PAGE, try_all
from benchmarks.stand import Hung, Untruthful
from drivers.errors import DeviceLost, DeviceTimeout
from hw_mocks.faults import FaultKind


@pytest.fixture(scope="module")
def trials() -> dict[str, Trial]:
    return {trial.case.key: trial for trial in try_all(quick=True)}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.key)
def test_a_fault_is_noticed_told_and_survived(case: Case, trials: dict[str, Trial]) -> None:
    if missing(case.device):
        pytest.skip(f"{case.device} {missing(case.device)}")
    trial = trials[case.key]
    assert not trial.problems, f"{trial.kind} after {trial.detected_s} s: {trial.sentence}"
    assert (trial.detected_s is None) == (not case.raises)


def test_the_committed_table_lists_exactly_what_is_tested() -> None:
    listed = combinations(PAGE.read_text(encoding="utf-8"))
    assert listed == [case.key for case in CASES]
    assert "not as documented" not in PAGE.read_text(encoding="utf-8")


def test_every_case_is_another_one() -> None:
    assert len({case.key for case in CASES}) == len(CASES)


class Driver:
    def __init__(self) -> None:
        self.opened = 1

    def open(self) -> None:
        self.opened += 1

    def close(self) -> None:
        self.opened -= 1


class FakeStand:
    """A stand whose rounds fail as told while the fault lasts, and (with ``broken``) ever after."""

    name = "fake"
    timeout_s = opening_s = 0.1

    def __init__(self, failure: Exception | None, *, broken: bool = False) -> None:
        self.driver = Driver()
        self.failure = failure
        self.broken = broken
        self.active = False

    def round(self) -> None:
        if self.active and self.failure is not None:
            raise self.failure

    def begin(self, kind: FaultKind, amount: float) -> None:
        self.active = True

    def end(self, kind: FaultKind) -> None:
        self.active = self.broken

    def reset(self) -> None:
        pass

    def close(self) -> None:
        pass


SILENCE = Case("fake", FaultKind.SILENCE, After.BY_ITSELF, (DeviceTimeout,))
TIMEOUT = DeviceTimeout("no answer", where="fake on PORT", advice="switch it on")


@pytest.mark.parametrize(
    ("stand", "problem"),
    [
        (FakeStand(TIMEOUT), None),
        (FakeStand(None), "was not noticed"),
        (FakeStand(DeviceLost("gone", where="fake", advice="plug it in")), "raised DeviceLost"),
        (FakeStand(DeviceTimeout("a\nb", where="fake", advice="c")), "not one sentence"),
        (FakeStand(DeviceTimeout("no", where="", advice="c")), "not 'where: what; advice'"),
        (FakeStand(Untruthful("says 1, is 2")), "untruthful"),
        (FakeStand(Hung("no end")), "hung"),
        (FakeStand(TIMEOUT, broken=True), "does not work afterwards"),
    ],
)
def test_a_trial_finds_what_is_not_as_documented(stand: FakeStand, problem: str | None) -> None:
    trial = attempt(SILENCE, stand)
    assert trial.ok == (problem is None), trial.problems
    assert problem is None or any(problem in found for found in trial.problems)
    assert f"not as documented: {trial.problems[0]}" in table([trial]) if problem else True


def test_a_fault_that_does_no_harm_is_wrong_when_it_does() -> None:
    harmless = Case("fake", FaultKind.SLOW, After.GOES_ON)
    assert attempt(harmless, FakeStand(None)).ok
    assert not attempt(harmless, FakeStand(TIMEOUT)).ok


def test_a_table_says_what_it_lists() -> None:
    trial = attempt(SILENCE, FakeStand(TIMEOUT))
    assert combinations(table([trial])) == ["fake, silence"]
