"""Every kind of plan carried out once on fake devices, and the session that it leaves behind."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.records import Channel
from polfuse_lab.plans import PLAN_KINDS, custom_plan, parse_plan, plan_to_toml
from polfuse_lab.plans.costs import FILE_BYTES
from polfuse_lab.plans.dry_run import dry_run
from polfuse_lab.plans.steps import (
    PASS_POSITIONS,
    Ask,
    Checkpoint,
    Mark,
    MoveTo,
    RecordSeconds,
    RecordSweeps,
    SelectChannel,
)
from polfuse_lab.records import SweepFlag
from polfuse_lab.replay import replay
from polfuse_lab.rig import load_rig
from polfuse_lab.scheduler import Outcome, Scheduler
from polfuse_lab.session import Session, info, open_session
from polfuse_lab.session.filters import FILTERS

pytestmark = pytest.mark.realtime

SOURCE = """\
[source_polarizer]
driver = "fake"
"""


def carry_out(bench: Any, plan: str, more: str = "") -> tuple[Outcome, list[str]]:
    """Run a plan on the bench's rig with an operator who confirms everything; also what was asked."""
    bench.write(optics=True)
    bench.rig.write_text(bench.rig.read_text() + SOURCE + more)
    bench.plan.write_text(plan)
    planned = dry_run(load_rig(bench.rig), parse_plan(plan, "plan.toml"), output=bench.session)
    assert planned.problems == ()
    scheduler: Scheduler = bench.scheduler()
    asked: list[str] = []
    over = threading.Event()

    def answer() -> None:
        while not over.wait(0.005):
            for ticket, prompt in scheduler.prompts.open():
                if scheduler.prompts.answer(ticket):
                    asked.append(prompt)

    operator = threading.Thread(target=answer, daemon=True)
    operator.start()
    try:
        outcome = scheduler.run()
    finally:
        over.set()
        operator.join(5)
    assert (outcome.state, outcome.reason) == ("finished", "all steps carried out"), outcome.reason
    with open_session(bench.session) as session:
        # The steps are in the session as they were planned, and the plan as its file.
        assert session.steps == planned.steps
        assert session.plan == parse_plan(plan, "plan.toml")
        assert asked == [step.prompt for step in planned.steps if isinstance(step, Ask)]
        assert len(session.frames) == planned.planned.frames + planned.planned.dark_frames
        taken = {(int(row["position"]), int(row["channel"])) for row in session.sweeps}
        assert {(record.first_position, int(record.channel)) for record in planned.planned.records} <= taken
        assert outcome.positions == planned.planned.positions
    assert info(bench.session)["problems"] == []
    return outcome, asked


def rail(session: Session) -> None:
    assert list(session.sweeps["position"]) == [0, 0, 1, 1, 2, 2, 3, 3]
    np.testing.assert_allclose(session.sweeps["x_m"], np.repeat([-0.25, 0.25, 0.25, -0.25], 2), atol=1e-9)
    names = [Channel(int(channel)).name for channel in session.sweeps["channel"]]
    assert names == ["HH", "VV", "VV", "HH"] * 2
    assert np.degrees(session.frames["angle_rad"]) == pytest.approx([0, 60, 120])


def continuous(session: Session) -> None:
    first, second = (session.sweeps[session.sweeps["position"] // PASS_POSITIONS == number] for number in (0, 1))
    # 1 m at 1 m/s in records of 0.3 s: about four, numbered one by one, with the other channel on the way back.
    assert 3 <= len(first) <= 8
    assert list(first["position"]) == list(range(len(first)))
    assert (set(first["channel"]), set(second["channel"])) == ({int(Channel.HH)}, {int(Channel.VV)})
    assert (session.sweeps["flags"] & int(SweepFlag.CONTINUOUS)).all()
    assert (np.diff(first["x_m"]) > 0).all()
    assert (np.diff(second["x_m"]) < 0).all()


def ranging(session: Session) -> None:
    assert [int(row["samples"]) for row in session.sweeps] == [24_000, 24_000]
    assert list(session.sweeps["x_m"]) == pytest.approx([0.2, 0.2])


def doppler(session: Session) -> None:
    assert [int(row["samples"]) for row in session.sweeps] == [14_400]


def sky(session: Session) -> None:
    assert sorted(set(session.sweeps["channel"])) == [0, 1, 2, 3]
    assert set(session.sweeps["x_m"]) == {0.0}


def calibration(session: Session) -> None:
    marks = [bytes(row["text"]).decode() for row in session.events if row["kind"] == b"mark"]
    assert marks == [
        "target corner, repeat 1 of 2", "target corner, repeat 2 of 2",
        "target plate, repeat 1 of 2", "target plate, repeat 2 of 2",
    ]  # fmt: skip
    # Marks stand in time before the records that they tell of.
    times = [int(row["t_host_ns"]) for row in session.events if row["kind"] == b"mark"]
    begun = session.sweeps["t_host_ns"]
    assert [int(np.searchsorted(begun, t)) for t in times] == [0, 1, 2, 3]


def polarizer(session: Session) -> None:
    assert list(session.frames["dark"]) == [True, True, False, False, False]
    assert np.degrees(session.frames["angle_rad"]) == pytest.approx([0, 0, 0, 60, 120])
    assert len(session.sweeps) == 0


def active(session: Session) -> None:
    pairs = np.degrees(np.column_stack([session.frames["source_angle_rad"], session.frames["angle_rad"]]))
    # Ambient light at both angles of the camera's polarizer, then source and camera: HH, HV, VV, VH (thesis 6.3).
    np.testing.assert_allclose(pairs, [[np.nan, 0], [np.nan, 90], [0, 0], [0, 90], [90, 90], [90, 0]], atol=1e-9)


def custom(session: Session) -> None:
    assert [int(row["position"]) for row in session.sweeps] == [3, 7]
    assert [bytes(row["text"]).decode() for row in session.events if row["kind"] == b"mark"] == ["behind the gate"]


TARGETS = """
[[targets]]
name = "corner"
kind = "trihedral"
edge_m = 0.6
range_m = 5.0
[[targets]]
name = "plate"
kind = "plate"
edge_m = 0.6
range_m = 5.0
"""
HH = Channel.HH
CUSTOM = plan_to_toml(
    custom_plan([
        MoveTo(-0.3, 3), SelectChannel(HH), RecordSweeps(1, 3, HH), Checkpoint(0),
        Ask("open the gate"), Mark("behind the gate"), MoveTo(0.3, 7), SelectChannel(Channel.VV),
        RecordSeconds(0.2, 7, Channel.VV), Checkpoint(1),
    ])
)  # fmt: skip
OPTICS = "angles_deg = [0.0, 60.0, 120.0]\nsettle_s = 0.0\n"
CASES: list[tuple[str, Callable[[Session], None]]] = [
    (
        'kind = "rail_sar"\naperture_m = 0.5\nstep_m = 0.5\nchannels = ["HH", "VV"]\nsweeps_per_channel = 1\n'
        'move_settle_s = 0.0\npasses = 2\ntrack_order = "serpentine"\nchannel_order = "alternate"\npause_every = 2\n'
        f"[optics]\n{OPTICS}frames_per_angle = 1\n",
        rail,
    ),
    (
        'kind = "continuous_sar"\naperture_m = 1.0\nspeed_m_s = 1.0\nchannels = ["HH", "VV"]\nblock_s = 0.3\n'
        "move_settle_s = 0.0\n",
        continuous,
    ),
    ('kind = "ranging"\nseconds = 0.5\nrepeats = 2\nx_m = 0.2\n', ranging),
    ('kind = "doppler"\nseconds = 0.3\n', doppler),
    ('kind = "sky"\nsweeps_per_channel = 1\n', sky),
    (
        'kind = "calibration_series"\nchannels = ["HH"]\nsweeps_per_channel = 1\nrepeats = 2\nmove_settle_s = 0.0\n'
        + TARGETS,
        calibration,
    ),
    (f'kind = "polarizer_series"\ndark_frames = 2\nframes_per_angle = 1\n{OPTICS}', polarizer),
    ('kind = "active_optical"\nframes_per_pair = 1\nambient_frames = 1\nsettle_s = 0.0\n', active),
    (CUSTOM, custom),
]


@pytest.mark.parametrize(("plan", "check"), CASES, ids=[check.__name__ for _, check in CASES])
def test_carried_out_and_replayed(bench: Any, plan: str, check: Callable[[Session], None]) -> None:
    carry_out(bench, plan)
    with open_session(bench.session) as session:
        check(session)
    again = replay(bench.session, bench.folder / "again.h5")
    assert [str(difference) for difference in again.differences] == []
    with open_session(bench.folder / "again.h5") as copy, open_session(bench.session) as session:
        assert copy.steps == session.steps


def test_every_kind_is_carried_out() -> None:
    assert {parse_plan(plan, "plan.toml").kind for plan, _ in CASES} == set(PLAN_KINDS)


def test_a_plan_made_in_python_goes_through_the_engine(bench: Any) -> None:
    import polfuse_lab as pf

    bench.write()
    plan = custom_plan([SelectChannel(HH), RecordSweeps(1, 0, HH), Checkpoint(0)], name='my "own"')
    begun = time.monotonic()
    outcome = pf.collect(bench.rig, plan, bench.session)
    assert (outcome.state, outcome.sweeps, outcome.positions) == ("finished", 1, 1)
    assert time.monotonic() - begun < 60
    with open_session(bench.session) as session:
        assert session.plan == plan


def test_the_filter_is_chosen_by_measuring_and_the_session_says_why(bench: Any) -> None:
    carry_out(bench, CASES[4][0], '[storage]\nfilter = "auto"\n')
    with open_session(bench.session) as session:
        told = session.config["storage"]
    assert told["filter"] in FILTERS
    assert told["kept"] is True
    assert "keeps the pace and finds room" in told["reason"]
    # So little data that the forecast is mostly the file's own tables, for which it allows FILE_BYTES at most.
    assert told["predicted_bytes"] - FILE_BYTES < bench.session.stat().st_size < told["predicted_bytes"]
    assert replay(bench.session, bench.folder / "again.h5").identical
    with open_session(bench.folder / "again.h5") as again:
        assert again.config["storage"] == told


def test_a_replay_does_not_depend_on_what_this_version_would_plan(bench: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    carry_out(bench, CASES[4][0])
    from polfuse_lab.plans import SkyPlan

    # As if a later version listed other steps for the same file.
    monkeypatch.setattr(SkyPlan, "unpaused_steps", lambda self, mosaic: iter(()))
    assert replay(bench.session, bench.folder / "again.h5").identical


def test_the_operator_of_no_answer_can_be_aborted(bench: Any) -> None:
    bench.write()
    bench.plan.write_text('kind = "doppler"\nseconds = 0.3\n')
    scheduler: Scheduler = bench.scheduler()
    timer = threading.Timer(1.0, scheduler.control.abort)
    timer.start()
    outcome = scheduler.run()
    timer.join()
    assert outcome.state == "aborted"
    assert Path(str(outcome.session)).exists()


def test_cw_needs_no_sync(bench: Any) -> None:
    # Without the ramp there is no sync; a radar that is silent on both channels would end any other plan.
    bench.write(radar={"fault": "silent"})
    bench.plan.write_text('kind = "doppler"\nseconds = 0.3\nask_cw = false\nrepeats = 2\n')
    outcome = bench.run()
    assert (outcome.state, outcome.sweeps) == ("finished", 2)
