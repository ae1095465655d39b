"""Was everything recorded, and was it timed?"""

from __future__ import annotations

from polfuse_lab.engine import Finished
from polfuse_lab.plans import Plan
from polfuse_lab.plans.listing import planned
from polfuse_lab.products.checks import Check


def collect_checks(outcome: Finished, plan: Plan) -> list[Check]:
    """Nothing lost, nothing missing."""
    wanted = planned(plan.steps())
    frames = wanted.frames + wanted.dark_frames
    return [
        Check("samples_lost", outcome.samples_lost, 0, 0, "", "Audio samples lost in the collect."),
        Check("frames_lost", outcome.frames_lost, 0, 0, "", "Camera frames lost in the collect."),
        Check("positions", outcome.positions, wanted.positions, 0, "", "Positions along the rail, against the plan."),
        Check(
            "sweep_records",
            outcome.sweeps,
            len(wanted.records),
            0,
            "",
            "Audio records, one for each channel at each position.",
        ),
        Check("camera_frames", outcome.frames, frames, 0, "", "Camera frames, against the plan."),
    ]
