"""A device is lost in the middle of a collect: over real serial lines, with a real writer process and session file."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from fault_bench import FaultBench

from drivers.records import Channel
from hw_mocks.faults import FaultKind
from polfuse_lab.clocks import clock_runs, sync_rms_s
from polfuse_lab.records import SweepFlag
from polfuse_lab.scheduler import Outcome, RunStatus, Scheduler
from polfuse_lab.session import open_session
from polfuse_lab.session.layout import TABLES


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[FaultBench]:
    with FaultBench(tmp_path) as made:
        yield made


class Run:
    """A scheduler at work in a thread, watched from the test's."""

    def __init__(self, scheduler: Scheduler) -> None:
        self.scheduler = scheduler
        self.outcome: Outcome | None = None
        self.thread = threading.Thread(target=self._work)
        self.thread.start()

    def _work(self) -> None:
        self.outcome = self.scheduler.run()

    def until(self, condition: Callable[[RunStatus], bool], timeout_s: float = 20.0) -> RunStatus:
        end = time.monotonic() + timeout_s
        while not condition(status := self.scheduler.status()):
            assert time.monotonic() < end, f"waited in vain, last: {status}"
            assert self.outcome is None, self.outcome
            time.sleep(0.005)
        return status

    def wait(self) -> Outcome:
        self.thread.join(40)
        assert self.outcome is not None
        return self.outcome


def at_rest(status: RunStatus) -> bool:
    """At the second position, where something has been recorded: the trolley stands."""
    return status.position == 1 and "recording" in status.reason


@pytest.mark.parametrize("kind", ["switches", "trolley", "radar"])
def test_unplugged_and_put_back_the_collect_goes_on_from_its_checkpoint(bench: FaultBench, kind: str) -> None:
    bench.write_plan(sweeps=10)
    run = Run(bench.scheduler())
    run.until(at_rest)
    time.sleep(0.15)  # the record takes 0.4 s: trolley and switches have been asked, and will be again
    lost = time.monotonic()
    bench.simulated.faults[kind].start(FaultKind.DISCONNECT, for_s=1.0)
    status = run.until(lambda s: s.state == "paused")
    assert time.monotonic() - lost < 2
    assert f"{kind} lost: " in status.reason or f"for the {kind} to come back" in status.reason
    outcome = run.wait()
    assert (outcome.state, outcome.positions) == ("finished", 3), outcome.reason
    with open_session(bench.session) as session:
        assert session.complete
        words = [k.decode() for k in session.events["kind"]]
        assert words == ["lost", "back", "resumed", "finished"]
        rows = session.sweeps
        latest = {(int(r["position"]), int(r["channel"])): r for r in rows}
        assert len(latest) == 3 * 2
        repeated = rows[(rows["flags"] & int(SweepFlag.REPEATED)) > 0]
        assert set(repeated["position"]) <= {1}
        # Whatever had been recorded before the loss is there, and was recorded once more.
        before = rows[(rows["position"] == 1) & (rows["attempt"] == 0)]
        assert len(before) >= len(repeated)
        assert len(repeated) >= (kind != "radar")  # the radar's record under way could not be finished
        if kind == "switches":
            # The record under way when they were lost is kept, and says that its route was not verified.
            unverified = rows[(rows["flags"] & int(SweepFlag.SWITCH_UNVERIFIED)) > 0]
            assert [(r["position"], r["channel"], r["attempt"]) for r in unverified] == [(1, int(Channel.HH), 0)]
    # Every position was reached: the trolley's true place is the one in the last record.
    assert bench.world.trolley_x_m.at() == pytest.approx(0.05, abs=1e-6)


def test_records_before_the_loss_are_on_the_disk_while_it_is_waited(bench: FaultBench) -> None:
    bench.write_plan(sweeps=5, reconnect_wait_s=60)
    run = Run(bench.scheduler())
    run.until(at_rest)
    bench.wire("switches").faults.start(FaultKind.DISCONNECT)
    status = run.until(lambda s: s.state == "paused" and "waiting up to 60 s" in s.reason)
    # A reader in another process would see exactly this: the partial file, read while it is written.
    import h5py
    import hdf5plugin  # noqa: F401 (registers the filter)

    with h5py.File(bench.session.with_name("s.h5.partial"), "r", swmr=True) as file:
        assert len(file["sweeps"]) == status.sweeps >= 2
    asked = time.monotonic()
    run.scheduler.control.abort()
    outcome = run.wait()
    assert time.monotonic() - asked < 5
    assert outcome.state == "aborted"
    with open_session(bench.session) as session:
        assert len(session.sweeps) == outcome.sweeps == status.sweeps


def test_a_device_that_does_not_come_back_ends_the_collect_with_the_reason(bench: FaultBench) -> None:
    bench.write_plan(sweeps=5, reconnect_wait_s=1)
    run = Run(bench.scheduler())
    run.until(at_rest)
    bench.wire("trolley").faults.start(FaultKind.DISCONNECT)
    outcome = run.wait()
    assert outcome.state == "failed"
    assert "GRBL trolley on" in outcome.reason
    assert "did not come back within 1 s" in outcome.reason
    assert "\n" not in outcome.reason
    with open_session(bench.session) as session:
        assert (session.state, len(session.sweeps)) == ("failed", outcome.sweeps)


def test_not_waiting_is_a_choice(bench: FaultBench) -> None:
    bench.write_plan(sweeps=5, reconnect_wait_s=0)
    run = Run(bench.scheduler())
    run.until(at_rest)
    lost = time.monotonic()
    bench.wire("trolley").faults.start(FaultKind.DISCONNECT, for_s=0.5)
    outcome = run.wait()
    assert outcome.state == "failed"
    assert "connection was lost" in outcome.reason
    assert time.monotonic() - lost < 5


@pytest.mark.parametrize("confirmed", [True, False])
def test_a_controller_that_restarted_is_only_believed_when_the_operator_confirms(
    bench: FaultBench, confirmed: bool
) -> None:
    bench.write_plan(sweeps=5, reconnect_wait_s=2)
    run = Run(bench.scheduler())
    run.until(at_rest)
    # Without supply the trolley is pushed to the rail's left end, where the controller begins to count from 0.
    bench.world.trolley_x_m.hold(-0.5)
    bench.wire("trolley").handler.power_cycle()  # type: ignore[attr-defined]
    bench.wire("trolley").wake()
    run.until(lambda s: s.state == "paused" and "waiting for the operator" in s.reason)
    ((ticket, prompt),) = run.scheduler.prompts.open()
    assert "says that it stands at x = -0.500 m (last seen at x = +0.000 m)" in prompt
    if confirmed:
        run.scheduler.prompts.answer(ticket)
        assert run.wait().state == "finished"
    else:
        outcome = run.wait()
        assert outcome.state == "failed"
        assert "nobody confirmed that it stands there" in outcome.reason
    assert run.scheduler.prompts.open() == []


def test_an_alarm_is_no_loss_and_ends_the_collect(bench: FaultBench) -> None:
    # 0.2 m short after the second move: the third one runs into the switch at the rail's left end.
    bench.write_plan(sweeps=1, aperture=0.9, step=0.45)
    bench.wire("trolley").faults.start(FaultKind.LOST_STEPS, for_count=1, amount=0.2)
    outcome = Run(bench.scheduler()).wait()
    assert outcome.state == "failed"
    assert "ALARM:1" in outcome.reason
    assert bench.session.exists()


def clock_table(device_s: list[float], host_s: list[float]) -> np.ndarray:
    rows = np.zeros(len(device_s), TABLES["clocks"])
    rows["device"], rows["t_device_s"], rows["round_trip_ns"] = b"radar", device_s, 1000
    rows["t_host_ns"] = [round(t * 1e9) for t in host_s]
    return rows


def test_a_clock_that_began_anew_is_fitted_in_runs() -> None:
    # Two runs without any error, the second one from 0 again: the residual of each is 0, that of one line is seconds.
    host = [100.0 + i for i in range(10)] + [130.0 + i for i in range(5)]
    device = [float(i) for i in range(10)] + [float(i) for i in range(5)]
    rows = clock_table(device, host)
    assert clock_runs(rows["t_device_s"], rows["t_host_ns"]) == [slice(0, 10), slice(10, 15)]
    assert sync_rms_s(rows) == pytest.approx(0, abs=1e-9)


def test_drift_is_one_run() -> None:
    host = [100.0 + 30 * i for i in range(10)]
    rows = clock_table([(t - 100) * (1 + 900e-6) for t in host], host)
    assert clock_runs(rows["t_device_s"], rows["t_host_ns"]) == [slice(0, 10)]
