"""What to collect: plan files, and the plain steps that they become."""

from polfuse_lab.plans.base import Plan, Visit
from polfuse_lab.plans.calibration import CalibrationSeriesPlan, SeriesTarget
from polfuse_lab.plans.camera import ActiveOpticalPlan, PolarizerSeriesPlan
from polfuse_lab.plans.continuous import ContinuousSarPlan
from polfuse_lab.plans.custom import CustomPlan, custom_plan
from polfuse_lab.plans.files import PLAN_KINDS, AnyPlan, load_plan, parse_plan, plan_to_toml
from polfuse_lab.plans.fixed import DopplerPlan, RangingPlan, SkyPlan
from polfuse_lab.plans.optics import OpticsPlan
from polfuse_lab.plans.rail import RailSarPlan

__all__ = [
    "PLAN_KINDS",
    "ActiveOpticalPlan",
    "AnyPlan",
    "CalibrationSeriesPlan",
    "ContinuousSarPlan",
    "CustomPlan",
    "DopplerPlan",
    "OpticsPlan",
    "Plan",
    "PolarizerSeriesPlan",
    "RailSarPlan",
    "RangingPlan",
    "SeriesTarget",
    "SkyPlan",
    "Visit",
    "custom_plan",
    "load_plan",
    "parse_plan",
    "plan_to_toml",
]
