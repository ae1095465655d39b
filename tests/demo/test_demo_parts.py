"""Parts of the demo: its files, and that its checks tell right from wrong."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from hw_mocks.scene_file import SceneFile, load_scene
from polfuse_lab.demo import files
from polfuse_lab.demo.collect_checks import collect_checks
from polfuse_lab.demo.optics_checks import optics_checks
from polfuse_lab.demo.radar_checks import method_checks, place_checks, resolution_checks, target_spec, targets
from polfuse_lab.demo.thesis_checks import thesis_checks
from polfuse_lab.engine import Finished
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import RailSarPlan, SkyPlan, parse_plan
from polfuse_lab.products.checks import Check
from polfuse_lab.products.optics import UNITS
from polfuse_lab.products.store import Products
from polfuse_lab.rig import parse_model
from processing.optics.camera_model import Pinhole
from processing.optics.series import PolarizerSeries, SensorNoise
from processing.optics.stokes import stokes_image
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid
from processing.scene.model import Point, Scene
from processing.scene.optical import stokes_image as render
from processing.scene.radar_response import scatterers

GROUND_Z_M = -1.069
CENTRE_HZ, BANDWIDTH_HZ = 2.4e9, 80e6
CHANNELS = ("HH", "VV")


def names_of_failed(checks: list[Check]) -> list[str]:
    return [check.name for check in checks if not check.ok]


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return load_scene(files.write_text(tmp_path_factory.mktemp("scene") / "scene.toml", files.scene_text()))


def test_the_sky_is_the_scene_without_targets() -> None:
    whole = parse_model(files.scene_text(), SceneFile, "scene.toml")
    sky = parse_model(files.without_targets(files.scene_text()), SceneFile, "sky.toml")
    assert whole.point
    assert whole.reflector
    assert whole.bush
    assert sky == whole.model_copy(update={"point": (), "reflector": (), "bush": ()})


@pytest.mark.parametrize(("quick", "positions"), [(True, files.QUICK_POSITIONS), (False, 61)])
def test_plans(quick: bool, positions: int) -> None:
    plan = parse_plan(files.plan_text(quick=quick, sweeps=2), "plan.toml")
    assert isinstance(plan, RailSarPlan)
    assert len(plan.positions_m) == positions
    assert plan.positions_m[0] == -plan.positions_m[-1]
    assert set(plan.channels) == {"HH", "HV", "VH", "VV"}
    sky = parse_plan(files.sky_plan_text(sweeps=2), "sky.toml")
    assert isinstance(sky, SkyPlan)
    assert (sky.kind, sky.sweeps_per_channel) == ("sky", 2)


def test_a_place_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(PolfuseError, match="--out"):
        files.write_text(tmp_path / "file" / "scene.toml", "")


def test_figures_of_the_thesis_hold() -> None:
    checks = thesis_checks()
    assert names_of_failed(checks) == []
    assert len(checks) == 6


def test_anything_lost_is_told() -> None:
    plan = parse_plan(files.plan_text(quick=True, sweeps=2), "plan.toml")
    records = files.QUICK_POSITIONS * 4
    good = Finished("finished", "", "s.h5", files.QUICK_POSITIONS, records, 8, 0, 0, 1e-5, 20.0, [])
    assert names_of_failed(collect_checks(good, plan)) == []
    bad = Finished("finished", "", "s.h5", files.QUICK_POSITIONS - 1, records - 1, 7, 5, 1, 1e-5, 20.0, [])
    assert len(names_of_failed(collect_checks(bad, plan))) == 5


def focused(path: Path, scene: Scene, *, noise: float = 0.0) -> Path:
    """Products of a scene as an ideal radar with a Hann window sees it: closed-form profiles, back-projected."""
    x = 0.0508 * (np.arange(21) - 10)
    antenna = np.stack([x, np.zeros(21), np.zeros(21)], axis=1)
    cell = SPEED_OF_LIGHT_M_S / (2 * BANDWIDTH_HZ)
    range_m = np.arange(0.0, 24.0, cell / 8)
    values = np.zeros((2, len(x), len(range_m)), dtype=np.complex128)
    for p, place in enumerate(antenna):
        centres, s = scatterers(scene, place, SPEED_OF_LIGHT_M_S / CENTRE_HZ)
        distance = np.linalg.norm(centres - place, axis=1)
        away = (range_m - distance[:, None]) / cell
        envelope = np.sinc(away) + 0.5 * (np.sinc(away - 1) + np.sinc(away + 1))
        phase = np.exp(-4j * np.pi * CENTRE_HZ * distance / SPEED_OF_LIGHT_M_S)
        for c in range(2):
            values[c, p] = np.sum((s[:, c, c] * phase / distance**2)[:, None] * envelope, axis=0) * range_m**2
    random = np.random.default_rng(0).normal(size=(2, *values.shape))
    values += noise * (random[0] + 1j * random[1]) * range_m**2
    profiles = RangeProfiles(values, range_m, antenna, CHANNELS, CENTRE_HZ, BANDWIDTH_HZ, "hann", True)
    grid = ImageGrid(np.arange(-4.0, 4.01, 0.1), np.arange(4.0, 14.01, 0.25), GROUND_Z_M)
    common = {"channels": list(CHANNELS), "centre_hz": CENTRE_HZ, "bandwidth_hz": BANDWIDTH_HZ, "window": "hann"}
    products = Products(path)
    ranging = {"profiles": values, "range_m": range_m, "antenna_m": antenna}
    products.write("ranging", ranging, settings=common | {"range_compensated": True}, inputs=[], units={})
    image = {"image": backproject(profiles, grid), "x_m": grid.x_m, "y_m": grid.y_m}
    products.write("focus", image, settings=common | {"z_m": GROUND_Z_M}, inputs=[], units={})
    return path


TWO = Scene(
    "two",
    points=(
        Point("near", (-1.5, 6.0, GROUND_Z_M), np.eye(2, dtype=np.complex128)),
        Point("high", (1.5, 11.0, GROUND_Z_M + 0.5), 2 * np.eye(2, dtype=np.complex128)),
    ),
)


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return focused(tmp_path_factory.mktemp("two") / "p.h5", TWO)


def test_targets_are_found_where_they_are_and_not_elsewhere(two: Path) -> None:
    assert names_of_failed(place_checks(two, TWO)) == []
    # A truth that is wrong by 0.8 of a cell (some 0.4 m at 6 m) must not pass.
    moved = dataclasses.replace(TWO.points[0], position_m=(-1.1, 6.0, GROUND_Z_M))
    wrong = dataclasses.replace(TWO, points=(moved, TWO.points[1]))
    assert names_of_failed(place_checks(two, wrong)) == ["place_near"]


def test_a_target_above_the_ground_lays_over(two: Path) -> None:
    high = list(targets(TWO, GROUND_Z_M))[1]
    # Same slant range on the ground plane: 11^2 + 0.569^2 = y^2 + 1.069^2.
    assert high.y_m == pytest.approx(np.sqrt(121 + 0.569**2 - 1.069**2))
    assert high.y_m < 11.0


def test_resolution_is_theory_and_a_coarser_one_is_told(two: Path, tmp_path: Path) -> None:
    assert names_of_failed(resolution_checks(two, TWO)) == []
    # Two points 0.6 of a cell apart along the rail look like one wide one.
    beside = Point("beside", (-1.1, 6.0, GROUND_Z_M), 1j * np.eye(2, dtype=np.complex128))
    blurred = focused(tmp_path / "p.h5", dataclasses.replace(TWO, points=(*TWO.points, beside)))
    assert "resolution_cross_range" in names_of_failed(resolution_checks(blurred, TWO))


def test_two_methods_are_compared(two: Path, tmp_path: Path) -> None:
    assert names_of_failed(method_checks(two, two, TWO)) == []
    noisy = focused(tmp_path / "noisy.h5", TWO, noise=3e-3)
    assert "rma_correlation" in names_of_failed(method_checks(two, noisy, TWO))


def test_target_specs_say_what_the_scene_says(scene: Scene) -> None:
    for reflector in scene.reflectors:
        assert target_spec(reflector, GROUND_Z_M).reflector(GROUND_Z_M).position_m == pytest.approx(
            reflector.position_m
        )


@pytest.fixture(scope="module")
def light(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene through an ideal camera whose polarizer stands 0.2 degrees off at every angle, within its 0.25."""
    path = tmp_path_factory.mktemp("light") / "p.h5"
    camera = Pinhole(0.008, 16.6e-6, 391, 291, (0.0, 0.0, 0.0), np.radians(10.0))
    planes, _ = render(scene, camera)
    asked = np.radians([0.0, 45.0, 90.0, 135.0])
    stood = asked + np.radians([0.2, -0.2, 0.2, -0.2])
    series = PolarizerSeries(tuple(asked), (4,) * 4, (np.radians(0.25),) * 4, np.inf, SensorNoise(12.0, 1.0))
    s0, s1, s2 = planes * scene.sun_counts
    frames = np.stack([(s0 + s1 * np.cos(2 * a) + s2 * np.sin(2 * a)) / 2 for a in stood])
    image = stokes_image(frames, np.zeros(frames.shape[1:], dtype=bool), series)
    settings = {"camera": dataclasses.asdict(camera), "series": dataclasses.asdict(series)}
    settings["series"]["extinction_ratio"] = None
    arrays = {name: getattr(image, name) for name in UNITS}
    Products(path).write("optics", arrays, settings=settings, inputs=[], units=UNITS)
    return path


def test_every_surface_is_checked_within_its_own_uncertainty(light: Path, scene: Scene) -> None:
    checks = optics_checks(light, scene)
    assert {f"dolp_{surface.name.replace(' ', '_')}" for surface in scene.surfaces} < {check.name for check in checks}
    assert names_of_failed(checks) == []
    assert all(0 < check.tolerance < 0.02 for check in checks)


def test_a_wrong_dolp_is_told(light: Path, scene: Scene) -> None:
    plate = next(surface for surface in scene.surfaces if surface.name == "plate")
    s0, s1, s2 = plate.stokes
    wrong = dataclasses.replace(plate, stokes=(s0, 0.95 * s1, 0.95 * s2))
    others = tuple(wrong if surface is plate else surface for surface in scene.surfaces)
    assert names_of_failed(optics_checks(light, dataclasses.replace(scene, surfaces=others))) == ["dolp_plate"]
