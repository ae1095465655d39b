"""What to collect: plan files, and the plain steps that they become."""

from polfuse_lab.plans.generate import steps
from polfuse_lab.plans.model import OpticsPlan, Plan, load_plan

__all__ = ["OpticsPlan", "Plan", "load_plan", "steps"]
