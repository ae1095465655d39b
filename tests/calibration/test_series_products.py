"""A calibration series calibrates a scene; bad targets are refused with the reason. Truth: closed-form beats."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from calibration_rig import distortion
from rail_data import HEIGHT_M
from series_session import PLAN, seen, write_records, write_series
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.cli.calibration_told import lines
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.calibrate import calibrate
from polfuse_lab.products.calibration_inputs import TargetSpec
from polfuse_lab.products.focus import focus
from polfuse_lab.products.store import Products
from processing.errors import DataError
from processing.sar.grid import ImageGrid
from processing.scene.model import Reflector

GRID = ImageGrid(np.arange(-2.0, 2.01, 0.1), np.arange(3.0, 12.01, 0.25), -HEIGHT_M)
TRUTH = distortion(np.random.default_rng(0))
AMPLITUDE_DB = 20 * np.log10(0.5)
NOISE = 0.01
DRAWS = 200
S = np.array([[10, 3], [3, 5j]])
PLACE = (0.5, 9.0, -HEIGHT_M)
RAIL = np.linspace(-0.3, 0.3, 7)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The focused scene: something with all elements of S, 9 m away, seen through the distorted radar."""
    made = tmp_path_factory.mktemp("series")
    scene = write_records(made / "scene.h5", [[(PLACE, TRUTH.apply(S))]] * len(RAIL), RAIL, noise=NOISE, seed=3)
    focus(scene, made / "products.h5", grid=GRID)
    write_series(made / "series.h5", PLAN, TRUTH, noise=NOISE)
    return made


@pytest.fixture
def products(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(folder / "products.h5", tmp_path / "p.h5"))


def upright(reflector: Reflector, fold_rad: float = np.pi / 2) -> Reflector:
    """A dihedral that looks at the radar, in a reflector's place."""
    return dataclasses.replace(reflector, kind="dihedral", azimuth_rad=0.0, elevation_rad=0.0, fold_rad=fold_rad)


def at_the_target(products: Path) -> np.ndarray:
    """Calibrated channels at the scene's target, in the order of ``CHANNELS``."""
    image = Products(products).read("calibration")["scattering"]
    return image[:, np.argmin(abs(GRID.y_m - PLACE[1])), np.argmin(abs(GRID.x_m - PLACE[0]))]


def test_crosstalk_and_imbalance_come_off_the_scene(folder: Path, products: Path) -> None:
    looked: list[str] = []
    found = calibrate(
        products, draws=DRAWS, series=folder / "series.h5", on_target=lambda view: looked.append(view.spec.label)
    )
    assert looked == ["corner", "upright", "turned"]
    assert found.method == "targets"
    left = TRUTH.residual(found.distortion)
    # The project's own targets: crosstalk left below -40 dB, imbalance below 0.1 dB and 1 degree, RCS within 0.2 dB.
    assert left.worst_crosstalk_db < -40
    assert abs(left.co_db) < 0.1
    assert abs(left.co_deg) < 1
    assert found.constant_db == pytest.approx(-AMPLITUDE_DB, abs=0.2)
    values = at_the_target(products)
    # Ratios of channels: noise 60 dB down, crosstalk error 45 dB below HH.
    np.testing.assert_allclose(values / values[0], np.array([1, 0.3, 0.3, 0.5j]), atol=0.01)
    assert 20 * np.log10(abs(values[0])) == pytest.approx(20, abs=0.2)
    assert [view.repeats for view in found.targets] == [2, 2, 2]
    assert found.crosstalk_db["HV"] > -20
    settings = Products(products).settings("calibration")
    assert [item["name"] for item in settings["targets"]] == looked
    assert {line["cause"] for line in settings["budget"]} >= {"orientation of the folds", "repeats (2)"}
    assert settings["uncertainty"]["co_imbalance_deg"]["expanded"] < 1


def test_a_target_in_the_scene_gives_constant_and_phases(folder: Path, tmp_path: Path) -> None:
    # The scene's channels stand in other phases to each other than the series', as if switched or driven anew.
    turned = np.exp(1j * np.radians([0, 50, -70, 30]))
    by_channel = np.array([[turned[0], turned[2]], [turned[1], turned[3]]])
    corner = Reflector("corner", "trihedral", (-1.0, 5.0, -HEIGHT_M), 0.61, np.radians(42), np.radians(33))
    scenes = []
    for x in RAIL:
        place, m = seen(corner, TRUTH, x)
        scenes.append([(place, 2 * m * by_channel), (PLACE, 2 * TRUTH.apply(S) * by_channel)])
    scene = write_records(tmp_path / "scene.h5", scenes, RAIL, noise=NOISE, seed=4, gain=0.5)
    focus(scene, tmp_path / "p.h5", grid=GRID)
    spec = TargetSpec("trihedral", -1.0, 5.0, 0.61, np.radians(42), np.radians(33), angle_sd_rad=np.radians(1))
    found = calibrate(tmp_path / "p.h5", spec, series=folder / "series.h5", draws=DRAWS)
    assert found.phases is not None
    degrees = np.degrees(found.phases.phase_rad)
    sd = np.degrees(found.phases.phase_sd_rad())
    # Side lobes of the other target: -30 dB of its 20 dBsm on the trihedral's 24, 1 degree in a co-polarized channel;
    # HV and VH show the trihedral by crosstalk alone, 20 dB weaker.
    assert degrees[3] == pytest.approx(30, abs=3)
    assert degrees[1] == pytest.approx(50, abs=25)
    # In VH the trihedral's leaks nearly cancel (-26 dB), so that nothing tells its phase, which is said.
    assert found.phases.known() == ("HH", "HV", "VV")
    assert sd[3] < sd[1] < sd[2] == pytest.approx(180 / np.sqrt(3))
    # The constant is the target's own (its angles are stated with an error, the series' are not).
    line = next(item for item in found.budget.lines if item.cause == "angles of the reference, target in the image")
    assert line.contributions["constant_db"] > 0.01
    assert found.constant_db == pytest.approx(-AMPLITUDE_DB, abs=0.4)
    values = at_the_target(tmp_path / "p.h5")
    assert np.degrees(np.angle(values[3] / values[0])) == pytest.approx(90, abs=6)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"upright": lambda r: None}, "upright: (nothing is seen|it stands only)"),
        ({"upright": lambda r: dataclasses.replace(r, position_m=(0.0, 9.0, -HEIGHT_M))}, "not at its stated place"),
        (
            {"upright": lambda r: dataclasses.replace(r, fold_rad=np.radians(65))},
            "fold stands 2. degrees from level or",
        ),
        ({"turned": lambda r: dataclasses.replace(r, fold_rad=np.pi / 2)}, "fold stands . degrees .* instead of 45"),
        ({"corner": lambda r: upright(r, fold_rad=0.7)}, "cross-polarized return is"),
        ({"turned": lambda r: dataclasses.replace(r, edge_m=0.35)}, "turned is refused: its RCS is"),
        ({"corner": lambda r: upright(r)}, "corner and upright look alike"),
    ],
)
def test_bad_targets_are_refused_with_the_reason(products: Path, tmp_path: Path, change, reason: str) -> None:
    series = write_series(tmp_path / "s.h5", PLAN.replace("repeats = 2", ""), TRUTH, changed=change, noise=0.02)
    with pytest.raises((PolfuseError, DataError), match=reason):
        calibrate(products, draws=DRAWS, series=series)
    assert "calibration" not in Products(products).stages()


def test_a_saturated_beat_is_refused(products: Path, tmp_path: Path) -> None:
    series = write_series(tmp_path / "s.h5", PLAN.replace("repeats = 2", ""), TRUTH, noise=NOISE, gain=8.0)
    with pytest.raises(PolfuseError, match=r"saturated.*gain down"):
        calibrate(products, draws=DRAWS, series=series)


def test_one_position_is_enough(products: Path, tmp_path: Path) -> None:
    plan = PLAN.replace("aperture_m = 0.2\nstep_m = 0.1", "")
    series = write_series(tmp_path / "s.h5", plan, TRUTH, noise=0.002)
    found = calibrate(products, draws=DRAWS, series=series)
    left = TRUTH.residual(found.distortion)
    assert left.worst_crosstalk_db < -35
    assert found.constant_db == pytest.approx(-AMPLITUDE_DB, abs=0.2)


def test_a_series_without_dihedrals_calibrates_isolated_antennas(products: Path, tmp_path: Path) -> None:
    plan = PLAN[: PLAN.index('[[targets]]\nname = "upright"')]
    found = calibrate(products, draws=DRAWS, series=write_series(tmp_path / "s.h5", plan, TRUTH, noise=NOISE))
    assert found.method == "isolated"
    assert found.misfit is None
    # The crosstalk of -20 dB stays in: twice its square, 0.2 dB, at most.
    assert found.imbalance_db == pytest.approx(TRUTH.co_db, abs=0.2)


def test_what_is_no_series_or_of_another_radar_is_refused(folder: Path, products: Path) -> None:
    with pytest.raises(PolfuseError, match="no calibration series"):
        calibrate(products, draws=DRAWS, series=folder / "scene.h5")
    with pytest.raises(PolfuseError, match="no target is stated"):
        calibrate(products)
    store = Products(products)
    settings = {**store.settings("focus"), "centre_hz": 5.8e9}
    store.write("focus", store.read("focus"), settings=settings, inputs=[], units={})
    with pytest.raises(PolfuseError, match=r"was recorded at 2.4 GHz .* the image at 5.8 GHz"):
        calibrate(products, draws=DRAWS, series=folder / "series.h5")


def test_command_line(folder: Path, products: Path) -> None:
    done = CliRunner().invoke(build(), ["calibrate", str(products), "--series", str(folder / "series.h5"), "--json"])
    assert done.exit_code == 0, done.stderr
    printed = json.loads(done.stdout)
    assert printed["method"] == "targets"
    assert {"constant_db", "constant_sd_db", "crosstalk_db", "imbalance_db", "imbalance_deg", "check"} <= printed.keys()
    assert [item["ok"] for item in printed["targets"]] == [True] * 3
    assert printed["crosstalk_paths"]["receive_h"]["db"] == pytest.approx(-20, abs=1)
    assert {"cause", "sd", "unit", "basis", "constant_db"} <= printed["budget"][0].keys()
    assert "corner: found at" in done.stderr
    readable = "\n".join(lines(calibrate(products, series=folder / "series.h5", draws=DRAWS)))
    assert "crosstalk taken off (targets)" in readable
    assert "expanded (95 %)" in readable
