"""Recordings of fake devices, with everything that can go wrong in one, replayed: the copy is the same."""

from __future__ import annotations

import math
import threading
import time
import tracemalloc

import fake_devices
import h5py
import numpy as np
import pytest

from drivers.errors import DeviceLost
from polfuse_lab.engine.recorder import WriterProcess
from polfuse_lab.errors import PolfuseError
from polfuse_lab.live import LivePipeline
from polfuse_lab.records import SweepFlag
from polfuse_lab.replay import FASTEST, Player, ReplayClock, compare_sessions, replay
from polfuse_lab.scheduler import clock_watch
from polfuse_lab.scheduler.keeping import Keeper
from polfuse_lab.session import open_session


def same(bench, session, **speeds: float) -> None:
    """Replay; the copies must be identical."""
    for name, speed in (speeds or {"fastest": FASTEST}).items():
        played = replay(session, bench.folder / f"{name}.h5", speed=speed)
        assert [str(difference) for difference in played.differences] == [], played
        assert played.identical


def kinds(session) -> list[str]:
    with open_session(session) as opened:
        return [kind.decode() for kind in opened.events["kind"]]


def test_copy_of_a_whole_session_is_identical_at_any_speed(bench):
    bench.write(optics=True, settle=0.05)
    bench.run()
    same(bench, bench.session, fastest=FASTEST, twenty=20.0)
    with open_session(bench.session) as a, open_session(bench.folder / "fastest.h5") as b:
        # Independent of compare_sessions: what h5py reads from the two files.
        for name in ("audio", "images", "sweeps", "frames", "trolley", "switches", "polarizer", "clocks", "events"):
            assert a._file[name][:].tobytes() == b._file[name][:].tobytes()
        assert len(a.clocks) >= 2
        assert (b.config["source"], b.config["started"]) == ("replay", a.config["started"])
        assert b.config["start_host_ns"] == a.config["start_host_ns"]
        assert (b.complete, b.rig_toml, b.plan_toml) == (True, a.rig_toml, a.plan_toml)
    # A copy is a session like any other.
    assert replay(bench.folder / "fastest.h5", bench.folder / "again.h5").identical


def test_speed_sets_the_pace(bench):
    bench.write(settle=0.4)
    bench.run()
    with open_session(bench.session) as session:
        # From the first record to the last: what real time must take at least, halved at speed 2.
        span = float(session.sweeps["t_host_ns"][-1] - session.trolley["t_host_ns"][0]) * 1e-9
    assert span > 1.0
    began = time.monotonic()
    played = replay(bench.session, bench.folder / "two.h5", speed=2.0)
    assert played.identical
    assert span / 2 < time.monotonic() - began < span / 2 + 6


FAULTS = {
    # options of the devices, state of the recording, audio records in it
    "lost audio": ({"radar": {"lose": [2, 3]}}, "finished", 8),
    "audio lost for good": ({"radar": {"lose": [2, 3, 4]}}, "failed", 4),
    "switches that jump": ({"switches": {"fault": "jump"}}, "finished", 7),
    "switches unverified": ({"switches": {"fault": "unverified"}}, "finished", 6),
    "trolley lost too often": ({"trolley": {"fault": "lost"}}, "failed", 4),
    "radar silent": ({"aperture": 2.0, "settle": 0.5, "radar": {"fault": "silent"}}, "failed", None),
    "incomplete frame": ({"optics": True, "camera": {"fault": "incomplete"}}, "finished", 6),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_recordings_with_faults(bench, fault):
    options, state, records = FAULTS[fault]
    bench.write(**options)
    assert bench.run().state == state
    with open_session(bench.session) as session:
        assert records is None or len(session.sweeps) == records
    same(bench, bench.session)


class Run(threading.Thread):
    """A scheduler in a thread, steered by a test."""

    def __init__(self, bench) -> None:
        super().__init__()
        self.scheduler = bench.scheduler()
        self.outcome = None
        self.start()

    def run(self) -> None:
        self.outcome = self.scheduler.run()

    def until(self, condition) -> None:
        end = time.monotonic() + 20
        while not condition(status := self.scheduler.status()):
            assert time.monotonic() < end, status
            time.sleep(0.002)


def test_pauses_repeats_and_notes(bench):
    bench.write(sweeps=5, settle=0.1)
    run = Run(bench)
    for records in (3, 6):
        run.until(lambda s, n=records: s.sweeps >= n and "recording" in s.reason)
        run.scheduler.control.pause()
        run.until(lambda s: s.state == "paused")
        run.scheduler.note("wind from the left, " + "ö" * 800)
        run.scheduler.control.resume()
    run.join(40)
    assert run.outcome.state == "finished"
    with open_session(bench.session) as session:
        assert (session.sweeps["flags"] & int(SweepFlag.REPEATED)).any()
        assert len(session.notes) == 4  # two rows for each: 1600 bytes and more
    assert kinds(bench.session).count("paused") == 2
    same(bench, bench.session, fastest=FASTEST, twenty=20.0)


@pytest.mark.parametrize("moment", ["recording", "paused", "settling"])
def test_aborted_recording(bench, moment):
    bench.write(sweeps=8, settle=0.2)
    run = Run(bench)
    run.until(lambda s: s.sweeps >= 3 and ("settling" if moment == "settling" else "recording") in s.reason)
    if moment == "paused":
        run.scheduler.control.pause()
        run.until(lambda s: s.state == "paused")
    run.scheduler.control.abort("rain")
    run.join(20)
    assert run.outcome.state == "aborted"
    same(bench, bench.session)
    with open_session(bench.folder / "fastest.h5") as copy:
        assert (copy.state, copy.reason, copy.complete) == ("aborted", "rain", False)


def lose_once(monkeypatch, kind: type, method: str, calls: int) -> None:
    """Let a fake device be lost at its n-th call of a method, and be back when it is opened again."""
    original, count = getattr(kind, method), iter(range(1, 10_000))

    def failing(self, *args):
        if next(count) == calls:
            raise DeviceLost("unplugged: no answer; twice", where=f"fake {kind.kind}", advice="plug it in")
        return original(self, *args)

    failing.__name__ = method
    monkeypatch.setattr(kind, method, failing)


@pytest.mark.parametrize(
    ("kind", "method", "calls"),
    [
        ("Trolley", "start_move", 2),
        ("Radar", "poll", 40),
        ("Radar", "begin", 5),
        ("Switches", "select", 4),
        # Odd calls are before a record, even ones after it: then the record is kept, unverified.
        ("Switches", "state", 5),
        ("Switches", "state", 6),
    ],
)
def test_device_lost_and_back(bench, monkeypatch, kind, method, calls):
    bench.write(aperture=1.0)
    lose_once(monkeypatch, getattr(fake_devices, kind), method, calls)
    assert bench.run().state == "finished"
    monkeypatch.undo()
    assert kinds(bench.session)[:3] == ["lost", "back", "resumed"]
    same(bench, bench.session)


def test_device_lost_twice_in_a_row(bench, monkeypatch):
    bench.write()
    lose_once(monkeypatch, fake_devices.Trolley, "start_move", 2)
    lose_once(monkeypatch, fake_devices.Trolley, "start_move", 3)
    assert bench.run().state == "finished"
    monkeypatch.undo()
    assert kinds(bench.session) == ["lost", "back", "resumed"] * 2 + ["finished"]
    same(bench, bench.session)


def test_device_lost_while_a_checkpoint_is_saved(bench, monkeypatch):
    """The disk is so slow that the second checkpoint waits for the first one's flush, and the radar does not answer the
    question for its clock meanwhile: the second position is done again."""
    bench.write()
    monkeypatch.setattr(clock_watch, "CLOCK_AFTER_S", (0.01,))
    waiting, asked = [], []
    flushed, clock, drain = WriterProcess.flushed, fake_devices.Radar.clock, Keeper.begin_flush

    def checkpoint(self):
        waiting.append(1)
        drain(self)

    def lost_clock(self):
        if len(waiting) == 2 and not asked:
            asked.append(1)
            raise DeviceLost("silent", where="fake radar", advice="plug it in")
        return clock(self)

    monkeypatch.setattr(Keeper, "begin_flush", checkpoint)
    # The first flush is confirmed only once the radar has been lost.
    monkeypatch.setattr(
        WriterProcess, "flushed", lambda self, t: flushed(self, t) and (len(waiting) != 2 or bool(asked))
    )
    monkeypatch.setattr(fake_devices.Radar, "clock", lost_clock)
    assert bench.run().state == "finished"
    monkeypatch.undo()
    with open_session(bench.session) as session:
        assert (session.sweeps["position"] == 1).sum() == 4
        # 7 steps for a position without settling: move, twice switch and record, checkpoint; 1-based.
        assert b"radar in step 12: " in session.events["text"][0]
    same(bench, bench.session)


def test_clock_question_lost_while_the_trolley_moves(bench, monkeypatch):
    """Another device than the one that is waited for is lost: the move is begun again."""
    bench.write(trolley={"pace_m_s": 2.0})
    monkeypatch.setattr(clock_watch, "CLOCK_AFTER_S", (0.05,))
    lose_once(monkeypatch, fake_devices.Radar, "clock", 5)
    assert bench.run().state == "finished"
    monkeypatch.undo()
    assert kinds(bench.session).count("lost") == 1
    same(bench, bench.session)


def test_recording_whose_writer_was_killed(bench):
    from polfuse_lab.session import recover

    bench.write(aperture=2.0, sweeps=5)
    run = Run(bench)
    run.until(lambda s: s.sweeps >= 5)
    run.scheduler._recorder._process.kill()
    run.join(30)
    assert run.outcome.state == "failed"
    partial = bench.folder / "s.h5.partial"
    with pytest.raises(PolfuseError, match="polfuse recover"):
        Player(partial)
    recover(partial, bench.folder / "rescued.h5")
    same(bench, bench.folder / "rescued.h5")
    with open_session(bench.folder / "fastest.h5") as copy:
        assert copy.state == "engine lost"


def answered(run) -> None:
    """Confirm whatever a run asks the operator, a moment later."""
    while run.is_alive():
        for ticket, _ in run.scheduler.prompts.open():
            time.sleep(0.2)
            run.scheduler.prompts.answer(ticket)
        time.sleep(0.01)


def test_trolley_lost_on_its_way_comes_back_elsewhere(bench, monkeypatch):
    """The operator confirmed its position in the recording; in the replay nobody has to."""
    bench.write(trolley={"pace_m_s": 2.0})
    lose_once(monkeypatch, fake_devices.Trolley, "poll", 6)
    run = Run(bench)
    answered(run)
    assert run.outcome.state == "finished"
    monkeypatch.undo()
    assert kinds(bench.session)[:3] == ["lost", "back", "resumed"]
    same(bench, bench.session)


def test_hand_moved_trolley_needs_nobody_in_the_replay(bench):
    bench.write(trolley_driver="by_hand_fake", aperture=0.5)
    run = Run(bench)
    answered(run)
    assert run.outcome.state == "finished"
    same(bench, bench.session, fastest=FASTEST, twenty=20.0)


def test_abort_of_a_replay_keeps_what_was_played(bench):
    bench.write(sweeps=8)
    bench.run()
    player = Player(bench.session, bench.folder / "copy.h5", speed=0.5)
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(player.run()))
    thread.start()
    end = time.monotonic() + 20
    while player.status().sweeps < 1 and time.monotonic() < end:
        time.sleep(0.01)
    asked = time.monotonic()
    player.abort()
    thread.join(10)
    assert time.monotonic() - asked < 3
    player.close()
    assert outcomes[0].state == "aborted"
    assert not list(bench.folder.glob("*.partial"))
    found = [str(difference) for difference in compare_sessions(bench.session, bench.folder / "copy.h5")]
    assert "state.state: 'finished' and 'aborted'" in found
    assert any(text.startswith("sweeps: 6 and ") for text in found)


def test_ctrl_c_ends_a_replay_cleanly(bench):
    bench.write(sweeps=8)
    bench.run()

    def interrupt(status):
        if status.sweeps:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replay(bench.session, bench.folder / "copy.h5", speed=0.5, on_status=interrupt)
    with open_session(bench.folder / "copy.h5") as copy:
        assert copy.state == "aborted"
    assert threading.active_count() < 10


def test_watching_writes_nothing_and_can_be_paused(bench):
    bench.write(sweeps=5)
    bench.run()
    before = sorted(path.name for path in bench.folder.iterdir())
    live = LivePipeline(bench.scheduler()._rig)
    player = Player(bench.session, speed=1.0, viewer=live)
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(player.run()))
    player.clock.pause()
    thread.start()
    time.sleep(0.5)
    assert player.status().sweeps == 0
    player.clock.resume()
    player.clock.speed = FASTEST
    thread.join(20)
    assert outcomes[0].state == "finished"
    assert outcomes[0].sweeps == 6
    end = time.monotonic() + 20
    while live.preview is None and time.monotonic() < end:
        time.sleep(0.01)
    assert live.preview is not None
    live.close()
    player.close()
    assert sorted(path.name for path in bench.folder.iterdir()) == before


def test_a_replay_holds_one_record_at_a_time(bench):
    """16 MB of audio in records of 1.2 MB: two at most are in memory (one read, one on its way out)."""
    bench.write(aperture=3.0, sweeps=150, radar={"speed": 1000.0})
    assert bench.run().state == "finished"
    with open_session(bench.session) as session:
        record = session.audio(0).nbytes
        assert session.sweeps["samples"].sum() * 4 > 12 * record
    bench.live.close()  # it may still be at work on what was recorded
    with Player(bench.session) as player:
        tracemalloc.start()
        assert player.run().state == "finished"
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    # Besides the two, the level of the last tenth of a second in floating point, and tables.
    assert peak < 2 * record + 1_500_000


def test_plan_that_asks_for_something_else_is_told(bench):
    """A file whose steps were changed by hand: the scheduler asks for records that are not there."""
    bench.write()
    bench.run()
    with h5py.File(bench.session, "r+") as file:
        text = bytes(file["config"][:]).replace(b'"sweeps": 1', b'"sweeps": 2')
        file["config"][:] = np.frombuffer(text, np.uint8)
    played = replay(bench.session, bench.folder / "copy.h5")
    assert not played.identical
    assert played.state == "failed"
    # 2 sweeps: 3 periods of 40 ms at 48 kHz, 6 % more, and 64; 1 sweep: 2 periods.
    assert (
        f"is asked for {math.ceil(3 * 1920 * 1.06) + 64} frames where {math.ceil(2 * 1920 * 1.06) + 64}"
        in played.reason
    )


def test_a_move_that_never_ends_in_the_file_does_not_hang_the_replay(bench):
    bench.write()
    bench.run()
    with h5py.File(bench.session, "r+") as file:
        rows = file["trolley"][:]
        rows["moving"] = True
        file["trolley"][:] = rows
    played = replay(bench.session, bench.folder / "copy.h5")
    assert (played.identical, played.state) == (False, "failed")
    assert "trolley: waits for something else than was recorded" in played.reason


@pytest.mark.parametrize(("field", "value"), [("attempt", 3), ("position", 2), ("flags", 4), ("x_m", 0.25)])
def test_recording_that_no_scheduler_makes_is_not_identical(bench, field, value):
    bench.write()
    bench.run()
    with h5py.File(bench.session, "r+") as file:
        row = file["sweeps"][1]
        row[field] = value
        file["sweeps"][1] = row
    played = replay(bench.session, bench.folder / "copy.h5")
    assert any(d.dataset == "sweeps" and field in d.what for d in played.differences)


def test_what_cannot_be_replayed_is_refused(bench, tmp_path):
    from scipy.io import wavfile

    from polfuse_lab.imports.wav import import_wav

    wavfile.write(tmp_path / "a.wav", 48_000, fake_devices.audio(48_000))
    import_wav([tmp_path / "a.wav"], tmp_path / "wav.h5")
    with pytest.raises(PolfuseError, match=r"holds no plan to carry out.*import:wav"):
        replay(tmp_path / "wav.h5", tmp_path / "copy.h5")
    bench.write()
    bench.run()
    (tmp_path / "taken.h5").write_bytes(b"precious")
    with pytest.raises(PolfuseError, match="never overwritten"):
        replay(bench.session, tmp_path / "taken.h5")
    with pytest.raises(PolfuseError, match="not above 0"):
        replay(bench.session, tmp_path / "copy.h5", speed=0.0)
    assert not (tmp_path / "copy.h5").exists()


def test_clock_of_a_replay(monkeypatch):
    now = [0.0]
    monkeypatch.setattr("polfuse_lab.replay.clock.time.monotonic", lambda: now[0])
    clock = ReplayClock(1_000, speed=20.0)
    now[0] = 0.5
    assert clock.now_ns() == 1_000 + 10_000_000_000
    assert clock.reached(10_000_001_000)
    assert not clock.reached(10_000_001_001)
    clock.pause()
    now[0] = 5.0
    assert clock.now_ns() == 10_000_001_000
    assert not clock.reached(0)
    clock.resume()
    clock.speed = 1.0
    now[0] = 6.0
    assert clock.now_ns() == 11_000_001_000
    clock.skip_to(5)
    assert clock.now_ns() == 11_000_001_000
    clock.speed = FASTEST
    assert clock.reached(99_000_000_000)
    assert clock.now_ns() == 99_000_000_000
    for speed in (0.0, -1.0, math.nan):
        with pytest.raises(ValueError, match="above 0"):
            clock.speed = speed
