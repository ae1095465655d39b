"""A rig for the tests of plans; nothing of it is ever opened."""

from __future__ import annotations

import dataclasses
import math

from polfuse_lab.plans import Plan, parse_plan
from polfuse_lab.plans.steps import Step
from polfuse_lab.rig import Rig, parse_model

RIG = """\
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.020
sweep_period_s = 0.040
[geometry]
antenna_height_m = 1.069
[radar]
driver = "sounddevice"
[switches]
driver = "dowkey_ms"
settle_s = 0.07
[trolley]
driver = "grbl"
length_m = 3.2
speed_m_s = 0.1
"""
CAMERA = """\
[camera]
driver = "harvesters"
width_px = 8
height_px = 6
exposure_s = 0.01
focal_length_m = 0.008
pixel_pitch_m = 8e-6
[polarizer]
driver = "ell14"
"""
SOURCE = """\
[source_polarizer]
driver = "ell14"
"""


def rig(*, camera: bool = True, source: bool = True, trolley: str = "grbl") -> Rig:
    text = RIG.replace('driver = "grbl"', f'driver = "{trolley}"')
    return parse_model(text + (CAMERA if camera else "") + (SOURCE if source else ""), Rig, "rig.toml")


def plan(text: str) -> Plan:
    return parse_plan(text, "plan.toml")


def brief(step: Step) -> str:
    """A step in a few characters, for lists that a person can check; angles in degrees."""

    def value(name: str, item: object) -> str:
        if isinstance(item, float) and name.endswith("_rad"):
            return f"{math.degrees(item):g}"
        if isinstance(item, float):
            return f"{item:g}"
        return getattr(item, "name", str(item))

    fields = [(field.name, getattr(step, field.name)) for field in dataclasses.fields(step)]
    return " ".join([type(step).__name__, *(value(name, item) for name, item in fields if name != "prompt")])


def brief_steps(text: str, *, mosaic: bool = False) -> list[str]:
    return [brief(step) for step in plan(text).steps(mosaic=mosaic)]
