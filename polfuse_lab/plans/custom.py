"""Plans from Python: any steps, in any order.

    from polfuse_lab.plans.custom import custom_plan
    from polfuse_lab.plans.steps import Checkpoint, MoveTo, RecordSweeps, SelectChannel

    plan = custom_plan([MoveTo(0.1, 0), SelectChannel(Channel.HH), RecordSweeps(4, 0, Channel.HH), Checkpoint(0)])
    dry_run(rig, plan)                          # lists, times, sizes and checks it
    pf.collect("rig.toml", plan, "session.h5")  # carries it out

Each pair of position and channel is recorded once (a second record would supersede the first); a run that was
interrupted goes on from the last checkpoint.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Any, Literal

from pydantic import field_validator

from polfuse_lab.plans.base import Plan, Visit
from polfuse_lab.plans.step_json import steps_from_json, steps_to_json
from polfuse_lab.plans.steps import AutoExpose, Expose, MoveTo, RecordPass, RecordSeconds, RecordSweeps, Step


class CustomPlan(Plan):
    """``custom``: steps listed one by one."""

    kind: Literal["custom"] = "custom"
    """Steps listed one by one."""
    steps_json: str
    """The steps as a JSON list, such as [{"step": "move_to", "x_m": 0.1, "position": 0}, …]; see
    :mod:`polfuse_lab.plans.steps` for all of them."""

    @field_validator("steps_json")
    @classmethod
    def _steps(cls, text: str) -> str:
        steps_from_json(text)
        return text

    @cached_property
    def listed(self) -> tuple[Step, ...]:
        """The steps."""
        return steps_from_json(self.steps_json)

    def steps(self, *, mosaic: bool = False) -> Iterator[Step]:
        """Yield the steps as they are listed."""
        return iter(self.listed)

    @property
    def uses_camera(self) -> bool:
        """Whether a step takes a frame."""
        return any(isinstance(step, (Expose, AutoExpose)) for step in self.listed)

    def visits(self) -> tuple[Visit, ...]:
        """Where the trolley is sent for each position's records; 0 until it is first sent somewhere."""
        x_m = 0.0
        found: dict[int, float] = {}
        for step in self.listed:
            match step:
                case MoveTo():
                    x_m = step.x_m
                case RecordSweeps() | RecordSeconds():
                    found.setdefault(step.position, x_m)
                case RecordPass():
                    x_m = step.x_to_m
        places = {x: place for place, x in enumerate(sorted(set(found.values())))}
        return tuple(Visit(position, found[position], places[found[position]]) for position in sorted(found))


def recorded_plan(plan: Plan, steps: Iterable[Step]) -> CustomPlan:
    """A plan of recorded steps with the name and the limits of ``plan``."""
    common = {name: getattr(plan, name) for name in Plan.model_fields if name != "kind"}
    return CustomPlan(steps_json=steps_to_json(steps), **common)


def custom_plan(steps: Iterable[Step], *, name: str = "custom", **limits: Any) -> CustomPlan:
    """A plan of any steps.

    Args:
        steps: what is to be done, in this order.
        name: a name for reports.
        limits: ``retries``, ``max_lost_frames``, ``reconnect_wait_s``, ``max_reconnects`` as in a plan file.

    Raises:
        ValueError: a step holds a value of another type than it declares, or a number that is not finite; or a limit is
            not one.
    """
    return CustomPlan(name=name, steps_json=steps_to_json(steps), **limits)
