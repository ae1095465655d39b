"""What holds for every plan of every kind, whatever its numbers."""

from __future__ import annotations

import itertools
import math

import pytest
from any_plan import plans, rail
from hypothesis import given, settings
from hypothesis import strategies as st
from plan_rig import rig

from polfuse_lab.plans import Plan, RailSarPlan, custom_plan, parse_plan, plan_to_toml
from polfuse_lab.plans.costs import pass_blocks
from polfuse_lab.plans.dry_run import dry_run
from polfuse_lab.plans.step_json import steps_from_json, steps_to_json
from polfuse_lab.plans.steps import (
    PASS_POSITIONS,
    Ask,
    Checkpoint,
    Expose,
    MoveTo,
    RecordPass,
    RecordSeconds,
    RecordSweeps,
    SelectChannel,
    TurnPolarizer,
    TurnSource,
)

RIG = rig()
quick = settings(deadline=None, max_examples=40)
RECORDS = (RecordSweeps, RecordSeconds, RecordPass)


@quick
@given(plans)
def test_every_record_is_preceded_by_its_own_channel_selection(plan: Plan) -> None:
    for before, after in itertools.pairwise(plan.steps()):
        if isinstance(after, RECORDS):
            assert before == SelectChannel(after.channel)


@quick
@given(plans)
def test_a_plan_inside_the_rail_has_no_problem_and_one_outside_has_one(plan: Plan) -> None:
    outcome = dry_run(RIG, plan)
    places = [x for step in outcome.steps for x in _places(step)]
    inside = all(abs(x) <= RIG.trolley.length_m / 2 for x in places)
    assert outcome.limits_ok is inside
    assert bool(outcome.problems) is not inside, outcome.problems
    assert outcome.seconds > 0
    assert outcome.bytes > 0


def _places(step: object) -> list[float]:
    if isinstance(step, MoveTo):
        return [step.x_m]
    return [step.x_from_m, step.x_to_m] if isinstance(step, RecordPass) else []


@quick
@given(plans)
def test_counts_of_the_dry_run_are_those_of_the_steps(plan: Plan) -> None:
    outcome = dry_run(RIG, plan)
    listed = list(plan.steps())
    assert outcome.steps == tuple(listed)
    numbers: set[tuple[int, int]] = set()
    for step in listed:
        if isinstance(step, RecordPass):
            taken = range(step.first_position, step.first_position + pass_blocks(RIG, step))
            assert len(taken) <= PASS_POSITIONS
        elif isinstance(step, (RecordSweeps, RecordSeconds)):
            taken = range(step.position, step.position + 1)
        else:
            continue
        new = {(position, int(step.channel)) for position in taken}
        # A record would supersede another one of the same position and channel.
        assert not new & numbers
        numbers |= new
    assert outcome.records == len(numbers)
    assert outcome.planned.frames == sum(step.frames for step in listed if isinstance(step, Expose) and not step.dark)
    assert outcome.questions == sum(isinstance(step, Ask) for step in listed)
    checkpoints = [step.position for step in listed if isinstance(step, Checkpoint)]
    assert outcome.planned.positions == max(checkpoints) + 1
    assert checkpoints == sorted(checkpoints)


@quick
@given(plans, st.booleans())
def test_frames_are_taken_at_the_angles_that_were_turned_to(plan: Plan, mosaic: bool) -> None:
    sensor = source = None
    for step in plan.steps(mosaic=mosaic):
        match step:
            case TurnPolarizer(angle):
                assert not mosaic
                sensor = angle
            case TurnSource(angle):
                source = angle
            case Expose():
                assert step.angle_rad == (0.0 if mosaic else sensor)
                assert step.source_angle_rad is None or step.source_angle_rad == source


@quick
@given(rail)
def test_every_place_is_visited_once_in_each_pass(plan: RailSarPlan) -> None:
    places = plan.places_m
    visited = [step.x_m for step in plan.steps() if isinstance(step, MoveTo)]
    assert visited == list(plan.positions_m)
    passes = [visited[i : i + len(places)] for i in range(0, len(visited), len(places))]
    assert len(passes) == plan.passes * plan.repeats
    for number, one in enumerate(passes):
        assert sorted(one) == list(places)
        backwards = plan.track_order == "reverse" or (
            plan.track_order == "serpentine" and number % plan.passes % 2 == 1
        )
        assert one == sorted(one, reverse=backwards)
    if plan.track_order == "serpentine" and plan.repeats == 1:
        # It never runs back without recording: what it travels is the passes alone.
        travelled = sum(abs(b - a) for a, b in itertools.pairwise(visited))
        assert travelled == pytest.approx(plan.passes * (places[-1] - places[0]))


@quick
@given(rail)
def test_alternating_channels_wear_the_switches_less(plan: RailSarPlan) -> None:
    def cycles(order: str) -> int:
        return dry_run(RIG, plan.model_copy(update={"channel_order": order})).switch_cycles

    assert cycles("alternate") <= cycles("same")


@quick
@given(rail)
def test_channels_are_the_same_at_every_position_in_whatever_order(plan: RailSarPlan) -> None:
    taken: dict[int, set[str]] = {}
    for step in plan.steps():
        if isinstance(step, RecordSweeps):
            taken.setdefault(step.position, set()).add(step.channel.name)
    assert set(taken) == set(range(len(plan.positions_m)))
    assert all(names == set(plan.channels) for names in taken.values())


@quick
@given(plans)
def test_a_plan_is_the_same_after_its_file_and_its_steps_after_json(plan: Plan) -> None:
    assert parse_plan(plan_to_toml(plan), "plan.toml") == plan
    steps = tuple(plan.steps())
    assert steps_from_json(steps_to_json(steps)) == steps


@quick
@given(plans)
def test_any_plan_can_be_carried_out_step_by_step_as_a_custom_one(plan: Plan) -> None:
    custom = custom_plan(plan.steps(), name=plan.name, retries=plan.retries)
    one, other = dry_run(RIG, plan), dry_run(RIG, custom)
    assert (one.steps, one.seconds, one.bytes, one.problems) == (
        other.steps,
        other.seconds,
        other.bytes,
        other.problems,
    )
    assert custom.uses_camera is plan.uses_camera
    assert parse_plan(plan_to_toml(custom), "plan.toml") == custom
    if not any(isinstance(step, RecordPass) for step in one.steps):
        placed = {visit.position: visit.x_m for visit in plan.visits()}
        recorded = {step.position for step in one.steps if isinstance(step, (RecordSweeps, RecordSeconds))}
        assert {v.position: v.x_m for v in custom.visits()} == {p: x for p, x in placed.items() if p in recorded}


@quick
@given(plans, st.floats(0.5, 2))
def test_time_grows_with_a_slower_trolley(plan: Plan, factor: float) -> None:
    slow = RIG.model_copy(update={"trolley": RIG.trolley.model_copy(update={"speed_m_s": 0.1 / (1 + factor)})})
    assert dry_run(slow, plan).seconds >= dry_run(RIG, plan).seconds - 1e-9
    assert math.isfinite(dry_run(slow, plan).seconds)
