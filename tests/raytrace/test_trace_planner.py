"""Rays and bounces by a tolerance: expected errors against measured ones, what is left out, and the command."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.accuracy_planners_traced import carry_out_light
from polfuse_lab.cli import build
from polfuse_lab.products.store import Products
from processing.errors import DataError
from processing.raytrace import shapes
from processing.raytrace.backward import backward
from processing.raytrace.materials import Fresnel, Lambert
from processing.raytrace.picture import unmet_limit
from processing.raytrace.planner import MOST_BOUNCES, trace_to
from processing.raytrace.sources import PointSource, RayleighSky, Sun
from processing.raytrace.view import View
from processing.raytrace.world import World, world

INSIDE = View((0.0, 0.0, -0.5), (0.0, 0.0, 1.0), 8, 8, 1.0, (0.0, 1.0, 0.0))


def ball(albedo: float) -> World:
    """An integrating sphere with a lamp in its middle: each reflection has albedo times the light of the one before."""
    return world(shapes.sphere(1.0, divisions=3), [Lambert(albedo)], [PointSource((0.0, 0.0, 0.0), 1.0)])


@pytest.mark.parametrize(("albedo", "tolerance_db"), [(0.5, -25.0), (0.9, -20.0)])
def test_bounces_in_an_integrating_sphere(albedo: float, tolerance_db: float) -> None:
    picture, plan = trace_to(ball(albedo), INSIDE, tolerance_db)
    assert plan.reached
    # What b reflections leave out is albedo^b of the whole; the first look's samples, which follow all, dilute it.
    left = {bounces: left_db for bounces, left_db, _ in plan.considered}
    for bounces in (1, 3):
        assert left[bounces] == pytest.approx(20 * bounces * math.log10(albedo), abs=1.5)
    assert albedo**plan.bounces <= 10 ** (tolerance_db / 20)
    assert plan.left_out_db <= left[plan.bounces] + 1e-9
    # The whole: 1 / (4 pi) of flux 4 pi on the sphere, over pi, times a / (1 - a).
    level = albedo / (1 - albedo) / math.pi
    error = math.sqrt(np.mean((picture.mean[..., 0] / level - 1) ** 2))
    assert 20 * math.log10(error) < tolerance_db + 1


def test_light_beyond_what_is_followed_is_counted() -> None:
    # 0.97 after 40 reflections: 0.3 of the light is left, whatever the number of rays.
    _, plan = trace_to(ball(0.97), INSIDE, -30.0, most_samples=64)
    assert plan.bounces == MOST_BOUNCES
    assert not plan.reached
    assert {b: db for b, db, _ in plan.considered}[MOST_BOUNCES] == pytest.approx(-10.6, abs=3.0)
    assert "not reached" in plan.explain()[0]


@pytest.mark.parametrize("seed", range(6))
def test_expected_errors_are_those_of_random_scenes(seed: int) -> None:
    found = carry_out_light(seed)
    assert abs(found.measured_db - found.predicted_db) < 6.02
    assert found.predicted_db <= found.tolerance_db


def test_large_pictures_are_first_looked_at_with_fewer_pixels() -> None:
    view = View((0.3, 5.0, 4.0), (0.0, 0.7, 0.7), 72, 64, math.radians(20))
    scene = world(shapes.dihedral(2.0), [Fresnel(1.02 + 6.84j, 0.3)], [Sun((0.2, 0.6, 0.7), 3.0)])
    picture, plan = trace_to(scene, view, -18.0)
    assert picture.mean.shape == (64, 72, 4)
    whole = backward(scene, view, samples=200, seed=9, leave_out=False)
    apart = np.sum((picture.mean - whole.mean) ** 2) - np.sum(whole.standard_error**2)
    error = 10 * math.log10(apart / np.sum(whole.mean**2))
    assert error == pytest.approx(plan.predicted_error_db, abs=1.5)
    assert plan.pilot_rays < 0.5 * plan.rays
    same, _ = trace_to(scene, view, -18.0)
    np.testing.assert_array_equal(same.mean, picture.mean)


def test_light_that_no_ray_met() -> None:
    # Rule of three: 1 - 0.05^(1/n) is 3 / n; all of it in one of 36 pixels, each with 16 rays.
    assert unmet_limit(2.0, 0.5, 36, 16) == pytest.approx((1 - 0.05 ** (1 / 1e6)) * 1e6 / 16 * 2.0 / 0.5 / 6, rel=1e-5)
    dark = world(shapes.plate(2.0), [Lambert(0.5)], [Sun((0.0, 0.0, -1.0)), PointSource((0.0, 0.0, 2.0), 1.0)])
    view = View((0, 0, 5), (0, 0, 0), 6, 6, 0.2, (0, 1, 0))
    picture = backward(dark, view, error=0.05)
    (sun,) = [part for part in picture.left_out if (part.bounce, part.source) == (1, 0)]
    assert not sun.met
    # All pixels are alike: the brightest ray is bounded by the root of 16 equal squares.
    assert sun.error == pytest.approx(3.0 / 16 * 4 / 6, rel=0.06)
    assert sun.words() == f"not met by 576 rays, below {100 * sun.error:.2g} % at 95 %"
    only = world(shapes.plate(2.0), [Lambert(0.5)], [Sun((0.0, 0.0, -1.0))])
    picture, plan = trace_to(only, view, -20.0)
    assert not picture.mean.any()
    assert math.isnan(plan.predicted_error_db)
    assert not plan.reached
    assert plan.explain() == [f"no light was met by {plan.pilot_rays} rays: nothing to choose by"]


def test_pictures_without_noise_take_the_least_rays() -> None:
    scene = world(shapes.plate(2.0), [Lambert(0.5)], [Sun((0, 0.5, math.sqrt(0.75)), 2.0, 0.0)])
    _, plan = trace_to(scene, View((0, 0, 5), (0, 0, 0), 4, 4, 0.2, (0, 1, 0)), -60.0)
    assert plan.samples == 2048 // 16
    assert plan.predicted_error_db < -150
    mirror = world(shapes.plate(2.0), [Fresnel(1.5)], [Sun((0, 0.5, 1)), RayleighSky((0, 0, 1))])
    _, plan = trace_to(mirror, View((0, 0, 5), (0, 0, 0), 4, 4, 0.2, (0, 1, 0)), -20.0)
    assert "mirrors" in plan.explain()[-1]


@pytest.mark.parametrize("tolerance_db", [0.0, 3.0, math.nan, -math.inf])
def test_tolerances_that_are_none(tolerance_db: float) -> None:
    with pytest.raises(DataError, match="negative"):
        trace_to(ball(0.5), INSIDE, tolerance_db)


SCENE = """
[camera]
position_m = [0.0, 3.0, 2.0]
target_m = [0.0, 0.0, 0.3]
width_px = 12
height_px = 8

[[material]]
name = "foil"
kind = "fresnel"
n = 1.02
k = 6.84
slope_sd = 0.3

[[body]]
shape = "dihedral"
material = "foil"

[[source]]
kind = "sun"
direction = [0.1, 1.0, 1.0]
"""


def test_the_command_keeps_choice_and_error(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    words = ["raytrace", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "out.h5"), "--tolerance", "preview"]
    done = CliRunner().invoke(build(), [*words, "--json"])
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["tolerance_db"] == -20.0
    assert -30 < told["predicted_error_db"] <= -20.0
    assert told["reached"]
    kept = Products(tmp_path / "out.h5").settings("raytrace")
    for name in ("tolerance_db", "predicted_error_db", "noise_db", "left_out_db", "bounces", "samples", "explanation"):
        assert kept[name] == told[name]
    assert {"bounce", "source", "error", "met", "rays"} == set(kept["left_out"][0])
    said = CliRunner().invoke(build(), [*words, "--explain"]).stdout
    assert "rays of a pixel" in said
    assert f"not {told['bounces'] - 1} bounces" in said
    assert "at 95 %" in said


@pytest.mark.parametrize("words", [["--tolerance", "perfect"], ["--tolerance", "3"], ["--tolerance", "field"]])
def test_tolerances_that_the_command_refuses(tmp_path: Path, words: list[str]) -> None:
    scene = SCENE.replace("[[material]]", '[trace]\nmethod = "forward"\n\n[[material]]', 1)
    (tmp_path / "scene.toml").write_text(scene)
    done = CliRunner().invoke(build(), ["raytrace", str(tmp_path / "scene.toml"), "-o", str(tmp_path / "o.h5"), *words])
    assert done.exit_code == 1
    assert done.stderr.startswith("error: ")
    assert "defect" not in done.stderr
    assert not (tmp_path / "o.h5").exists()
