"""Steps as JSON, and plans made in Python."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plan_rig import plan

from drivers.records import Channel
from polfuse_lab.plans import CustomPlan, custom_plan, parse_plan, plan_to_toml
from polfuse_lab.plans.custom import recorded_plan
from polfuse_lab.plans.step_json import step_from_plain, step_to_plain, steps_from_json, steps_to_json
from polfuse_lab.plans.steps import (
    Ask,
    AutoExpose,
    Checkpoint,
    Expose,
    Mark,
    MoveTo,
    RecordPass,
    RecordSeconds,
    RecordSweeps,
    SelectChannel,
    Settle,
    StartTurn,
    Step,
    TurnPolarizer,
    TurnSource,
)
from polfuse_lab.rig import FileMistake

finite = st.floats(allow_nan=False, allow_infinity=False)
number = st.integers(0, 2**31 - 1)
channel = st.sampled_from(Channel)
text = st.text(st.characters(exclude_categories=["Cs"]))
any_step: st.SearchStrategy[Step] = st.one_of(
    st.builds(MoveTo, finite, number),
    st.builds(SelectChannel, channel),
    st.builds(Settle, finite),
    st.builds(RecordSweeps, number, number, channel),
    st.builds(RecordSeconds, finite, number, channel),
    st.builds(RecordPass, finite, finite, st.none() | finite, number, channel, finite),
    st.builds(StartTurn, finite),
    st.builds(TurnPolarizer, finite),
    st.builds(TurnSource, finite),
    st.builds(AutoExpose, st.lists(finite, max_size=4).map(tuple)),
    st.builds(Expose, number, finite, st.booleans(), st.none() | finite),
    st.builds(Checkpoint, number),
    st.builds(Ask, text),
    st.builds(Mark, text),
)


@settings(deadline=None)
@given(st.lists(any_step, max_size=8))
def test_steps_are_the_same_after_json(steps: list[Step]) -> None:
    assert steps_from_json(steps_to_json(steps)) == tuple(steps)


@settings(deadline=None, max_examples=60)
@given(st.lists(any_step, max_size=5), text)
def test_a_custom_plan_is_the_same_after_its_file(steps: list[Step], name: str) -> None:
    made = custom_plan(steps, name=name, retries=7, reconnect_wait_s=0.5)
    read = parse_plan(plan_to_toml(made), "plan.toml")
    assert isinstance(read, CustomPlan)
    assert read == made
    assert read.listed == tuple(steps)


def test_the_form_that_sessions_keep() -> None:
    # Written down: sessions and plan files hold it, so it must not change.
    assert step_to_plain(RecordPass(-0.5, 0.5, None, 10_000, Channel.VH, 1.0)) == {
        "step": "record_pass", "x_from_m": -0.5, "x_to_m": 0.5, "speed_m_s": None, "first_position": 10_000,
        "channel": "VH", "block_s": 1.0,
    }  # fmt: skip
    assert step_to_plain(AutoExpose((0.0, 0.5))) == {"step": "auto_expose", "angles_rad": [0.0, 0.5]}
    assert step_from_plain({"step": "expose", "frames": 3, "angle_rad": 0}) == Expose(3, 0.0)
    assert steps_to_json([Checkpoint(0), Ask("what's next?")]).count("\n") == 4


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        (3, "found 3, allowed: an object"),
        ({}, "step: found None, allowed: move_to, select_channel"),
        ({"step": "moveto"}, "found 'moveto' (did you mean 'move_to'?)"),
        ({"step": "__class__"}, "allowed: move_to"),
        ({"step": "move_to", "x_m": 0.0}, "move_to: position is missing"),
        ({"step": "move_to", "x_m": 0.0, "position": 0, "y_m": 1}, "found a key 'y_m' that is not known, allowed: x_m"),
        ({"step": "move_to", "x_m": "0", "position": 0}, "move_to.x_m: found '0', allowed: a finite number"),
        ({"step": "move_to", "x_m": True, "position": 0}, "move_to.x_m: found True"),
        ({"step": "move_to", "x_m": math.nan, "position": 0}, "move_to.x_m: found nan, allowed: a finite number"),
        ({"step": "move_to", "x_m": 10**400, "position": 0}, "move_to.x_m: found 1000"),
        ({"step": "move_to", "x_m": 0, "position": 0.5}, "move_to.position: found 0.5, allowed: an integer"),
        ({"step": "move_to", "x_m": 0, "position": 2**31}, "allowed: an integer below 2^31"),
        ({"step": "select_channel", "channel": "XX"}, "select_channel.channel: found 'XX', allowed: HH, HV, VH, VV"),
        ({"step": "select_channel", "channel": 0}, "allowed: HH"),
        ({"step": "auto_expose", "angles_rad": 1.0}, "allowed: a list of finite numbers"),
        ({"step": "auto_expose", "angles_rad": [None]}, "allowed: a finite number"),
        ({"step": "ask", "prompt": ["rm"]}, "ask.prompt: found ['rm'], allowed: text"),
        ({"step": "expose", "frames": 1, "angle_rad": 0, "dark": 1}, "expose.dark: found 1, allowed: true or false"),
    ],
)
def test_what_is_no_step_is_told(values: object, expected: str) -> None:
    with pytest.raises(ValueError, match=re.escape(expected)):
        step_from_plain(values)


@pytest.mark.parametrize(
    ("steps_json", "expected"),
    [
        ("[", "is not JSON"),
        ('{"step": "checkpoint"}', "allowed: a list of steps"),
        ('[{"step": "checkpoint", "position": 0}, 7]', "step 2: found 7"),
        ("[" * 100_000, "nested too deeply"),
    ],
)
def test_a_plan_file_with_wrong_steps(steps_json: str, expected: str) -> None:
    with pytest.raises(FileMistake) as caught:
        plan(f"kind = \"custom\"\nsteps_json = '{steps_json}'")
    assert expected in str(caught.value)
    assert "line 2, steps_json" in str(caught.value)
    assert len(str(caught.value)) < 600


def test_steps_of_wrong_numbers_are_refused_when_they_are_made() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        custom_plan([Settle(math.inf)])
    with pytest.raises(ValueError, match="retries"):
        custom_plan([], retries=-1)


def test_visits_of_a_custom_plan() -> None:
    made = custom_plan([
        RecordSeconds(1.0, 0, Channel.HH),
        MoveTo(0.5, 4), RecordSweeps(1, 4, Channel.HH), RecordSweeps(1, 4, Channel.VV),
        MoveTo(-0.5, 9), RecordSweeps(1, 9, Channel.HH),
    ])  # fmt: skip
    assert [(visit.position, visit.x_m, visit.place) for visit in made.visits()] == [
        (0, 0, 1),
        (4, 0.5, 2),
        (9, -0.5, 0),
    ]


def test_a_recorded_plan_keeps_the_limits() -> None:
    original = plan("aperture_m = 0.1016\nretries = 5\nmax_lost_frames = 3\nreconnect_wait_s = 9.0\nmax_reconnects = 1")
    steps = tuple(original.steps())
    made = recorded_plan(original, steps[:5])
    assert made.listed == steps[:5]
    assert (made.retries, made.max_lost_frames, made.reconnect_wait_s, made.max_reconnects) == (5, 3, 9.0, 1)
