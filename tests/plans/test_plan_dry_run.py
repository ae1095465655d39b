"""Dry run: time and size by hand, and every reason why a plan cannot be carried out, all at once."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from plan_rig import CAMERA, RIG, plan, rig
from typer.testing import CliRunner

from drivers.records import Channel
from polfuse_lab.cli import build
from polfuse_lab.plans import custom_plan
from polfuse_lab.plans.costs import largest_record_frames, step_seconds, switch_cycles
from polfuse_lab.plans.dry_run import DryRun, dry_run
from polfuse_lab.plans.steps import (
    Checkpoint,
    Expose,
    MoveTo,
    RecordPass,
    RecordSeconds,
    RecordSweeps,
    SelectChannel,
    Settle,
    StartTurn,
    Step,
    TurnPolarizer,
)
from polfuse_lab.rig import Rig, parse_model

HH = Channel.HH


def run(*steps: Step) -> DryRun:
    return dry_run(rig(), custom_plan(steps))


def test_a_pass_takes_its_length_over_its_speed() -> None:
    outcome = dry_run(
        rig(), plan('kind = "continuous_sar"\naperture_m = 2.0\nspeed_m_s = 0.25\nchannels = ["HH", "VV"]')
    )
    # To the start 1 m at 0.1 m/s; two runs of 2 m at 0.25 m/s; settling 2 x 0.2 s, switching 2 x 0.07 s; the rest are
    # exchanges with devices.
    assert 10 + 2 * 8 + 0.4 + 0.14 < outcome.seconds < 10 + 16 + 0.54 + 1
    # 8 s in records of 1 s, twice.
    assert outcome.records == 16
    # 16 s of stereo int16 at 48 kHz, besides tables.
    assert 16 * 48_000 * 4 < outcome.bytes < 16 * 48_000 * 4 + 1_500_000
    assert outcome.problems == ()


def test_seconds_of_a_record() -> None:
    outcome = dry_run(rig(), plan('kind = "ranging"\nseconds = 20.0'))
    assert 20 < outcome.seconds < 20.5
    assert 20 * 48_000 * 4 < outcome.bytes < 20 * 48_000 * 4 + 600_000


def test_a_turn_begun_early_is_not_waited_for_twice() -> None:
    turn, record = TurnPolarizer(1.0), RecordSeconds(5.0, 0, HH)
    late = sum(step_seconds(rig(), [record, turn]))
    early = sum(step_seconds(rig(), [StartTurn(1.0), record, turn]))
    just_before = sum(step_seconds(rig(), [record, StartTurn(1.0), turn]))
    assert early < late - 0.5
    assert just_before == pytest.approx(late, abs=0.1)


def test_blocks_of_the_file_are_as_long_as_the_longest_record() -> None:
    # 4 sweeps: 5 periods of 40 ms, 6 % more (10 176 and a rounding error, so one more), and 64 samples for the edges.
    assert largest_record_frames(rig(), plan("").steps(), 48_000.0) == 10_177 + 64
    assert largest_record_frames(rig(), plan('kind = "doppler"\nseconds = 3').steps(), 48_000.0) == 144_000
    assert largest_record_frames(rig(), plan('kind = "polarizer_series"').steps(), 48_000.0) == 1


def test_wear_of_the_switches_by_hand() -> None:
    # HH: both are set. HV: receive. VV: transmit. VH: receive. Then back to HH: transmit; or VH stays.
    text = 'aperture_m = 0.1\nstep_m = 0.1\nchannel_order = "{}"'
    assert switch_cycles(plan(text.format("same")).steps()) == 5 + 4
    assert switch_cycles(plan(text.format("alternate")).steps()) == 5 + 3


def test_everything_wrong_is_told_at_once() -> None:
    text = 'kind = "active_optical"'
    found = dry_run(rig(camera=False, source=False), plan(text)).problems
    assert any("no camera" in problem for problem in found)
    assert any("add [source_polarizer]" in problem for problem in found)
    outcome = dry_run(rig(camera=False), plan("aperture_m = 4.0\nstep_m = 1.0\n[optics]"))
    assert not outcome.limits_ok
    assert len(outcome.problems) == 2
    # +-2 m on a rail that ends at +-1.6 m.
    assert outcome.problems[0].startswith("2 positions are beyond the rail's -1.6 .. 1.6 m (farthest -2 m)")


def test_the_run_up_must_be_on_the_rail() -> None:
    text = 'kind = "continuous_sar"\naperture_m = 3.0\nspeed_m_s = 0.1\nrun_up_m = {}'
    assert dry_run(rig(), plan(text.format(0.1))).limits_ok
    assert not dry_run(rig(), plan(text.format(0.11))).limits_ok


@pytest.mark.parametrize(
    ("driver", "drive", "expected"),
    [
        ("grbl", "speed_m_s = 0.1", None),
        ("encoder", 'drive = "encoder"', None),
        ("encoder", "speed_m_s = 0.1", "cannot keep a speed"),
        ("by_hand", "speed_m_s = 0.1", "cannot keep a speed"),
        ("by_hand", 'drive = "encoder"', "does not say where it is while it is pushed"),
    ],
)
def test_a_pushed_trolley_is_not_driven(driver: str, drive: str, expected: str | None) -> None:
    found = dry_run(rig(trolley=driver), plan(f'kind = "continuous_sar"\n{drive}')).problems
    assert (found == ()) if expected is None else (expected in found[0])


@pytest.mark.parametrize(
    ("steps", "expected"),
    [
        ([], "records nothing"),
        ([MoveTo(0.0, 0), Checkpoint(0)], "records nothing"),
        ([RecordSweeps(1, 0, HH)], "step 1: records HH while the switches have not been set"),
        ([SelectChannel(Channel.VV), RecordSweeps(1, 0, HH)], "step 2: records HH while the switches stand at VV"),
        (
            [SelectChannel(HH), RecordSweeps(1, 0, HH), RecordSweeps(1, 0, HH), RecordSweeps(1, 0, HH)],
            "step 3 and 1 more: records HH a second time under the same position number",
        ),
        ([SelectChannel(HH), RecordSweeps(0, 0, HH)], "step 2: records 0 sweeps"),
        ([SelectChannel(HH), RecordSeconds(-1.0, 0, HH)], "step 2: records -1 s"),
        ([SelectChannel(HH), RecordSweeps(1, -1, HH)], "step 2: has position number -1"),
        ([SelectChannel(HH), Settle(-1.0), RecordSweeps(1, 0, HH)], "step 2: waits -1 s"),
        ([SelectChannel(HH), RecordPass(0.0, 1.0, 0.1, 0, HH, 1.0)], "where the trolley does not stand"),
        ([MoveTo(0.0, 0), SelectChannel(HH), RecordPass(0.0, 1.0, 0.1, 7, HH, 1.0)], "numbered from a multiple"),
        ([MoveTo(0.0, 0), SelectChannel(HH), RecordPass(0.0, 1.0, 0.0001, 0, HH, 0.1)], "at most 10000 records"),
        ([MoveTo(0.0, 0), SelectChannel(HH), RecordPass(0.0, 1.0, -0.1, 0, HH, 1.0)], "runs at -0.1 m/s"),
        ([MoveTo(0.0, 0), SelectChannel(HH), RecordPass(0.0, 1.0, 0.1, 0, HH, 0.0)], "in blocks of 0 s"),
        ([MoveTo(0.0, 0), SelectChannel(HH), RecordPass(0.0, 0.0, 0.1, 0, HH, 1.0)], "ends where it begins"),
        (
            [MoveTo(0.0, 0), SelectChannel(HH), RecordSweeps(1, 5, HH), RecordPass(0.0, 1.0, 0.1, 0, HH, 1.0)],
            "step 4: records HH a second time",
        ),
        ([Expose(0, 0.0)], "takes 0 frames"),
        ([TurnPolarizer(0.0), Expose(1, 1.0)], "takes frames for 57.2958 degrees while the polarizer stands at 0"),
        ([StartTurn(1.0), Expose(1, 1.0)], "takes frames while the polarizer turns"),
        ([StartTurn(1.0), TurnPolarizer(0.0), Expose(1, 0.0)], "is sent elsewhere while it still turns"),
    ],
)
def test_steps_that_cannot_be_right(steps: list[Step], expected: str) -> None:
    found = run(*steps).problems
    assert any(expected in problem for problem in found), found


def test_a_polarizer_that_is_turned_must_be_there() -> None:
    mosaic = RIG + CAMERA[: CAMERA.index("[polarizer]")] + 'mosaic = "90-45-135-0"\n'
    outcome = dry_run(parse_model(mosaic, Rig, "rig.toml"), custom_plan([TurnPolarizer(0.0), Expose(1, 0.0)]))
    assert outcome.problems == ("the plan turns the polarizer and the rig has none: add [polarizer] to the rig file",)


def test_wide_steps_are_noted_and_not_refused() -> None:
    # 2 in at 12.5 cm: asin(0.125 / (4 x 0.0508)) = 38 degrees, beyond the half beam of 35; 10 cm: 18 degrees.
    assert dry_run(rig(), plan("")).warnings == ()
    outcome = dry_run(rig(), plan("step_m = 0.1"))
    assert outcome.problems == ()
    assert "beyond 18 degrees" in outcome.warnings[0]
    # 1.5 m/s x 40 ms = 6 cm from one sweep to the next: asin(0.125 / 0.24) = 31 degrees.
    moving = dry_run(rig(), plan('kind = "continuous_sar"\nspeed_m_s = 1.5'))
    assert "places 6 cm apart show targets beyond 31 degrees" in moving.warnings[0]


def test_room_on_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert dry_run(rig(), plan("")).free_bytes is None
    assert (dry_run(rig(), plan(""), output=tmp_path / "s.h5").free_bytes or 0) > 0
    monkeypatch.setattr("polfuse_lab.plans.dry_run.free_bytes", lambda path: 1_000_000)
    found = dry_run(rig(), plan(""), output=tmp_path / "s.h5").problems
    assert re.fullmatch(r"the file takes up to \d+\.\d MB and 1\.0 MB are free: write it to another disk", found[0])
    monkeypatch.undo()
    assert "cannot be written" in dry_run(rig(), plan(""), output=tmp_path / "none" / "s.h5").problems[0]


def test_the_command(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text((RIG + CAMERA).replace('"dowkey_ms"', '"dowkey_ms"\noptions = {port = "/dev/x"}')
                                       .replace('"grbl"', '"grbl"\noptions = {port = "/dev/y"}')
                                       .replace('"ell14"', '"ell14"\noptions = {port = "/dev/z"}'))  # fmt: skip
    (tmp_path / "plan.toml").write_text('kind = "ranging"\nsweeps = 4\nrepeats = 3\npause_every = 1\n')
    arguments = ["plan", str(tmp_path / "rig.toml"), str(tmp_path / "plan.toml"), "-o", str(tmp_path / "s.h5")]
    outcome = CliRunner().invoke(build(), [*arguments, "--json", "--list"])
    assert outcome.exit_code == 0, outcome.output
    found = json.loads(outcome.stdout)
    assert (found["steps"], found["sweeps"], found["positions"], found["questions"]) == (11, 3, 3, 2)
    assert (found["limits_ok"], found["problems"], found["kind"], found["switch_cycles"]) == (True, [], "ranging", 2)
    assert found["free_bytes"] > 0
    assert found["list"][1] == {"step": "record_sweeps", "sweeps": 4, "position": 0, "channel": "HH"}
    assert not (tmp_path / "s.h5").exists()
    text = CliRunner().invoke(build(), arguments).stdout
    assert "questions to the operator: 2" in text
    assert "no problems found" in text
