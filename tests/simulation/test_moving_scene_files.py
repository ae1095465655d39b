"""Scene files in which something moves: what both eyes see of it, and how it is found again."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.products.store import Products
from polfuse_lab.rig import parse_model
from polfuse_lab.simulation.scene_file import TABLES, SolidSceneFile
from processing.optics.camera_model import Pinhole

VELOCITY = (8.0, -2.0, 0.0)
SPEED_OF_LIGHT = 299_792_458.0

# Table 8.1 with a quarter of its band and half of its pulses: 1.9 km of track are unambiguous, and the beam is as wide.
# The lorry is a corner for the radar and a white roof for the camera, above ground that the radar does not see.
SCENE = f"""
[flight]
table = "8.1"
pulses = 2176
[radar]
bandwidth_hz = 20e6
frequencies = 32
cell_m = 1.0
levels = 2
move_m = 50.0
noise_equivalent_db = -20.0
[camera]
focal_length_m = 0.64
pixel_pitch_m = 30e-6
samples = 30
exposure_interval_s = 0.5
[grid]
width_m = 100.0
depth_m = 60.0
step_x_m = 2.0
step_y_m = 2.0
[[substance]]
name = "metal"
radar = "conductor"
kind = "lambert"
diffuse = 0.1
[[substance]]
name = "paint"
radar = "passed"
kind = "lambert"
diffuse = 0.7
[[substance]]
name = "soil"
radar = "passed"
kind = "lambert"
diffuse = 0.1
[[solid]]
shape = "ground"
substance = "soil"
width_m = 140.0
depth_m = 110.0
[[solid]]
name = "roof"
kind = "lorry"
shape = "plate"
substance = "paint"
width_m = 14.0
depth_m = 8.0
position_m = [-12.0, 3.0, 0.1]
velocity_m_s = {list(VELOCITY)}
[[solid]]
name = "lorry"
shape = "trihedral"
substance = "metal"
edge_m = 2.0
position_m = [-12.0, 0.0, 0.2]
velocity_m_s = {list(VELOCITY)}
"""


def run(*arguments: str | Path) -> tuple[int, str, str]:
    result = CliRunner().invoke(build(), [str(argument) for argument in arguments])
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture(scope="module")
def moved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("moving")
    (folder / "scene.toml").write_text(SCENE)
    code, _, err = run("simulate", folder / "scene.toml", "-o", folder / "out.h5")
    assert code == 0, err
    code, out, err = run("motion", folder / "out.h5", "--x", "-200", "300", "--json")
    assert code == 0, err
    return folder / "out.h5", json.loads(out)


def test_truth_is_kept(moved: tuple[Path, dict[str, Any]]) -> None:
    store = Products(moved[0])
    assert store.stages() == ["matrices", "polarimetry", "simulation", "history", "exposures", "moving", "motion"]
    bodies = store.settings("simulation")["bodies"]
    assert [body["velocity_m_s"] for body in bodies] == [[0, 0, 0], list(VELOCITY), list(VELOCITY)]
    # The map is that of time 0.
    arrays = store.read("simulation")
    x, y = np.meshgrid(arrays["x_m"], arrays["y_m"])
    lorry = (np.abs(x + 12) < 6.9) & (np.abs(y - 3) < 3.9)
    assert np.all(arrays["body"][lorry] > 0)
    assert np.all(arrays["body"][np.hypot(x + 12, y - 3) > 12] == 0)


def test_the_radar_finds_it_with_its_velocity(moved: tuple[Path, dict[str, Any]]) -> None:
    (target,) = moved[1]["targets"]
    error = math.hypot(target["azimuth_m_s"] - VELOCITY[0], target["ground_m_s"] - VELOCITY[1])
    assert error < 0.05 * math.hypot(*VELOCITY)
    assert abs(target["ground_m_s"] - VELOCITY[1]) < 4 * target["ground_sd_m_s"]
    # The corner's fold at time 0, 0.2 m up: at 45 degrees as far as ground 0.2 m nearer.
    assert target["x_m"] == pytest.approx(-12.0, abs=4 * target["ground_sd_m_s"] * 21_213 / 240)
    assert target["y_m"] == pytest.approx(-0.2, abs=1.0)


def test_each_exposure_sees_it_elsewhere(moved: tuple[Path, dict[str, Any]]) -> None:
    path, told = moved
    store = Products(path)
    held, settings = store.read("exposures"), store.settings("exposures")
    np.testing.assert_allclose(held["time_s"], [0.0, 0.5, 1.0, 1.5])
    values = settings["camera"]
    camera = Pinhole(**{**values, **{n: tuple(values[n]) for n in ("position_m", "distortion", "principal_offset_px")}})
    for light, instant in zip(held["electrons"], held["time_s"], strict=True):
        row, column = np.nonzero(light > 0.5 * light.max())
        u, v, _ = camera.project(np.array([-12.0, 3.0, 0.1]) + np.array(VELOCITY) * instant)
        assert (column.mean(), row.mean()) == pytest.approx((float(u), float(v)), abs=0.4)
    # Full scale is white that faces the sun, half of it behind each polarizer: 0.7 of cos 45 degrees, and sky.
    assert np.median(light[light > 0.5 * light.max()]) == pytest.approx(10_500 * 0.7 * math.sqrt(0.5) * 1.2, rel=0.02)
    # By what the radar said its traces go: DOLP of a surface that does not polarize.
    assert told["velocity_from"] == "radar"
    assert told["error_down_db"] > 10
    stored = store.read("motion")
    inside = stored["object"] > 0
    assert np.nanpercentile(stored["dolp_before"], 99) > 0.5
    assert np.nanmedian(stored["dolp"][inside]) < 0.05
    assert all(Path(figure).stat().st_size > 10_000 for figure in told["figures"])


def test_without_a_beam_nothing_tells_when_it_was_abeam(moved: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    store, other = Products(moved[0]), Products(tmp_path / "even.h5")
    settings = {**store.settings("history"), "beamwidth_rad": None}
    other.write("history", store.read("history"), settings=settings, inputs=[], units={})
    code, _, err = run("motion", other.path)
    assert code == 1
    assert "radar.beamwidth_deg" in err
    still = Products(tmp_path / "still.h5")
    still.write("matrices", {"planes": np.zeros((4, 2, 2))}, settings={}, inputs=[], units={})
    code, _, err = run("motion", still.path)
    assert code == 1
    assert "with a body that moves" in err


REST = SCENE[SCENE.index("[grid]") :]


def test_tables_stand_in_for_what_is_not_given() -> None:
    first = parse_model('[flight]\ntable = "6.1"\n' + REST, SolidSceneFile, "scene.toml")
    air = first.airborne()
    # Table 6.1: 31.2 cm, 15 km, 200 m/s, a pulse every 10 ms, 45 degrees.
    assert SPEED_OF_LIGHT / air.centre_hz == pytest.approx(0.312)
    assert (air.altitude_m, air.speed_m_s, air.look_rad) == (15_000, 200, pytest.approx(math.pi / 4))
    np.testing.assert_allclose(np.diff(air.time_s), 0.010, rtol=1e-9)
    assert air.beamwidth_rad is None
    given = parse_model('[flight]\ntable = "8.1"\n[radar]\nfrequencies = 64\n' + REST, SolidSceneFile, "scene.toml")
    air = given.airborne()
    # Table 8.1: 240 m/s, 362.53 Hz, 80 MHz, 4.5 degrees.
    assert (air.speed_m_s, air.bandwidth_hz, air.frequencies) == (240, 80e6, 64)
    assert air.beamwidth_rad == pytest.approx(math.radians(4.5))
    np.testing.assert_allclose(np.diff(air.time_s), 1 / 362.53, rtol=1e-9)
    assert air.aperture_m == pytest.approx(2 * 15_000 * math.sqrt(2) * math.tan(math.radians(2.25)))
    plain = parse_model('[flight]\ntable = "7.2"\n' + REST, SolidSceneFile, "scene.toml")
    assert plain == parse_model(REST, SolidSceneFile, "scene.toml")
    assert set(TABLES) == {"6.1", "7.2", "8.1"}
    with pytest.raises(Exception, match=r"line 2, flight.table"):
        parse_model('[flight]\ntable = "5.1"\n' + REST, SolidSceneFile, "scene.toml")
    with pytest.raises(Exception, match=r"radar"):
        parse_model('radar = 3\n[flight]\ntable = "8.1"\n' + REST, SolidSceneFile, "scene.toml")
