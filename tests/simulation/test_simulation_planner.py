"""Bounces, rays and segments of a simulated radar by a tolerance: expected errors against measured, and the command."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.accuracy_planners_traced import carry_out_radar
from benchmarks.traced_scenes import random_yard
from polfuse_lab.cli import build
from polfuse_lab.products.store import Products
from processing.errors import DataError
from processing.raytrace import shapes
from processing.raytrace.materials import Lambert
from processing.scattering.history import Sweep
from processing.scattering.shooting import Density
from processing.scattering.surfaces import RadarSurface
from processing.scene.radar_planner import plan_radar
from processing.scene.radar_simulation import RadarLook, simulate_radar, straight_track
from processing.scene.solids import Part, Solid, SolidScene, Substance


def test_expected_errors_are_those_of_a_random_yard() -> None:
    found = carry_out_radar(1)
    assert found.promised
    assert abs(found.off_db) < 6.02
    assert found.measured_db < found.tolerance_db


def corner(turn_rad: float) -> SolidScene:
    """A dihedral that is open to the radar; nothing else."""
    body = shapes.dihedral(1.0).turned(shapes.turn_about((0, 0, 1), math.pi + turn_rad))
    substances = (Substance("metal", RadarSurface(), Lambert(0.5)),)
    return SolidScene("corner", substances, (Solid("corner", "dihedral", (Part(body, "metal"),)),))


LOOK = RadarLook(
    straight_track((0.0, -2000.0, 2000.0), 40.0, 9), (0.0, 0.0, 0.0), Sweep(2e9, 0.1e9, 16), Density(0.3)
)  # fmt: skip


def test_a_dihedral_takes_two_bounces() -> None:
    plan = plan_radar(corner(0.02), LOOK, -20.0)
    assert plan.reached
    assert plan.density.bounces == 2
    # There is no third one.
    assert plan.bounces_db == -math.inf
    alone = next(one for one in plan.considered if one.density == replace(plan.density, bounces=1))
    assert alone.error_db > -10
    words = " ".join(plan.explain())
    assert "2 bounces" in words
    assert "tolerance -20 dB" in words
    # As the simulation would have it: against much denser rays.
    made, dense = (
        simulate_radar(corner(0.02), replace(LOOK, density=density, turn_rad=plan.turn_rad)).total.echoes
        for density in (plan.density, Density(0.02, 4, 3))
    )
    error = 20 * math.log10(np.linalg.norm(made - dense) / np.linalg.norm(dense))
    assert error < -20.0
    assert error < plan.predicted_error_db + 6.02


def test_finer_tolerances_cost_more() -> None:
    yard = random_yard(1)
    coarse, fine = (plan_radar(yard.scene, yard.look, tolerance) for tolerance in (-8.0, -20.0))
    assert coarse.predicted_error_db <= -8.0
    assert fine.predicted_error_db <= -20.0
    cost = [next(one.seconds for one in plan.considered if one.density == plan.density) for plan in (coarse, fine)]
    assert cost[0] < cost[1]


@pytest.mark.parametrize("tolerance_db", [0.0, 2.0, math.nan, -math.inf])
def test_tolerances_that_are_none(tolerance_db: float) -> None:
    with pytest.raises(DataError, match="negative"):
        plan_radar(corner(0.0), LOOK, tolerance_db)


SCENE = """
[flight]
altitude_m = 2000.0
track_m = 40.0
pulses = 16

[radar]
centre_hz = 2e9
bandwidth_hz = 0.1e9
frequencies = 16
noise_equivalent_db = -60.0

[camera]
focal_length_m = 0.1
pixel_pitch_m = 20e-6
samples = 4

[grid]
width_m = 4.0
depth_m = 4.0
step_x_m = 0.5
step_y_m = 0.5

[[substance]]
name = "metal"
radar = "conductor"
kind = "lambert"
diffuse = 0.6

[[solid]]
shape = "dihedral"
substance = "metal"
edge_m = 1.0
turn_deg = 1.0
"""


def test_the_command_keeps_both_plans(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    words = ["simulate", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "out.h5"), "--tolerance", "preview"]
    done = CliRunner().invoke(build(), [*words, "--json"])
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)
    kept = Products(tmp_path / "out.h5").settings("simulation")
    for eye in ("radar_plan", "light_plan"):
        assert kept[eye] == told[eye]
        assert kept[eye]["tolerance_db"] == -20.0
        assert kept[eye]["predicted_error_db"] <= -20.0
    assert kept["radar_plan"]["bounces"] == 2 == kept["left_out"]["bounces"]
    assert told["samples"] == kept["light_plan"]["samples"] > 4
    said = CliRunner().invoke(build(), [*words, "--explain"]).stdout
    assert "2 bounces, cells of" in said
    assert "rays of a pixel" in said
    plain = CliRunner().invoke(build(), [*words[:-2], "--json"])
    assert "radar_plan" not in json.loads(plain.stdout)
