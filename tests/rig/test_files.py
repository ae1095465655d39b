"""Rig and plan files: what is right is read, what is wrong is answered with file, line, field, found and allowed."""

from __future__ import annotations

import itertools
import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import RailSarPlan, SkyPlan, load_plan, parse_plan
from polfuse_lab.plans.steps import Checkpoint, Expose, MoveTo, RecordSweeps, SelectChannel, TurnPolarizer
from polfuse_lab.rig import FileMistake, Rig, parse_model

RIG = """\
name = "test"

[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.020
sweep_period_s = 0.040

[geometry]
antenna_height_m = 1.069

[radar]
driver = "sounddevice"
sample_rate_hz = 48000

[switches]
driver = "dowkey_ms"
[switches.options]
port = "/dev/ttyUSB0"

[trolley]
driver = "grbl"
length_m = 3.048
"""


def mistake_in(text: str, model: type = Rig) -> str:
    with pytest.raises(FileMistake) as caught:
        parse_model(text, model, Path("somewhere/rig.toml"))
    return str(caught.value)


def test_reads_a_rig() -> None:
    rig = parse_model(RIG, Rig, "rig.toml")
    # c / 2B for 80 MHz, thesis equation 2.34 and Table 5.1 (printed there as 1.88 m).
    assert rig.waveform.range_resolution_m == pytest.approx(1.874, abs=5e-4)
    assert rig.waveform.wavelength_m == pytest.approx(0.1249, abs=1e-4)
    assert rig.switches.options == {"port": "/dev/ttyUSB0"}


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (
            "bandwidth_hz = 80e6",
            "bandwith_hz = 80e6",
            ["line 5", "waveform.bandwith_hz", "did you mean 'bandwidth_hz'"],
        ),
        ("bandwidth_hz = 80e6", "bandwidth_hz = -80e6", ["line 5", "waveform.bandwidth_hz", "-80", "greater than 0"]),
        ("ramp_up_s = 0.020", 'ramp_up_s = "20 ms"', ["line 6", "waveform.ramp_up_s", "'20 ms'", "valid number"]),
        ("ramp_up_s = 0.020", "ramp_up_s = nan", ["line 6", "waveform.ramp_up_s", "nan", "finite"]),
        ("antenna_height_m = 1.069", "", ["line 9", "geometry.antenna_height_m", "nothing", "Height of the antennas"]),
        ("sweep_period_s = 0.040", "sweep_period_s = 0.010", ["line 3", "waveform", "at least ramp_up_s"]),
        ("[trolley]", "[troley]", ["troley", "did you mean 'trolley'"]),
        ("sample_rate_hz = 48000", "sample_rate_hz = 1e9", ["line 14", "radar.sample_rate_hz", "384000"]),
    ],
)
def test_a_mistake_is_answered_with_line_field_found_and_allowed(before: str, after: str, expected: list[str]) -> None:
    message = mistake_in(RIG.replace(before, after))
    assert message.startswith("somewhere/rig.toml: ")
    for part in expected:
        assert part in message, message


def test_every_mistake_is_reported_at_once() -> None:
    text = RIG.replace("80e6", "0").replace("1.069", "-1")
    with pytest.raises(FileMistake) as caught:
        parse_model(text, Rig, "rig.toml")
    assert len(caught.value.mistakes) == 2


def test_toml_syntax_errors_name_the_line() -> None:
    with pytest.raises(PolfuseError, match="line 4"):
        parse_model(RIG.replace("centre_hz = 2.4e9", "centre_hz = 2.4 GHz"), Rig, "rig.toml")


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00"])
def test_unreadable_files_are_one_sentence(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "plan.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(PolfuseError) as caught:
        load_plan(path)
    assert str(path) in str(caught.value)


def test_camera_and_polarizer_come_together() -> None:
    camera = (
        '[camera]\ndriver = "harvesters"\nwidth_px = 782\nheight_px = 582\nexposure_s = 0.002\n'
        "focal_length_m = 0.008\npixel_pitch_m = 8.3e-6\n"
    )
    assert "both or neither" in mistake_in(RIG + camera)


def test_thesis_plan_has_61_positions() -> None:
    # 10 ft aperture in 2 in steps, thesis 5.5: 61 positions from -5 ft to +5 ft.
    positions = RailSarPlan().positions_m
    assert len(positions) == 61
    assert positions[0] == pytest.approx(-1.524, abs=1e-12)
    assert positions[-1] == pytest.approx(1.524, abs=1e-12)
    assert positions[30] == 0.0


def test_six_foot_plan_has_37_positions() -> None:
    # 6 ft aperture in 2 in steps, thesis 5.3.
    assert len(RailSarPlan(aperture_m=6 * 0.3048).positions_m) == 37


@given(st.floats(0.01, 30), st.floats(0.005, 0.5))
def test_positions_are_symmetric_even_and_inside_the_aperture(aperture_m: float, step_m: float) -> None:
    if step_m > aperture_m:
        return
    positions = RailSarPlan(aperture_m=aperture_m, step_m=step_m).positions_m
    assert positions[0] == -positions[-1]
    assert positions[-1] - positions[0] <= aperture_m * (1 + 1e-5)
    assert positions[-1] - positions[0] > aperture_m - step_m * 1.001
    gaps = [b - a for a, b in itertools.pairwise(positions)]
    assert all(math.isclose(gap, step_m, rel_tol=1e-9) for gap in gaps)


def test_plan_steps_in_their_order() -> None:
    plan = parse_plan("aperture_m = 0.1016\n[optics]\nframes_per_angle = 2\n", "plan.toml")
    listed = list(plan.steps())
    moves = [step for step in listed if isinstance(step, MoveTo)]
    assert [step.position for step in moves] == [0, 1, 2]
    assert [step.channel for step in listed if isinstance(step, RecordSweeps)] == [
        Channel.HH,
        Channel.HV,
        Channel.VV,
        Channel.VH,
    ] * 3
    # Every recording is preceded by the selection of its own channel.
    for before, after in itertools.pairwise(listed):
        if isinstance(after, RecordSweeps):
            assert before == SelectChannel(after.channel)
    # The polarizer series stands at the aperture's centre: after the second position's sweeps, before its checkpoint.
    turns = [i for i, step in enumerate(listed) if isinstance(step, TurnPolarizer)]
    checkpoints = [i for i, step in enumerate(listed) if isinstance(step, Checkpoint)]
    assert len(turns) == 4
    assert checkpoints[0] < turns[0] < turns[-1] < checkpoints[1]
    assert [math.degrees(step.angle_rad) for step in listed if isinstance(step, Expose)] == pytest.approx(
        [0, 45, 90, 135]
    )


def test_a_sky_plan_does_not_move() -> None:
    plan = SkyPlan()
    assert not any(isinstance(step, MoveTo) for step in plan.steps())
    assert plan.positions_m == (0.0,)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('channels = ["HH", "HH"]', "each named once"),
        ('channels = ["HX"]', "'HH'"),
        ("step_m = 4.0", "at most aperture_m"),
        ("sweeps_per_chanel = 2", "did you mean 'sweeps_per_channel'"),
    ],
)
def test_plan_mistakes(text: str, expected: str) -> None:
    with pytest.raises(FileMistake, match=re.escape(expected)):
        parse_plan(text, "plan.toml")
