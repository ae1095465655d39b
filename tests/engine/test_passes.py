"""Passes: the radar records without a gap while the trolley runs, and every fix of the way is kept. In this process."""

from __future__ import annotations

import math
import threading
import time

import fake_devices
import numpy as np
import pytest

from drivers.errors import DeviceLost
from drivers.records import Channel
from polfuse_lab.plans.steps import PASS_POSITIONS
from polfuse_lab.records import SweepFlag
from polfuse_lab.replay import replay
from polfuse_lab.scheduler import Outcome, clock_watch
from polfuse_lab.session import info, open_session
from polfuse_lab.session.runs import gapless_runs
from polfuse_lab.session.track import TrolleyTrack, sample_times

pytestmark = pytest.mark.realtime

PLAN = """\
kind = "continuous_sar"
aperture_m = {aperture}
speed_m_s = {speed}
block_s = {block}
move_settle_s = 0.0
channels = ["HH", "HV"]
"""
RATE = 48_000


def write_plan(bench, *, aperture: float = 1.0, speed: float = 1.0, block: float = 0.2, **options) -> None:
    bench.write(**options)
    bench.plan.write_text(PLAN.format(aperture=aperture, speed=speed, block=block))


class Run(threading.Thread):
    """A scheduler in a thread, steered by a test."""

    def __init__(self, bench) -> None:
        super().__init__()
        self.scheduler = bench.scheduler()
        self.outcome: Outcome | None = None
        self.start()

    def run(self) -> None:
        self.outcome = self.scheduler.run()

    def until(self, condition) -> None:
        end = time.monotonic() + 20
        while not condition(status := self.scheduler.status()):
            assert time.monotonic() < end, status
            assert self.outcome is None, self.outcome
            time.sleep(0.002)

    def end(self) -> Outcome:
        self.join(30)
        assert self.outcome is not None
        return self.outcome


def in_the_middle(status) -> bool:
    """Of the second pass: its first records are kept."""
    return status.position == 1 and status.sweeps >= 9


def test_a_pass_is_recorded_without_a_gap_and_knows_its_way(bench, monkeypatch):
    monkeypatch.setattr(clock_watch, "CLOCK_AFTER_S", (0.2,))
    write_plan(bench)
    outcome = bench.run()
    assert outcome.state == "finished", outcome.reason
    assert (outcome.positions, outcome.samples_lost) == (2, 0)
    with open_session(bench.session) as session:
        rows = session.sweeps
        assert set(rows["flags"].tolist()) == {int(SweepFlag.CONTINUOUS)}
        # 1 m at 1 m/s in blocks of 0.2 s: five, and where it started late the one in which it came to a stand.
        first, second = (len(run.indices) for run in gapless_runs(session))
        assert {first, second} <= {5, 6, 7}
        assert [run.channel for run in gapless_runs(session)] == [Channel.HH, Channel.HV]
        assert rows["position"].tolist() == [*range(first), *range(PASS_POSITIONS, PASS_POSITIONS + second)]
        for part in (rows[:first], rows[first:]):
            assert (np.diff(part["device_frame"]) == part["samples"][:-1]).all()
        # At the fake's exact times the trolley ran evenly: x is a straight line in time, forth and back.
        track = TrolleyTrack.of(session)
        for part, sign in ((rows[1:4], 1.0), (rows[first + 1 : first + 4], -1.0)):
            slope = np.polyfit((part["t_host_ns"] - part["t_host_ns"][0]) * 1e-9, part["x_m"], 1)[0]
            assert slope == pytest.approx(sign, abs=0.1)
        # More than ten fixes a second all the way, and what was seen belongs to the record during which it was seen.
        under_way = session.trolley[session.trolley["record"] >= 0]
        assert len(under_way) >= 2 * 10
        assert set(under_way["record"].tolist()) == set(range(len(rows)))
        for row in under_way:
            record = rows[row["record"]]
            since_s = (int(row["t_host_ns"]) - int(record["t_host_ns"])) * 1e-9
            # During it, or at the look that completes it (on a busy machine a little later).
            assert -0.1 < since_s < 0.2 + 1.0
        middle = int(rows["t_host_ns"][2]) + 100_000_000
        x_m, sd_m = track.at(np.array([middle]))
        assert x_m[0] == pytest.approx(rows["x_m"][2], abs=0.02)
        assert 0.0005 <= sd_m[0] < 0.05
        # Where pass and motion began and ended.
        texts = [bytes(text).decode() for text in session.events["text"][session.events["kind"] == b"pass"]]
        assert [text.split(" from")[0].split(" at")[0] for text in texts] == [
            "pass 0 begins", "pass 0 ends", "pass 1 begins", "pass 1 ends"]  # fmt: skip
        assert texts[1].endswith("x = +0.5000 m")
        assert track.speed_m_s(np.array([middle]))[0] == pytest.approx(1.0, abs=0.3)
        # Clock pairs are taken in passes too.
        inside = (session.clocks["t_host_ns"] > rows["t_host_ns"][0]) & (
            session.clocks["t_host_ns"] < rows["t_host_ns"][first - 1]
        )
        assert inside.sum() >= 2
        times_ns, _ = sample_times(session, 2, np.array([0.0, 4800.0]))
        assert times_ns[1] - times_ns[0] == pytest.approx(100_000_000, rel=1e-3)
        assert abs(int(times_ns[0]) - int(rows["t_host_ns"][2])) < 100_000_000
    assert info(bench.session)["problems"] == []
    assert replay(bench.session, bench.folder / "copy.h5").differences == ()


def test_pause_holds_the_trolley_and_the_pass_is_repeated_from_its_start(bench):
    write_plan(bench, aperture=2.0)
    run = Run(bench)
    run.until(lambda s: s.position == 1 and s.sweeps >= 13)
    run.scheduler.control.pause()
    run.until(lambda s: s.state == "paused")
    stood = run.scheduler.status().x_m
    assert -0.95 < stood < 0.95  # in the middle of its way
    time.sleep(0.2)
    assert run.scheduler.status().x_m == stood
    run.scheduler.control.resume()
    assert run.end().state == "finished"
    with open_session(bench.session) as session:
        rows = session.sweeps
        second = rows[rows["position"] >= PASS_POSITIONS]
        first_try = second[second["attempt"] == 0]
        repeated = second[(second["flags"] & int(SweepFlag.REPEATED)) > 0]
        assert (repeated["attempt"][0], repeated["position"][0]) == (1, PASS_POSITIONS)
        assert len(repeated) > len(first_try[first_try["t_host_ns"] < repeated["t_host_ns"][0]]) >= 1
        # The whole pass is there once, from the repetition.
        (_, run_1) = gapless_runs(session)
        assert len(run_1.indices) == len(repeated)
        kinds = [bytes(kind).decode() for kind in session.events["kind"] if kind != b"pass"]
        assert kinds == ["paused", "resumed", "finished"]
        paused = session.events["text"][session.events["kind"] == b"paused"][0]
        # 4 steps for each pass: move, select, pass, checkpoint.
        assert paused == b"paused by the user in step 7"
    assert replay(bench.session, bench.folder / "copy.h5").differences == ()


@pytest.mark.parametrize("state", ["running", "standing back"])
def test_abort_in_a_pass_within_a_second(bench, state):
    write_plan(bench, aperture=2.0, speed=0.5)
    run = Run(bench)
    run.until(lambda s: s.sweeps >= 2)
    if state == "standing back":
        run.scheduler.control.pause()
    asked = time.monotonic_ns()
    run.scheduler.control.abort("rain")
    assert run.end().state == "aborted"
    safe = {what.split()[0]: t for t, what in bench.events() if what.endswith("safe")}
    assert set(safe) == {"radar", "switches", "trolley"}
    assert max(safe.values()) - asked < 1e9
    assert replay(bench.session, bench.folder / "copy.h5").differences == ()


def lose_once(monkeypatch, kind: type, method: str, condition) -> None:
    """Let a fake device be lost at its first call of a method for which a condition holds."""
    original, lost = getattr(kind, method), []

    def failing(self, *args):
        if not lost and condition(self):
            lost.append(1)
            raise DeviceLost("unplugged", where=f"fake {kind.kind}", advice="plug it in")
        return original(self, *args)

    failing.__name__ = method
    monkeypatch.setattr(kind, method, failing)


@pytest.mark.parametrize(("kind", "method"), [("Radar", "poll"), ("Switches", "state")])
def test_a_device_lost_in_a_pass(bench, monkeypatch, kind, method):
    """The trolley is held, the device comes back, the pass is begun again at its start and marked."""
    write_plan(bench, aperture=1.0)
    stream = {"radar": None}
    original = fake_devices.Radar.begin_stream

    def begin_stream(self, frames):
        stream["radar"] = self
        original(self, frames)

    monkeypatch.setattr(fake_devices.Radar, "begin_stream", begin_stream)
    lose_once(
        monkeypatch,
        getattr(fake_devices, kind),
        method,
        lambda device: stream["radar"] is not None and stream["radar"].stream and stream["radar"].count > 3,
    )
    outcome = bench.run()
    assert outcome.state == "finished", outcome.reason
    monkeypatch.undo()
    with open_session(bench.session) as session:
        kinds = [bytes(k).decode() for k in session.events["kind"] if k != b"pass"]
        assert kinds == ["lost", "back", "resumed", "finished"]
        rows = session.sweeps
        again = rows[(rows["flags"] & int(SweepFlag.REPEATED)) > 0]
        assert (again["position"][0], again["attempt"][0]) == (0, 1)
        # From the start: the first fix of the repetition is there.
        assert again["x_m"][0] == pytest.approx(-0.4, abs=0.1)
        assert (
            list(gapless_runs(session)[0].indices) == np.flatnonzero(rows["flags"] & int(SweepFlag.REPEATED)).tolist()
        ), rows[["flags", "position", "attempt"]]
    assert replay(bench.session, bench.folder / "copy.h5").differences == ()


def test_switches_that_move_in_a_pass_flag_the_record_and_the_pass_is_taken_again(bench, monkeypatch):
    write_plan(bench)
    original, jumped = fake_devices.Switches.state, []

    def state(self):
        if not jumped and self.states > 4:
            jumped.append(1)
            self.route = "VV"
        return original(self)

    monkeypatch.setattr(fake_devices.Switches, "state", state)
    assert bench.run().state == "finished"
    monkeypatch.undo()
    with open_session(bench.session) as session:
        rows = session.sweeps
        bad = rows[(rows["flags"] & int(SweepFlag.SWITCH_CHANGED)) > 0]
        assert len(bad) >= 1
        assert set(bad["attempt"].tolist()) == {0}
        again = np.flatnonzero((rows["flags"] & int(SweepFlag.RETRY)) > 0)
        assert len(again) >= 5
        # Nothing of the first attempt is used.
        assert list(gapless_runs(session)[0].indices) == again.tolist()
        for run in gapless_runs(session):
            assert not (rows[list(run.indices)]["flags"] & int(SweepFlag.SWITCH_CHANGED)).any()
    assert replay(bench.session, bench.folder / "copy.h5").differences == ()


def test_a_trolley_that_does_not_measure_its_way_is_refused(bench, monkeypatch):
    write_plan(bench)
    original = fake_devices.Trolley.poll

    def poll(self):
        fix = original(self)
        return type(fix)(0.0, 0.9, fix.moving, fix.t_host_ns, fix.state) if fix.moving else fix

    monkeypatch.setattr(fake_devices.Trolley, "poll", poll)
    outcome = bench.run()
    assert outcome.state == "failed"
    assert "does not measure where it is while it moves" in outcome.reason


def test_a_radar_that_cannot_record_without_a_gap_is_refused(bench, monkeypatch):
    write_plan(bench)
    members = {name: item for name, item in vars(fake_devices.Radar).items() if not name.startswith("__")}
    del members["begin_stream"]
    monkeypatch.setattr(fake_devices, "Radar", type("Radar", (fake_devices.Base,), members))
    outcome = bench.run()
    assert outcome.state == "failed"
    assert "its driver 'fake' cannot record without a gap" in outcome.reason


def test_positions_between_fixes_carry_their_uncertainty():
    # A trolley at 0.1 m/s that stops at 10 s; fixes every 0.1 s with 0.3 mm.
    t = np.arange(0, 120) * 100_000_000 + 5_000_000_000_000
    x = np.minimum((t - t[0]) * 1e-9, 10.0) * 0.1
    track = TrolleyTrack(t, x, np.full(len(t), 3e-4))
    at = t[0] + np.array([2_550_000_000, 11_000_000_000])
    found, sd = track.at(at, 0.01)
    np.testing.assert_allclose(found, [0.255, 1.0], atol=1e-12)
    # Even motion: the fixes' and 10 ms at 0.1 m/s; at rest the fixes' alone.
    np.testing.assert_allclose(sd, [math.hypot(3e-4, 1e-3), 3e-4], rtol=1e-9)
    # Next to the stop the way between fixes is bent: more uncertain, by at most the speed over a gap.
    _, (bent,) = track.at(t[:1] + 9_950_000_000)
    assert 3e-4 < bent < 0.01
    # Outside nothing is known.
    assert np.isnan(track.at(np.array([t[0] - 1, t[-1] + 1]))).all()
    assert track.speed_m_s(at).tolist() == pytest.approx([0.1, 0.0])
