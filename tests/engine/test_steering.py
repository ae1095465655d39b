"""Abort, pause, resume, and what the scheduler does about devices that misbehave. It runs in this process."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from drivers.errors import DeviceLost
from drivers.records import Channel
from polfuse_lab.records import SweepFlag
from polfuse_lab.scheduler import Control, Outcome, Scheduler
from polfuse_lab.scheduler.clock_watch import ClockWatch
from polfuse_lab.scheduler.devices import Device, DeviceSet
from polfuse_lab.scheduler.lane import Lane
from polfuse_lab.session import open_session


class Run:
    """A scheduler at work in a thread."""

    def __init__(self, bench) -> None:
        self.scheduler: Scheduler = bench.scheduler()
        self.outcome: Outcome | None = None
        self.thread = threading.Thread(target=self._work)
        self.thread.start()

    def _work(self) -> None:
        self.outcome = self.scheduler.run()

    def until(self, condition, timeout_s: float = 20.0):
        """Wait until a status fulfils the condition."""
        end = time.monotonic() + timeout_s
        while not condition(status := self.scheduler.status()):
            assert time.monotonic() < end, f"waited in vain, last: {status}"
            assert self.outcome is None, self.outcome
            time.sleep(0.005)
        return status

    def wait(self) -> Outcome:
        self.thread.join(30)
        assert self.outcome is not None
        return self.outcome


SITUATIONS = {
    "opening": ({"radar": {"fault": "slow_open"}}, lambda s: s.state == "preparing" and "opening" in s.reason),
    "moving": ({"trolley": {"pace_m_s": 0.02}}, lambda s: "moving" in s.reason),
    "settling": ({"settle": 30.0}, lambda s: "settling" in s.reason),
    "recording": ({"sweeps": 1000}, lambda s: "recording" in s.reason),
    "stalled": ({"radar": {"fault": "stall"}}, lambda s: "listening" in s.reason),
    "hung driver": ({"radar": {"fault": "hang"}}, lambda s: s.sweeps == 2 and "recording" in s.reason),
    "paused": ({"settle": 0.3}, lambda s: s.state == "paused"),
    "asking": ({"trolley_driver": "by_hand_fake"}, lambda s: s.state == "running" and "moving" in s.reason),
}


@pytest.mark.parametrize("situation", SITUATIONS)
def test_abort_makes_devices_safe_within_a_second(bench, situation):
    options, reached = SITUATIONS[situation]
    bench.write(aperture=2.0, **options)
    run = Run(bench)
    if situation == "paused":
        run.scheduler.control.pause()
    run.until(reached)
    asked = time.monotonic_ns()
    run.scheduler.control.abort()
    outcome = run.wait()
    assert (outcome.state, outcome.reason) == ("aborted", "aborted by the user")
    opened = {what.split()[0] for _, what in bench.events() if what.endswith("open")}
    safe = {what.split()[0]: t for t, what in bench.events() if what.endswith("safe")}
    if situation == "opening":
        opened -= {"radar"}  # it had not opened yet, so there was nothing to make safe
    assert set(safe) >= opened
    assert max(safe.values()) - asked < 1e9
    if outcome.session is not None:
        with open_session(outcome.session) as session:
            assert (session.state, session.complete) == ("aborted", False)
    assert not list(bench.folder.glob("*.partial"))
    assert not list(bench.folder.glob(".*.ballast"))


def test_pause_finishes_the_step_and_resume_repeats_from_the_checkpoint(bench):
    # Settling is a step of its own, so a pause asked for in it comes before the position's records.
    bench.write(aperture=1.0, sweeps=5, settle=0.1)
    run = Run(bench)
    run.until(lambda s: s.position == 1 and s.sweeps == 3 and "recording" in s.reason)
    run.scheduler.control.pause()
    paused = run.until(lambda s: s.state == "paused")
    time.sleep(0.3)
    assert run.scheduler.status().sweeps == paused.sweeps
    assert run.scheduler.note("wind from the left")
    run.scheduler.control.resume()
    outcome = run.wait()
    assert outcome.state == "finished"
    assert not run.scheduler.note("too late")
    with open_session(bench.session) as session:
        rows = session.sweeps
        repeated = rows[(rows["flags"] & int(SweepFlag.REPEATED)) > 0]
        # Whatever had been recorded at position 1 was recorded once more, as attempt 1, and nothing else.
        assert set(repeated["position"]) == {1}
        assert set(repeated["attempt"]) == {1}
        before = rows[(rows["position"] == 1) & (rows["attempt"] == 0)]
        assert len(repeated) == paused.sweeps - 2
        assert set(repeated["channel"]) <= set(before["channel"])
        final = {(int(r["position"]), int(r["channel"])): int(r["attempt"]) for r in rows}
        assert set(final) == {(p, int(c)) for p in range(3) for c in (Channel.HH, Channel.HV)}
        assert session.notes["text"].tolist() == [b"wind from the left"]
        assert [k.decode() for k in session.events["kind"]] == ["paused", "resumed", "finished"]


def test_a_device_that_is_lost_in_a_pause_is_waited_for(bench):
    bench.write(aperture=1.0, sweeps=5, settle=0.1, radar={"fault": "unplugged"})
    run = Run(bench)
    run.until(lambda s: s.position == 1 and s.sweeps == 3 and "recording" in s.reason)
    run.scheduler.control.pause()
    run.until(lambda s: s.state == "paused" and "user" in s.reason)
    cable = bench.log.with_name(f"{bench.log.name}.unplugged")
    cable.touch()
    # A clock fix is due every few seconds, in a pause as well.
    run.until(lambda s: s.state == "paused" and "waiting up to" in s.reason)
    cable.unlink()
    run.until(lambda s: s.state == "paused" and "user" in s.reason)
    run.scheduler.control.resume()
    assert run.wait().state == "finished"
    with open_session(bench.session) as session:
        assert [k.decode() for k in session.events["kind"]] == ["paused", "lost", "back", "resumed", "finished"]
        newest = {(int(r["position"]), int(r["channel"])) for r in session.sweeps}
        assert len(newest) == 6


def test_an_answer_that_comes_after_the_last_record_fails_nothing():
    class Dying:
        def clock(self):
            raise DeviceLost("the process ended", where="camera", advice="open it again")

    devices = DeviceSet(Control())
    devices.by_kind["camera"] = Device("camera", "dying", Dying(), Lane("camera"), False)
    watch = ClockWatch(devices, lambda record: None)
    watch.tick()  # asks
    devices.by_kind["camera"].lane.submit(lambda: None).result(5)  # behind which the question has been answered
    watch.end()
    watch.tick()
    devices.by_kind["camera"].lane.end()


def test_lost_audio_is_taken_again(bench):
    # Record 0 is the probe; 1 is HH and 2 is HV at the first position.
    bench.write(radar={"lose": [2, 3]})
    outcome = bench.run()
    assert outcome.state == "finished"
    assert outcome.samples_lost == 200
    with open_session(bench.session) as session:
        rows = session.sweeps[:4]
        assert rows["attempt"].tolist() == [0, 0, 1, 2]
        assert rows["lost"].tolist() == [0, 100, 100, 0]
        expected = [SweepFlag.NONE, SweepFlag.LOST, SweepFlag.LOST | SweepFlag.RETRY, SweepFlag.RETRY]
        assert rows["flags"].tolist() == [int(flag) for flag in expected]
        assert session.samples_lost == 200


def test_audio_lost_every_time_ends_the_collect_and_keeps_the_file(bench):
    bench.write(radar={"lose": [2, 3, 4]})
    outcome = bench.run()
    assert outcome.state == "failed"
    assert "100 audio frames were lost in each of 3 records at position 0, HV" in outcome.reason
    with open_session(bench.session) as session:
        assert (session.state, len(session.sweeps)) == ("failed", 4)


def test_switches_that_move_during_a_record_are_flagged_and_the_record_repeated(bench):
    bench.write(switches={"fault": "jump"})
    outcome = bench.run()
    assert outcome.state == "finished"
    with open_session(bench.session) as session:
        flags = session.sweeps["flags"].tolist()
        assert flags[2:4] == [int(SweepFlag.SWITCH_CHANGED), int(SweepFlag.RETRY)]
        assert len(flags) == 7


def test_unverified_switches_are_flagged(bench):
    bench.write(aperture=0.5, switches={"fault": "unverified"})
    assert bench.run().state == "finished"
    with open_session(bench.session) as session:
        assert set(session.sweeps["flags"]) == {int(SweepFlag.SWITCH_UNVERIFIED)}


def test_incomplete_frame_is_kept_and_taken_again(bench):
    bench.write(aperture=0.5, optics=True, camera={"fault": "incomplete"})
    outcome = bench.run()
    assert (outcome.state, outcome.frames, outcome.frames_lost) == ("finished", 9, 1)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"trolley": {"fault": "open"}}, "fake trolley: nobody answers; plug it in"),
        ({"radar": {"fault": "bug"}}, "apt install libportaudio2"),
        ({"trolley": {"fault": "lost"}}, "fake trolley: unplugged (lost 6 times); see why this happens so often"),
        # 10 m in steps of 0.5 m: 2.0 .. 5.0 m are beyond, 7 on either side.
        ({"aperture": 10.0}, "14 positions are beyond the rail's -1.6 .. 1.6 m"),
    ],
)
def test_failures_name_device_and_mend_and_leave_the_others_closed(bench, options, expected):
    bench.write(**options)
    outcome = bench.run()
    assert outcome.state == "failed"
    assert expected in outcome.reason
    opened = sorted(what.split()[0] for _, what in bench.events() if what.endswith("open"))
    assert sorted(what.split()[0] for _, what in bench.events() if what.endswith("close")) == opened
    assert outcome.session is None or open_session(outcome.session).state == "failed"


def test_no_sync_in_the_first_record_ends_the_collect_early(bench):
    bench.write(aperture=2.0, settle=0.5, radar={"fault": "silent"})
    outcome = bench.run()
    assert outcome.state == "failed"
    assert "both channels are silent" in outcome.reason
    assert outcome.sweeps < 10


def test_clipped_beat_is_said_and_the_preview_shows_the_target(bench):
    bench.write(radar={"beat": 3.0, "speed": 2.0})
    outcome = bench.run()
    preview = bench.live.preview
    assert any("the beat is clipped at position" in warning for warning in outcome.warnings)
    # 1 kHz for a ramp of 80 MHz in 20 ms: 2 R / c = 1000 / (80e6 / 0.02), R = 37.5 m.
    assert preview is not None
    assert abs(np.argmax(preview.level_db) * preview.step_m - 299_792_458 / 2 * 1000 / 4e9) <= preview.step_m


def test_existing_files_are_never_overwritten(bench):
    bench.write()
    bench.session.write_bytes(b"precious")
    outcome = bench.run()
    assert outcome.state == "failed"
    assert "exists and is never overwritten" in outcome.reason
    assert bench.session.read_bytes() == b"precious"
    assert bench.events() == []
