"""Steps in words, for whoever watches a run."""

from __future__ import annotations

import math

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


def describe(step: Step) -> str:
    """A step in words."""
    match step:
        case MoveTo(x_m):
            return f"moving to x = {x_m:.3f} m"
        case SelectChannel(channel):
            return f"switching to {channel.name}"
        case Settle(seconds):
            return f"settling {seconds:g} s"
        case RecordSweeps(sweeps, _, channel):
            return f"recording {sweeps} {'sweep' if sweeps == 1 else 'sweeps'} in {channel.name}"
        case RecordSeconds(seconds, _, channel):
            return f"recording {seconds:g} s in {channel.name}"
        case RecordPass():
            return f"recording {step.channel.name} from x = {step.x_from_m:.3f} m to {step.x_to_m:.3f} m"
        case StartTurn(angle_rad) | TurnPolarizer(angle_rad):
            return f"turning the polarizer to {math.degrees(angle_rad):.1f} deg"
        case TurnSource(angle_rad):
            return f"turning the source's polarizer to {math.degrees(angle_rad):.1f} deg"
        case AutoExpose():
            return "finding the exposure"
        case Expose(frames):
            return f"taking {frames} frames"
        case Checkpoint():
            return "saving"
        case Ask(prompt):
            return f"asking: {prompt}"
        case Mark(text):
            return f"marking: {text}"
