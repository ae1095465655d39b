"""Plan files: TOML, one class of plan for each ``kind``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, get_args

from pydantic import Field

from polfuse_lab.plans.base import Plan
from polfuse_lab.plans.calibration import CalibrationSeriesPlan
from polfuse_lab.plans.camera import ActiveOpticalPlan, PolarizerSeriesPlan
from polfuse_lab.plans.continuous import ContinuousSarPlan
from polfuse_lab.plans.custom import CustomPlan
from polfuse_lab.plans.fixed import DopplerPlan, RangingPlan, SkyPlan
from polfuse_lab.plans.rail import RailSarPlan
from polfuse_lab.rig.toml_model import model_to_toml, parse_kind, read_text

AnyPlan = Annotated[
    RailSarPlan
    | ContinuousSarPlan
    | RangingPlan
    | DopplerPlan
    | SkyPlan
    | CalibrationSeriesPlan
    | PolarizerSeriesPlan
    | ActiveOpticalPlan
    | CustomPlan,
    Field(discriminator="kind"),
]
"""Every kind of plan, told apart by ``kind``."""

PLAN_KINDS: Mapping[str, type[Plan]] = {cls.model_fields["kind"].default: cls for cls in get_args(get_args(AnyPlan)[0])}
"""The class of each kind of plan."""
DEFAULT_KIND = "rail_sar"
"""Kind of a plan file that does not say."""


def load_plan(path: Path | str) -> Plan:
    """Read a plan file. Raises :class:`polfuse_lab.errors.PolfuseError` with file, line, field, found and allowed."""
    return parse_plan(read_text(path), path)


def parse_plan(text: str, path: Path | str) -> Plan:
    """Parse a plan file's text; ``path`` is used in messages only. Raises as :func:`load_plan`."""
    return parse_kind(text, PLAN_KINDS, DEFAULT_KIND, path)


def plan_to_toml(plan: Plan) -> str:
    """The text of a plan file that is read as ``plan``; what has its default is left out."""
    return f'kind = "{plan.kind}"\n' + model_to_toml(plan, without=("kind",))
