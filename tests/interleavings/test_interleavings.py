"""Any order of aborts, pauses, notes, losses and faults, in every step of every kind of plan, in virtual time.

The devices' data carry what was so (route, place, angles, numbers), so the expected values are the simulated truth
itself. Thousands of runs, and each event at every single moment: ``python -m benchmarks reliability.interleavings``.
"""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis.stateful import run_state_machine_as_test

from benchmarks import every_moment, interleavings
from benchmarks.interleaving_plans import PLANS
from benchmarks.virtual_checks import Injected, violations
from benchmarks.virtual_recorder import VirtualRecorder
from benchmarks.virtual_run import VirtualRun
from drivers.records import Channel
from polfuse_lab.plans import PLAN_KINDS
from polfuse_lab.plans.files import parse_plan
from polfuse_lab.plans.steps import Step
from polfuse_lab.records import SweepFlag, Sweeps
from polfuse_lab.scheduler import Control, Scheduler
from polfuse_lab.scheduler.devices import DeviceSet
from polfuse_lab.scheduler.keeping import Keeper

EXAMPLES = int(os.environ.get("POLFUSE_INTERLEAVINGS", "30"))


def run_machine(examples: int, machine=interleavings.Interleavings, number: int = 1) -> None:
    chosen = settings(
        max_examples=examples,
        stateful_step_count=25,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    run_state_machine_as_test(seed(number)(machine), settings=chosen)


def test_nothing_is_lost_or_mixed_in_any_order_of_events():
    run_machine(EXAMPLES)


def test_every_kind_of_plan_and_step_takes_part():
    kinds = {parse_plan(text, name).kind for name, text in PLANS.items()}
    assert kinds == set(PLAN_KINDS)
    steps = {type(step) for text in PLANS.values() for step in parse_plan(text, "plan").steps()}
    assert steps == set(Step.__args__)


@pytest.mark.parametrize("plan", PLANS)
def test_an_undisturbed_run_finishes_and_all_is_as_it_must_be(plan, tmp_path):
    with VirtualRun(parse_plan(PLANS[plan], plan), tmp_path / "s.h5") as run:
        assert run.finish().state == "finished"
        assert violations(run, Injected()) == []


@pytest.mark.parametrize("action", ["abort", "pause", "unplug trolley", "full disk"])
def test_one_event_at_moments_of_a_plan_with_every_kind_of_step(action):
    wrong = [(moment, *rest) for moment, *rest in every_moment.sweep("custom", action, first=5, every=97) if rest[1]]
    assert wrong == []


# -- the checks find defects: each of these is one, put in on purpose -------------------------------------------------


def wrong_channel(monkeypatch):
    offer = VirtualRecorder.offer

    def mixed(self, record):
        if isinstance(record, Sweeps) and record.position == 1:
            record = Sweeps(record.block, Channel(3 - record.channel), record.position, record.x_m, record.x_sd_m,
                            record.sweeps_requested, record.flags, record.attempt)  # fmt: skip
        return offer(self, record)

    monkeypatch.setattr(VirtualRecorder, "offer", mixed)


def no_repeat_mark(monkeypatch):
    offer = VirtualRecorder.offer

    def unmarked(self, record):
        if isinstance(record, Sweeps):
            record = Sweeps(record.block, record.channel, record.position, record.x_m, record.x_sd_m,
                            record.sweeps_requested, record.flags & ~SweepFlag.REPEATED, record.attempt)  # fmt: skip
        return offer(self, record)

    monkeypatch.setattr(VirtualRecorder, "offer", unmarked)


def drops_when_full(monkeypatch):
    offer = VirtualRecorder.offer
    monkeypatch.setattr(VirtualRecorder, "offer", lambda self, record: offer(self, record) or True)


def jumps_unseen(monkeypatch):
    monkeypatch.setattr("polfuse_lab.scheduler.recording.switch_flags", lambda states: SweepFlag.NONE)
    monkeypatch.setattr("polfuse_lab.scheduler.passes.switch_flags", lambda states: SweepFlag.NONE)


def bumps_unseen(monkeypatch):
    monkeypatch.setattr("polfuse_lab.scheduler.recording.moved_flag", lambda fix, seen: SweepFlag.NONE)


def left_unsafe(monkeypatch):
    monkeypatch.setattr(DeviceSet, "make_safe", lambda self: [])


def deaf_to_aborts(monkeypatch):
    monkeypatch.setattr(Control, "check", lambda self: None)


def notes_forgotten(monkeypatch):
    monkeypatch.setattr(Scheduler, "note", lambda self, text: None)


def goes_on_from_the_step(monkeypatch):
    monkeypatch.setattr(Scheduler, "_go_back", lambda self, index, checkpoint, *, begun=False: max(index - 1, 0))


def goes_back_unconfirmed(monkeypatch):
    monkeypatch.setattr(Keeper, "confirm", lambda self: None)


DEFECTS = {
    wrong_channel: ("rail_sar there and back", "note", 90),
    no_repeat_mark: ("sky", "pause", 7),
    drops_when_full: ("sky", "full queue", 7),
    jumps_unseen: ("sky", "switches jump", 7),
    bumps_unseen: ("ranging", "bump trolley", 40),
    left_unsafe: ("sky", "abort", 40),
    deaf_to_aborts: ("doppler", "abort", 40),
    notes_forgotten: ("sky", "note", 40),
    goes_on_from_the_step: ("sky", "pause", 7),
    goes_back_unconfirmed: ("sky", "slow disk and pause", 7),
}


@pytest.mark.parametrize("defect", DEFECTS, ids=lambda defect: defect.__name__)
def test_a_defect_put_in_on_purpose_is_found(defect, monkeypatch):
    plan, action, every = DEFECTS[defect]
    defect(monkeypatch)
    assert any(wrong for _, _, wrong in every_moment.sweep(plan, action, first=10, every=every))


def test_the_random_machine_finds_a_defect_too(monkeypatch):
    no_repeat_mark(monkeypatch)
    with pytest.raises(interleavings.Violated, match="is not marked as taken again"):
        run_machine(60)
