"""What 'polfuse init' writes: an example of each kind of plan, which its own rig can carry out."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from polfuse_lab.plans import PLAN_KINDS, load_plan
from polfuse_lab.plans.dry_run import dry_run
from polfuse_lab.rig import load_rig
from polfuse_lab.rig.examples import OTHER_PLANS, write_examples


def uncommented(rig: Path) -> Path:
    """The rig with the second polarizer that its file shows as a comment."""
    before, shown, after = rig.read_text(encoding="utf-8").partition("# [source_polarizer]")
    rig.write_text(before + re.sub(r"(?m)^# (?=\[|\w+ *=)", "", shown + after))
    return rig


@pytest.mark.parametrize("kind", ["plan", "sky", *OTHER_PLANS])
def test_each_example_can_be_carried_out(tmp_path: Path, kind: str) -> None:
    written = write_examples(tmp_path)
    plan = load_plan(written[kind])
    outcome = dry_run(load_rig(uncommented(written["rig"])), plan, output=tmp_path / "s.h5")
    assert outcome.problems == ()
    assert outcome.records + outcome.planned.frames > 0
    assert plan.kind == {"plan": "rail_sar"}.get(kind, kind)


def test_there_is_an_example_of_every_kind() -> None:
    assert {"rail_sar", "sky", *OTHER_PLANS} == set(PLAN_KINDS)


def test_a_rig_moved_by_hand_says_what_it_cannot_do(tmp_path: Path) -> None:
    written = write_examples(tmp_path, by_hand=True)
    rig = load_rig(uncommented(written["rig"]))
    refused = [kind for kind in OTHER_PLANS if dry_run(rig, load_plan(written[kind])).problems]
    assert refused == ["continuous_sar"]


def test_examples_name_only_what_differs_or_teaches(tmp_path: Path) -> None:
    # Every example says its name and kind, and nothing that its kind does not know (unknown keys are errors).
    for kind, path in write_examples(tmp_path).items():
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        assert content["name"], kind
        assert kind == "rig" or content["kind"] in PLAN_KINDS
