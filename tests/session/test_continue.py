"""What is left of a collect, and joining its parts."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from session_records import clock, config, exposure, sweeps

from drivers.records import AudioBlock, Channel, Frame, TrolleyFix
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import parse_plan
from polfuse_lab.plans.step_json import steps_to_plain
from polfuse_lab.plans.steps import Checkpoint, MoveTo, RecordPass, SelectChannel
from polfuse_lab.records import Exposure, Observed, SweepFlag, Sweeps
from polfuse_lab.rig import Rig
from polfuse_lab.session import Session, SessionWriter, info, join, open_session
from polfuse_lab.session.continuation import continuation, steps_done
from polfuse_lab.session.layout import CONTINUES, PARTS, STEPS

PLAN = """\
aperture_m = 1.0
step_m = 0.5
sweeps_per_channel = 1
channels = ["HH", "VV"]
[optics]
frames_per_angle = 2
"""
RIG = {
    "waveform": {"centre_hz": 2.4e9, "bandwidth_hz": 80e6, "ramp_up_s": 0.02, "sweep_period_s": 0.04},
    "geometry": {"antenna_height_m": 1.0},
    "radar": {"driver": "fake"},
    "switches": {"driver": "fake"},
    "trolley": {"driver": "fake", "length_m": 3.2},
}
CHANNELS = (Channel.HH, Channel.VV)
ANGLES = (0, 45, 90, 135)


def rig() -> Rig:
    return Rig.model_validate(RIG)


def plan():
    return parse_plan(PLAN, "plan.toml")


def record(position: int, channel: Channel, flags: SweepFlag = SweepFlag.NONE) -> Sweeps:
    # Content follows from position and channel.
    number = 10 * position + int(channel)
    samples = np.random.default_rng(number).integers(-30_000, 30_000, (500, 2)).astype(np.int16)
    block = AudioBlock(samples, 48_000.0, number * 1000, number * 0.1, number * 1_000_000)
    return Sweeps(block, channel, position, flags=flags)


def frame(angle_deg: float, number: int) -> Exposure:
    image = exposure(number).frame.image
    return Exposure(Frame(image, number, 0.01, 0.0, number * 0.1, number * 1_000_000), np.radians(angle_deg))


def session(path, records, *, state="failed", extra=None, steps=None):
    steps = tuple(plan().steps()) if steps is None else steps
    settings = config(plan_toml=PLAN, extra={STEPS: steps_to_plain(steps), **(extra or {})})
    writer = SessionWriter.create(path, settings)
    for item in records:
        writer.write(item)
    writer.close(state, "the disk is full")
    return path


def whole() -> list:
    """The records of the plan, position by position; the frames at the middle one."""
    made = []
    for position in range(3):
        made += [[record(position, channel) for channel in CHANNELS]]
        if position == 1:
            made[-1] += [frame(angle, 2 * n + k) for n, angle in enumerate(ANGLES) for k in range(2)]
    return made


def left(path) -> list[int]:
    """Positions of the checkpoints that are still to be reached."""
    steps = continuation(path, rig(), plan()).steps
    return [step.position for step in steps if isinstance(step, Checkpoint)]


@pytest.mark.parametrize("positions", [0, 1, 2])
def test_the_rest_begins_at_the_first_checkpoint_that_is_missing(path, positions):
    records = [item for part in whole()[:positions] for item in part]
    assert left(session(path, records)) == list(range(positions, 3))


@pytest.mark.parametrize("cut", [1, 2, 5, 9])
def test_a_position_of_which_anything_is_missing_is_done_again(path, cut):
    parts = whole()
    assert left(session(path, parts[0] + parts[1][:cut])) == [1, 2]


def test_records_that_were_to_be_taken_again_do_not_count(path):
    assert left(session(path, [record(0, Channel.HH), record(0, Channel.VV, SweepFlag.LOST)])) == [0, 1, 2]


def test_nothing_is_left_of_a_whole_session_and_other_plans_are_refused(path):
    everything = [item for part in whole() for item in part]
    with pytest.raises(PolfuseError, match="nothing is missing"):
        continuation(session(path, everything, state="finished"), rig(), plan())
    other = parse_plan(PLAN.replace("step_m = 0.5", "step_m = 0.25"), "plan.toml")
    with pytest.raises(PolfuseError, match="another plan"):
        continuation(path, rig(), other)
    wave = Rig.model_validate({**RIG, "waveform": {**RIG["waveform"], "bandwidth_hz": 90e6}})
    with pytest.raises(PolfuseError, match="another waveform"):
        continuation(path, wave, plan())


def test_a_session_that_is_being_written_is_not_continued(path):
    writer = SessionWriter.create(path, config(extra={STEPS: steps_to_plain(plan().steps())}))
    with pytest.raises(PolfuseError, match="still being written"):
        continuation(writer.partial, rig(), plan())
    writer.close()


def test_a_pass_counts_only_when_something_follows_it(path):
    passes = [
        step
        for number in range(2)
        for step in (
            MoveTo(-0.5, 10_000 * number),
            SelectChannel(Channel.HH),
            RecordPass(-0.5, 0.5, 0.1, 10_000 * number, Channel.HH, 1.0),
            Checkpoint(number),
        )
    ]
    first = [Sweeps(record(0, Channel.HH).block, Channel.HH, n) for n in range(3)]
    with open_session(session(path, first, steps=passes)) as opened:
        assert steps_done(opened) == 0
    second = [*first, Sweeps(record(1, Channel.HH).block, Channel.HH, 10_000)]
    with open_session(session(path.with_name("b.h5"), second, steps=passes)) as opened:
        assert steps_done(opened) == 4


def parts_of(path) -> tuple:
    """A collect cut off in its second position, and its rest."""
    records = whole()
    cut = records[0] + records[1][:3] + [clock(0), Observed(TrolleyFix(0.0, 1e-3, False, 7), 1)]
    first = session(path, cut)
    rest = continuation(first, rig(), plan())
    second = path.with_name("rest.h5")
    later = records[1] + records[2] + [Observed(TrolleyFix(0.5, 1e-3, False, 8), 1)]
    session(second, later, state="finished", extra={CONTINUES: rest.origin}, steps=rest.steps)
    return first, second


def test_parts_are_joined_to_one_whole_session(path):
    first, second = parts_of(path)
    assert any("continues s.h5" in problem for problem in info(second)["problems"])
    joined = join([first, second], path.with_name("whole.h5"))
    assert joined.lost_records == 0
    found = info(joined.session)
    assert (found["complete"], found["positions"], found["sweeps"], found["frames"]) == (True, 3, 8, 9)
    assert not any("missing" in problem or "continues" in problem for problem in found["problems"])
    with open_session(joined.session) as opened:
        for index, row in enumerate(opened.sweeps):
            expected = record(int(row["position"]), Channel(int(row["channel"]))).block.samples
            np.testing.assert_array_equal(opened.audio(index), expected)
        for index, row in enumerate(opened.frames):
            np.testing.assert_array_equal(opened.frame(index), exposure(int(row["frame_id"])).frame.image)
        # A fix taken during record 1 of the second part belongs to record 5 of the whole: four came before.
        assert opened.trolley["record"].tolist() == [1, 5]
        assert [part["session"] for part in opened.config["extra"][PARTS]] == ["s.h5", "rest.h5"]
        assert opened.steps == tuple(plan().steps())
    assert sorted(item.name for item in path.parent.iterdir()) == ["rest.h5", "s.h5", "whole.h5"]


def test_a_part_of_a_joined_session_can_be_continued_and_joined_again(path):
    first, second = parts_of(path)
    whole_path = join([first, second], path.with_name("whole.h5")).session
    with open_session(second) as opened:
        started = opened.config["started"]
    third = session(path.with_name("third.h5"), [record(2, Channel.HH)], state="finished",
                    extra={CONTINUES: {"session": "rest.h5", "started": started}})  # fmt: skip
    joined = join([whole_path, third], path.with_name("more.h5"))
    with open_session(joined.session) as opened:
        assert [part["session"] for part in opened.config["extra"][PARTS]] == ["s.h5", "rest.h5", "third.h5"]


def test_parts_in_another_order_or_of_other_collects_are_refused(path):
    first, second = parts_of(path)
    out = path.with_name("whole.h5")
    with pytest.raises(PolfuseError, match="is no continuation"):
        join([second, first], out)
    other = session(path.with_name("other.h5"), [sweeps(0)])
    with pytest.raises(PolfuseError, match=r"continues s\.h5, not other\.h5"):
        join([other, second], out)
    with pytest.raises(PolfuseError, match="one part"):
        join([first], out)
    with pytest.raises(PolfuseError, match="never overwritten"):
        join([first, second], first)
    assert not out.exists()


def test_host_times_go_on_when_the_computer_was_started_anew(path, monkeypatch):
    first, second = parts_of(path)
    read = Session.__init__

    def restarted(self, file_path, file):
        read(self, file_path, file)
        if file_path == second:
            # An hour later by the time of day, and ten minutes after its start.
            self.config["start_unix_s"] += 3600.0
            self.config["start_host_ns"] = 600 * 10**9

    monkeypatch.setattr(Session, "__init__", restarted)
    with open_session(first) as opened:
        booted_s = opened.config["start_unix_s"] - opened.config["start_host_ns"] * 1e-9
        unix_s = opened.config["start_unix_s"]
    with open_session(second) as opened:
        expected_ns = round((opened.config["start_unix_s"] - 600.0 - booted_s) * 1e9)
        assert opened.config["start_unix_s"] > unix_s
        before = opened.sweeps["t_host_ns"].copy()
    joined = join([first, second], path.with_name("whole.h5"))
    with open_session(joined.session) as opened:
        np.testing.assert_array_equal(opened.sweeps["t_host_ns"][4:], before + expected_ns)


def test_join_from_the_command_line(path):
    first, second = parts_of(path)
    command = [sys.executable, "-c", "from polfuse_lab.cli import main; main()", "join", first, second]
    done = subprocess.run([*command, "-o", path.with_name("w.h5"), "--json"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert (told["state"], told["lost_records"], len(told["parts"])) == ("finished", 0, 2)
    again = subprocess.run([*command, "-o", path.with_name("w.h5")], capture_output=True, text=True)
    assert again.returncode == 1
    assert "never overwritten" in again.stderr
