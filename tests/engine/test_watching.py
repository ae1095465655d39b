"""Nothing moves unseen: what is looked at while something is recorded, and what follows when it moved. In this process.

Each recording is replayed as well: the copy has to be the same to the last bit.
"""

from __future__ import annotations

import math
import threading
import time

import fake_devices
import numpy as np
import pytest

from drivers.records import Channel, PolarizerFix
from polfuse_lab.plans import load_plan, plan_to_toml
from polfuse_lab.plans.custom import custom_plan
from polfuse_lab.plans.steps import (
    Checkpoint,
    Expose,
    MoveTo,
    RecordSeconds,
    RecordSweeps,
    SelectChannel,
    StartTurn,
    TurnPolarizer,
    TurnSource,
)
from polfuse_lab.records import FrameFlag, SweepFlag
from polfuse_lab.replay import replay
from polfuse_lab.scheduler import watch
from polfuse_lab.session import info, open_session

pytestmark = pytest.mark.realtime

SOURCE = '[source_polarizer]\ndriver = "fake"\noptions = {}\n'


def same(bench) -> None:
    assert [str(d) for d in replay(bench.session, bench.folder / "copy.h5").differences] == []


def custom(bench, *steps, optics: bool = False, source: bool = False, **options) -> None:
    """A plan of these steps on the bench."""
    bench.write(optics=optics, **options)
    if source:
        bench.rig.write_text(bench.rig.read_text() + SOURCE)
    bench.plan.write_text(plan_to_toml(custom_plan(steps)))
    assert load_plan(bench.plan).kind == "custom"


def test_a_trolley_bumped_during_a_record_goes_back_and_the_record_is_taken_again(bench, monkeypatch):
    bench.write(aperture=0.5, sweeps=10)
    original, records = fake_devices.Radar.begin, []
    trolleys = []
    poll = fake_devices.Trolley.poll

    def begin(self, frames):
        records.append(frames)
        if len(records) == 3:  # the probe, HH, and now HV at the first position
            trolleys[-1].x += 0.004
            trolleys[-1].target = trolleys[-1].x
        original(self, frames)

    def remembered(self):
        trolleys.append(self)
        return poll(self)

    monkeypatch.setattr(fake_devices.Radar, "begin", begin)
    monkeypatch.setattr(fake_devices.Trolley, "poll", remembered)
    outcome = bench.run()
    assert outcome.state == "finished", outcome.reason
    monkeypatch.undo()
    assert any("position 0, HV: the trolley moved during the record; taken again" in w for w in outcome.warnings)
    with open_session(bench.session) as session:
        rows = session.sweeps
        assert rows["flags"].tolist() == [0, int(SweepFlag.MOVED), int(SweepFlag.RETRY), 0, 0]
        # The trolley has been sent back: the record that counts was taken where it should be.
        np.testing.assert_allclose(rows["x_m"], [-0.25, -0.25, -0.25, 0.25, 0.25], atol=1e-9)
        seen = session.trolley[session.trolley["record"] == 1]
        assert np.abs(seen["x_m"] + 0.246).max() < 1e-9
        assert [record.index for record in session.select(position=0, latest=True)] == [0, 2]
    assert info(bench.session)["problems"] == ["1 audio records saw the trolley move where it should have stood"]
    same(bench)


def test_a_trolley_that_keeps_being_moved_ends_the_collect(bench, monkeypatch):
    bench.write(aperture=0.5, sweeps=10)
    poll = fake_devices.Trolley.poll
    began = []

    def creeping(self):
        fix = poll(self)
        if began and not fix.moving:
            fix = type(fix)(fix.x_m + 0.005 * (time.monotonic() - began[0]) / 0.1, *list(vars(fix).values())[1:])
        return fix

    begin = fake_devices.Radar.begin

    def first(self, frames):
        began[:] = [time.monotonic()]
        begin(self, frames)

    monkeypatch.setattr(fake_devices.Trolley, "poll", creeping)
    monkeypatch.setattr(fake_devices.Radar, "begin", first)
    outcome = bench.run()
    monkeypatch.undo()
    assert outcome.state == "failed"
    assert "the trolley moved during the record in each of 3 records at position 0, HH" in outcome.reason
    assert "look what pushes or pulls the trolley" in outcome.reason
    same(bench)


def test_switches_that_jump_and_come_back_in_the_middle_of_a_record_are_seen(bench, monkeypatch):
    """Before and after the record they stand right: only the looks in between can tell."""
    bench.write(aperture=0.5, sweeps=30)
    monkeypatch.setattr(watch, "SWITCHES_LOOK_S", 0.1)
    state = fake_devices.Switches.state
    began: list[float] = []
    begin = fake_devices.Radar.begin

    def jumping(self):
        route, since = self.route, time.monotonic() - began[1] if len(began) == 2 else 0.0
        self.route = "VV" if 0.15 < since < 1.0 else route
        found = state(self)
        self.route = route
        return found

    def noted(self, frames):
        began.append(time.monotonic())  # the probe, then the first record (1.3 s)
        begin(self, frames)

    monkeypatch.setattr(fake_devices.Switches, "state", jumping)
    monkeypatch.setattr(fake_devices.Radar, "begin", noted)
    assert bench.run().state == "finished"
    monkeypatch.undo()
    with open_session(bench.session) as session:
        assert session.sweeps["flags"].tolist()[:2] == [int(SweepFlag.SWITCH_CHANGED), int(SweepFlag.RETRY)]
        asked = session.switches[session.switches["record"] == -1]
        assert {bytes(row["transmit"]) for row in asked} == {b"H"}
        seen = session.switches[session.switches["record"] == 0]
        assert b"V" in seen["transmit"].tolist()
    same(bench)


def test_a_polarizer_that_slips_during_a_frame_turns_back_and_the_frame_is_taken_again(bench, monkeypatch):
    bench.write(aperture=0.5, optics=True)
    poll, polls = fake_devices.Polarizer.poll, []

    def slipping(self):
        if math.isclose(self.angle, math.radians(45)):
            polls.append(1)
            if len(polls) == 2:  # once at the end of the turn, and now after the third frame
                self.angle += math.radians(3)
        return poll(self)

    monkeypatch.setattr(fake_devices.Polarizer, "poll", slipping)
    outcome = bench.run()
    assert outcome.state == "finished", outcome.reason
    monkeypatch.undo()
    with open_session(bench.session) as session:
        flags = session.frames["flags"].tolist()
        assert flags == [0, 0, int(FrameFlag.MOVED), int(FrameFlag.RETRY), 0, 0, 0, 0, 0]
        # The frame says where the polarizer had been turned to; what it was seen to do stands beside it.
        (seen,) = session.polarizer[session.polarizer["record"] == 2]
        assert seen["angle_rad"] - session.frames["angle_rad"][2] == pytest.approx(math.radians(3))
    assert "1 camera frames saw a polarizer move" in info(bench.session)["problems"]
    same(bench)


def test_records_of_some_seconds_and_turns_beside_them(bench, monkeypatch):
    """The polarizer turns while the radar records: the turn is not waited for until it is needed."""
    custom(
        bench,
        MoveTo(0.1, 0),
        SelectChannel(Channel.VV),
        StartTurn(0.5),
        RecordSeconds(0.3, 0, Channel.VV),
        TurnPolarizer(0.5),
        Expose(1, 0.5),
        Checkpoint(0),
        optics=True,
    )
    turned: list[float] = []
    poll = fake_devices.Polarizer.poll
    start = fake_devices.Polarizer.start_turn

    def slow_turn(self, angle_rad):
        turned.append(time.monotonic())
        start(self, angle_rad)

    def turning(self):
        fix = poll(self)
        return PolarizerFix(fix.angle_rad, fix.sd_rad, time.monotonic() < turned[-1] + 0.25, fix.t_host_ns)

    monkeypatch.setattr(fake_devices.Polarizer, "start_turn", slow_turn)
    monkeypatch.setattr(fake_devices.Polarizer, "poll", turning)
    outcome = bench.run()
    assert outcome.state == "finished", outcome.reason
    monkeypatch.undo()
    assert len(turned) == 1
    with open_session(bench.session) as session:
        (row,) = session.sweeps
        assert (row["samples"], row["sweeps_requested"], row["channel"]) == (0.3 * 48_000, 0, int(Channel.VV))
        # It was sent on its way before the record began, and is found standing after it.
        assert turned[0] < int(row["t_host_ns"]) * 1e-9
        assert session.frames["flags"].tolist() == [0]
        assert not session.polarizer["moving"].any()
    same(bench)


def test_both_polarizers_are_known_to_each_frame(bench):
    steps = []
    for number, (source, sensor) in enumerate([(0.0, 0.0), (0.0, 1.5), (1.5, 0.0)]):
        steps += [TurnSource(source), TurnPolarizer(sensor), Expose(2, sensor, source_angle_rad=source)]
        steps += [Checkpoint(number)]
    custom(bench, *steps, optics=True, source=True)
    outcome = bench.run()
    assert outcome.state == "finished", outcome.reason
    with open_session(bench.session) as session:
        frames = session.frames
        np.testing.assert_allclose(frames["angle_rad"], [0, 0, 1.5, 1.5, 0, 0])
        np.testing.assert_allclose(frames["source_angle_rad"], [0, 0, 0, 0, 1.5, 1.5])
        np.testing.assert_allclose(frames["source_angle_sd_rad"], 0.001)
        asked = session.source_polarizer[session.source_polarizer["record"] == -1]
        np.testing.assert_allclose(asked["angle_rad"], [0, 0, 1.5])
        # Each frame was looked at: one look at each polarizer after it at least.
        for table in (session.polarizer, session.source_polarizer):
            assert set(table["record"][table["record"] >= 0].tolist()) == set(range(6))
        kinds = [identity["kind"] for identity in session.config["identities"]]
        assert kinds == ["camera", "polarizer", "polarizer"]
    same(bench)


def test_the_trolley_is_on_its_way_while_the_last_position_is_saved(bench, monkeypatch):
    """A disk that takes 0.3 s for each flush holds up the end only, not every position."""
    from polfuse_lab.engine.recorder import WriterProcess

    bench.write(aperture=1.5, settle=0.4)
    asked: dict[int, float] = {}
    flush, flushed = WriterProcess.flush, WriterProcess.flushed
    overlapped = []

    def noted(self):
        ticket = flush(self)
        asked[ticket] = time.monotonic()
        return ticket

    def slow(self, ticket):
        return flushed(self, ticket) and time.monotonic() > asked[ticket] + 0.3

    start_move = fake_devices.Trolley.start_move

    def moving(self, x_m, speed_m_s=None):
        overlapped.append(any(time.monotonic() < t + 0.3 for t in asked.values()))
        start_move(self, x_m, speed_m_s)

    monkeypatch.setattr(WriterProcess, "flush", noted)
    monkeypatch.setattr(WriterProcess, "flushed", slow)
    monkeypatch.setattr(fake_devices.Trolley, "start_move", moving)
    outcome = bench.run()
    assert outcome.state == "finished", outcome.reason
    # To the first position nothing is saved yet; to the other three the trolley goes while the flush is under way.
    assert overlapped == [False, True, True, True]
    assert outcome.positions == 4


def test_a_pause_waits_until_the_last_checkpoint_is_on_the_disk(bench, monkeypatch):
    from polfuse_lab.engine.recorder import WriterProcess

    bench.write(aperture=1.0, settle=0.5)
    scheduler = bench.scheduler()
    held = threading.Event()
    flushed = WriterProcess.flushed
    monkeypatch.setattr(WriterProcess, "flushed", lambda self, t: held.is_set() and flushed(self, t))
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(scheduler.run()))
    thread.start()
    end = time.monotonic() + 30
    while not (scheduler.status().position == 1 or time.monotonic() > end):
        time.sleep(0.005)
    scheduler.control.pause()
    time.sleep(0.8)
    assert scheduler.status().state == "running"  # the first position is not known to be safe yet
    held.set()
    while scheduler.status().state != "paused" and time.monotonic() < end:
        time.sleep(0.005)
    assert scheduler.status().state == "paused"
    scheduler.control.resume()
    thread.join(30)
    assert outcomes[0].state == "finished"


def test_how_a_run_ended_is_told_however_full_the_queue_is(bench, monkeypatch):
    """The last words find the queue full ten times and are offered until they are taken."""
    from polfuse_lab.engine.recorder import WriterProcess
    from polfuse_lab.records import Event

    bench.write(aperture=0.5)
    offer, refused = WriterProcess.offer, []

    def full(self, record):
        if isinstance(record, Event) and record.kind == "finished" and len(refused) < 10:
            refused.append(record)
            return False
        return offer(self, record)

    monkeypatch.setattr(WriterProcess, "offer", full)
    assert bench.run().state == "finished"
    assert len(refused) == 10
    with open_session(bench.session) as session:
        assert [bytes(kind) for kind in session.events["kind"]] == [b"finished"]


def test_a_device_that_does_not_confirm_is_named(bench, monkeypatch):
    bench.write(aperture=0.5)
    monkeypatch.setattr(fake_devices.Switches, "make_safe", lambda self: time.sleep(2.0))
    scheduler = bench.scheduler()
    assert scheduler.run().state == "finished"
    assert scheduler.unsafe == ("the switches did not confirm its safe state",)
    with open_session(bench.session) as session:
        assert b"unsafe" in session.events["kind"]


def test_a_recording_of_version_1_is_replayed_into_one_of_today(bench):
    import sys
    from pathlib import Path

    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "session"))
    from version_1 import to_version_1

    bench.write(optics=True, radar={"lose": [2]})
    assert bench.run().state == "finished"
    to_version_1(bench.session)
    with open_session(bench.session) as session:
        assert (session.schema, (session.trolley["record"] == -1).all()) == ("polfuse-session/1", True)
    played = replay(bench.session, bench.folder / "copy.h5")
    assert played.differences == ()
    with open_session(bench.folder / "copy.h5") as copy:
        assert copy.schema == "polfuse-session/2"
    # And that again: what was not looked at then is not there now.
    assert replay(bench.folder / "copy.h5", bench.folder / "again.h5").identical


def test_lost_audio_in_records_of_custom_steps_is_taken_again(bench):
    custom(
        bench,
        MoveTo(0.0, 0),
        SelectChannel(Channel.HH),
        RecordSweeps(2, 0, Channel.HH),
        RecordSeconds(0.1, 1, Channel.HH),
        Checkpoint(1),
        radar={"lose": [2]},
    )
    assert bench.run().state == "finished"
    with open_session(bench.session) as session:
        assert session.sweeps["position"].tolist() == [0, 1, 1]
        assert session.sweeps["flags"].tolist() == [0, int(SweepFlag.LOST), int(SweepFlag.RETRY)]
    same(bench)


@pytest.mark.parametrize("state", ["saving", "turning", "exposing", "recording seconds"])
def test_abort_within_a_second_from_the_states_that_wait(bench, monkeypatch, state):
    """Beside those of moves, records and pauses (test_steering) and of passes (test_passes)."""
    from polfuse_lab.engine.recorder import WriterProcess

    if state == "recording seconds":
        custom(bench, SelectChannel(Channel.HH), RecordSeconds(60.0, 0, Channel.HH), Checkpoint(0))
    else:
        bench.write(aperture=0.5, optics=state != "saving", camera={"fault": "slow"} if state == "exposing" else {})
    if state == "saving":
        monkeypatch.setattr(WriterProcess, "flushed", lambda self, ticket: False)
    elif state == "turning":
        poll = fake_devices.Polarizer.poll
        monkeypatch.setattr(
            fake_devices.Polarizer,
            "poll",
            lambda self: type(fix := poll(self))(fix.angle_rad, 0.0, True, fix.t_host_ns),
        )
    words = {"saving": "saving", "turning": "turning", "exposing": "taking", "recording seconds": "recording"}[state]
    scheduler = bench.scheduler()
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(scheduler.run()))
    thread.start()
    end = time.monotonic() + 30
    # The first checkpoint's flush is waited for at the second one.
    done = 1 if state == "saving" else 0
    while not (words in scheduler.status().reason and scheduler.status().position >= done):
        assert time.monotonic() < end, scheduler.status()
        time.sleep(0.005)
    time.sleep(0.3)
    assert not outcomes
    asked = time.monotonic_ns()
    scheduler.control.abort("rain")
    thread.join(30)
    assert (outcomes[0].state, outcomes[0].reason) == ("aborted", "rain")
    safe = {what.split()[0]: t for t, what in bench.events() if what.endswith("safe")}
    assert {"radar", "switches", "trolley"} <= set(safe)
    assert max(safe.values()) - asked < 1e9
