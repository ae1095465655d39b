"""The files that the demo works with: its scene, the same scene without targets, and its plans."""

from __future__ import annotations

import re
from importlib.resources import files
from pathlib import Path

from polfuse_lab.errors import PolfuseError

STEP_M = 0.0508
"""2 in, as in the thesis: targets within 38 degrees have no grating lobes."""
FULL_POSITIONS = 61
"""10 ft, as in the thesis."""
QUICK_POSITIONS = 15
FRAMES_PER_ANGLE = {True: 2, False: 4}
"""By ``quick``."""

_TARGET_TABLE = re.compile(r"^\[\[\s*(point|reflector|bush)\s*\]\]")
_ANY_TABLE = re.compile(r"^\[")


def scene_text() -> str:
    """The demo's scene file."""
    return files(__package__).joinpath("scene.toml").read_text(encoding="utf-8")


def without_targets(scene: str) -> str:
    """A scene file's text with all radar targets left out: what the antennas see when they point at the sky."""
    kept, inside = [], False
    for line in scene.splitlines():
        if _ANY_TABLE.match(line):
            inside = bool(_TARGET_TABLE.match(line))
        if not inside:
            kept.append(line)
    return "\n".join(kept) + "\n"


def plan_text(*, quick: bool, sweeps: int) -> str:
    """The plan of the collect.

    Args:
        quick: fewer positions and frames.
        sweeps: sweeps per channel and position; the simulator repeats itself after its ``noise_cycle`` sweeps, so
            that many make the record the same whenever it starts.
    """
    positions = QUICK_POSITIONS if quick else FULL_POSITIONS
    return f"""\
# The demo's collect: {positions} positions in steps of 2 in, all four channels, polarizer series at the centre.
name = "demo{", quick" if quick else ""}"
kind = "rail_sar"
aperture_m = {STEP_M * (positions - 1):.4f}
step_m = {STEP_M}
channels = ["HH", "HV", "VV", "VH"]
sweeps_per_channel = {sweeps}
move_settle_s = 0.0                     # the simulated trolley does not shake

[optics]
angles_deg = [0.0, 45.0, 90.0, 135.0]
frames_per_angle = {FRAMES_PER_ANGLE[quick]}
settle_s = 0.0
"""


def sky_plan_text(*, sweeps: int) -> str:
    """The plan of the look at the sky."""
    return f"""\
# The noise floor and the antennas' coupling: antennas up, nothing in view.
name = "demo, sky"
kind = "sky"
channels = ["HH", "HV", "VV", "VH"]
sweeps_per_channel = {sweeps}
"""


def write_text(path: Path, text: str) -> Path:
    """Write a file and return its path. Raises :class:`PolfuseError` when it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise PolfuseError(
            f"cannot be written ({error.strerror})", where=str(path), advice="choose another directory with --out"
        ) from error
    return path
