"""Collects with a mosaic camera, and with automatic exposure, over the simulated rig's wires."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from hw_mocks.rig import SimulatedRig
from polfuse_lab.engine import collect
from polfuse_lab.plans import OpticsPlan, RailSarPlan
from polfuse_lab.plans.steps import AutoExpose, Expose, TurnPolarizer
from polfuse_lab.session import info, open_session

SCENE = Path(__file__).resolve().parents[2] / "examples" / "scenes" / "field.toml"
PLAN = """\
kind = "sky"
channels = ["HH"]
sweeps_per_channel = 1
[optics]
frames_per_angle = 2
settle_s = 0.0
auto_exposure = true
"""


def scene(folder: Path, **camera: str) -> Path:
    """The example scene with other entries in its [camera]."""
    lines = []
    for line in SCENE.read_text().splitlines():
        if line.split("=")[0].strip() not in camera:
            lines.append(line)
        if line.startswith("[camera]"):
            lines += [f"{name} = {value}" for name, value in camera.items()]
    path = folder / "scene.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("mosaic", ["none", "90-45-135-0"])
def test_a_collect_finds_its_exposure_and_keeps_it(tmp_path: Path, mosaic: str) -> None:
    size = {"width_px": "64", "height_px": "48", "pixel_pitch_m": "1e-4"}
    with SimulatedRig(scene(tmp_path, mosaic=f'"{mosaic}"', **size), tmp_path / "rig", audio="tcp", seed=1) as rig:
        path = rig.write_rig(tmp_path / "rig.toml")
        (tmp_path / "plan.toml").write_text(PLAN)
        outcome = collect(path, tmp_path / "plan.toml", tmp_path / "s.h5")
    assert outcome.state == "finished", outcome.reason
    angles = [0.0] if mosaic != "none" else [0.0, 45.0, 90.0, 135.0]
    assert outcome.frames == 2 * len(angles)
    assert info(tmp_path / "s.h5")["problems"] == []
    with open_session(tmp_path / "s.h5") as session:
        kinds = [identity["kind"] for identity in session.config["identities"]]
        assert ("polarizer" in kinds) == (mosaic == "none")
        assert session.rig is not None
        assert session.rig.camera is not None
        np.testing.assert_allclose(np.degrees(session.frames["angle_rad"]), np.repeat(angles, 2), atol=0.05)
        exposures = np.unique(session.frames["exposure_s"])
        assert len(exposures) == 1
        # The scene is made for 2 ms, where it uses less of the range than 60 to 90 %.
        assert exposures[0] != session.rig.camera.exposure_s
        full, black = session.rig.camera.saturation_counts, session.rig.camera.black_level_counts
        peaks = [int(session.frame(index).max()) for index in range(outcome.frames)]
        assert max(peaks) < full
        # Target 0.75, tolerance 0.15; noise of the brightest of 3072 pixels adds some percent.
        assert 0.57 < (max(peaks) - black) / (full - black) < 0.93


def test_a_mosaic_turns_nothing() -> None:
    plan = RailSarPlan(aperture_m=0.0508, optics=OpticsPlan(frames_per_angle=3, auto_exposure=True))
    listed = list(plan.steps(mosaic=True))
    assert not any(isinstance(step, TurnPolarizer) for step in listed)
    assert [step for step in listed if isinstance(step, (AutoExpose, Expose))] == [AutoExpose(()), Expose(3, 0.0)]
    turning = [step for step in plan.steps() if isinstance(step, AutoExpose)]
    assert turning == [AutoExpose(tuple(math.radians(angle) for angle in (0, 45, 90, 135)))]
