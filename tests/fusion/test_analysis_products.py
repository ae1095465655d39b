"""The thesis's analysis of products whose truth is the scene: strips, matrices, repeats, sky, near field, report."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import (
    AMPLITUDE,
    DEPRESSION_RAD,
    GRID,
    GROUND_Z_M,
    NOISE,
    WAVELENGTH_M,
    deg,
    range_profiles,
    write_radar,
)
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.analysis import analyse
from polfuse_lab.products.calibrate import TargetSpec, calibrate
from polfuse_lab.products.figures_analysis import figures_of
from polfuse_lab.products.store import Products
from polfuse_lab.report.numbers import stage_numbers
from polfuse_lab.report.pictures import stage_pictures
from processing.calibration.near_field import near_field_scattering
from processing.calibration.pattern_measurement import measured_pattern
from processing.calibration.region_analysis import mean_of_repeats, strip_power
from processing.errors import DataError
from processing.radar.antenna import one_way_gain
from processing.radar.profiles import SPEED_OF_LIGHT_M_S
from processing.scene.model import Reflector, Scene

TRIHEDRAL = Reflector("corner", "trihedral", (0.3, 8.0, GROUND_Z_M), 0.61, deg(42), deg(33))
SPEC = TargetSpec("trihedral", 0.3, 8.0, 0.61, deg(42), deg(33))
DIHEDRAL = Reflector("dihedral", "dihedral", (0.3, 8.0, GROUND_Z_M), 0.61, fold_rad=np.pi / 2)
IDEAL = np.eye(2)
REPEAT_NOISE = 3e-5


def write(path: Path, *reflectors: Reflector, noise: float = 0.0, seed: int = 0) -> Path:
    write_radar(path, range_profiles(Scene("s", reflectors=reflectors), IDEAL, IDEAL, noise=noise, seed=seed), GRID)
    return path


@pytest.fixture(scope="module")
def repeats(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Four measurements of one trihedral, calibrated each by itself."""
    folder = tmp_path_factory.mktemp("repeats")
    paths = [write(folder / f"{seed}.h5", TRIHEDRAL, noise=REPEAT_NOISE, seed=seed) for seed in range(4)]
    for path in paths:
        calibrate(path, SPEC)
    return paths


@pytest.fixture
def corner(repeats: list[Path], tmp_path: Path) -> Path:
    return Path(shutil.copy(repeats[0], tmp_path / "corner.h5"))


def test_strip_and_matrix_of_a_trihedral(corner: Path) -> None:
    found = analyse(corner)
    assert found.place_m == pytest.approx((0.3, 8.0))
    # The strip of 2 ft is wider than the cell across range (lambda R / 2 L = 17 cm): its mean lies below the peak's
    # RCS, by the share of the strip that the main lobe fills, to 1 dB.
    cell = WAVELENGTH_M * 8.07 / (2 * 3.05)
    apparent = 10 * np.log10(np.max(np.abs(Products(corner).read("calibration")["scattering"][0]) ** 2))
    assert found.peaks["HH"].rcs_dbsm == pytest.approx(apparent + 10 * np.log10(cell / 0.6096), abs=1.0)
    assert found.peaks["HH"].y_m == pytest.approx(8.0, abs=0.25)
    # Thesis 5.12: the identity.
    np.testing.assert_allclose(found.matrices.power, np.eye(2), atol=0.01)
    np.testing.assert_allclose(found.matrices.complex, np.eye(2), atol=0.01)
    assert np.isnan(found.peaks["HH"].sd_db)


def test_the_dihedral_differs_in_amplitude_and_not_in_power(tmp_path: Path) -> None:
    found = analyse(write(tmp_path / "d.h5", DIHEDRAL), (0.3, 8.0))
    # Thesis 5.12: diag(1, -1).
    np.testing.assert_allclose(found.matrices.power, np.eye(2), atol=1e-3)
    np.testing.assert_allclose(found.matrices.complex, np.diag([1.0, -1.0]), atol=1e-3)
    assert found.rcs is None
    assert found.near_field is None
    assert np.isnan(found.peaks["HH"].rcs_dbsm)
    assert {"power", "matrix_complex"} <= Products(tmp_path / "d.h5").read("analysis").keys()


def test_four_repeats_are_averaged(repeats: list[Path], corner: Path) -> None:
    found = analyse(corner, repeats=repeats[1:])
    assert found.power.count == 4
    by_hand = mean_of_repeats([strip_power(Products(path).read("focus")["image"], GRID.x_m, 0.3) for path in repeats])
    np.testing.assert_allclose(found.power.mean, by_hand.mean)
    # Noise of a focused pixel over the target: sd 4.343 sqrt(2 N / S) dB, less over the pixels of the strip (about
    # three cells), halved by four repeats.
    noise = (REPEAT_NOISE * 8.07**2) ** 2 / 61
    one = 10 / np.log(10) * np.sqrt(2 * noise / by_hand.mean[0].max())
    assert 0 < found.peaks["HH"].sd_db < one


def test_sky_shows_noise_that_grows_with_range(corner: Path, tmp_path: Path) -> None:
    sky = write(tmp_path / "sky.h5", noise=NOISE)
    found = analyse(corner, sky=sky)
    assert found.sky is not None
    assert found.noise_power is not None
    # White noise of power N, compensated: N R^4; the median of 15 cells of 61 positions is good to 5 %.
    for row in found.sky.floor:
        np.testing.assert_allclose(row[8:] / found.sky.range_m[8:] ** 4, NOISE**2, rtol=0.25)
    # In the image it is less by the 61 positions.
    expected = NOISE**2 * np.hypot(found.y_m, GROUND_Z_M) ** 4 / 61
    np.testing.assert_allclose(found.noise_power, np.broadcast_to(expected, found.noise_power.shape), rtol=0.25)
    figures = figures_of(Products(corner).read("analysis"), Products(corner).settings("analysis"))
    assert list(figures) == ["analysis", "matrices", "pattern", "sky"]


def test_pattern_of_the_antennas_is_recovered(tmp_path: Path) -> None:
    # Profiles made with beams of 50 degrees; isolated and without noise: linear interpolation between eight bins in a
    # cell is good to (pi / 8)^2 / 8 = 2 % of the amplitude, 0.17 dB, at most.
    beamwidth = deg(50)
    profiles = range_profiles(Scene("s", reflectors=(TRIHEDRAL,)), IDEAL, IDEAL, beamwidth_rad=beamwidth)
    path = tmp_path / "beam.h5"
    write_radar(path, profiles, GRID, beamwidth_rad=beamwidth, depression_rad=DEPRESSION_RAD)
    calibrate(path, SPEC)
    found = analyse(path).pattern
    assert found is not None
    channels, pattern = found
    assert channels == ("HH", "VV")
    model = 20 * np.log10(one_way_gain(np.cos(pattern.off_axis_rad), beamwidth))
    # Eleven positions together: five at each end tell nothing.
    model = np.where(np.isfinite(pattern.level_db[0]), model, np.nan)
    assert np.isfinite(model).sum() == 61 - 10
    for level in pattern.level_db:
        np.testing.assert_allclose(level, model - np.nanmax(model), atol=0.2)
    # The target stands 0.3 m to the right of the middle: seen from the left end under atan(1.82 / 8).
    assert pattern.azimuth_rad[0] == pytest.approx(np.arctan2(0.3 + 1.524, 8.0), rel=1e-3)


def test_a_target_from_another_file_tells_no_pattern(corner: Path, repeats: list[Path]) -> None:
    calibrate(corner, SPEC, reference=repeats[1])
    assert analyse(corner).pattern is None


def test_patterns_that_cannot_be_measured() -> None:
    profiles, axis, places = np.ones((1, 3, 8)), np.arange(8.0), np.zeros((3, 3))
    with pytest.raises(DataError, match="give \\(channels"):
        measured_pattern(profiles, axis, places, (0, 5, 0), np.ones((2, 3)), 0.1)
    with pytest.raises(DataError, match="at an antenna"):
        measured_pattern(profiles, axis, places, (0, 0, 0), np.ones((1, 3)), 0.1)
    with pytest.raises(DataError, match="cannot be averaged"):
        measured_pattern(profiles, axis, places, (0, 5, 0), np.ones((1, 3)), 0.1, together=5)
    # A target that answers nowhere, or lies beyond the profile, tells nothing.
    for place, response in (((0, 5, 0), np.zeros((1, 3))), ((0, 50, 0), np.ones((1, 3)))):
        found = measured_pattern(profiles, axis, places, place, response, 0.1, together=1)
        assert np.isnan(found.level_db).all()


def near_products(path: Path, reflector: Reflector) -> Path:
    """Products of a target seen from its true distance, by physical optics at every position."""
    profiles = range_profiles(Scene("none"), IDEAL, IDEAL)
    resolution = SPEED_OF_LIGHT_M_S / (2 * profiles.bandwidth_hz)
    s = near_field_scattering(reflector, profiles.antenna_m, WAVELENGTH_M)
    for p, place in enumerate(profiles.antenna_m):
        distance = float(np.linalg.norm(np.asarray(reflector.position_m) - place))
        cells = (profiles.range_m - distance) / resolution
        envelope = np.sinc(cells) + 0.5 * (np.sinc(cells - 1) + np.sinc(cells + 1))
        echo = AMPLITUDE * envelope * (profiles.range_m / distance) ** 2
        for c, name in enumerate(profiles.channels):
            profiles.values[c, p] = s[p, "HV".index(name[1]), "HV".index(name[0])] * echo
            profiles.values[c, p] *= np.exp(-4j * np.pi * distance / WAVELENGTH_M)
    write_radar(path, profiles, GRID)
    return path


def test_near_field_of_the_target_is_told_and_may_be_expected(tmp_path: Path) -> None:
    # A trihedral of 0.9 m at 4.5 m, nearer than its far field: its closed form is some dB too much, and a calibration
    # that trusts it is off by as much. Expecting the near field gives the constant of the rig back.
    reflector = Reflector("corner", "trihedral", (0.0, 4.5, GROUND_Z_M), 0.9, deg(45), deg(33))
    path = near_products(tmp_path / "near.h5", reflector)
    spec = TargetSpec("trihedral", 0.0, 4.5, 0.9, deg(45), deg(33))
    truth = -20 * np.log10(AMPLITUDE)
    closed = calibrate(path, spec, min_snr_db=3.0)
    told = analyse(path).near_field
    assert told is not None
    assert told.distance_m < told.far_field_m
    assert told.correction_db["HH"] < -1.5
    assert closed.constant_db - truth == pytest.approx(-told.correction_db["HH"], abs=0.5)
    right = calibrate(path, replace(spec, near_field=True), min_snr_db=3.0)
    # The brightest pixel is not quite the reference point's: the image of a resolved target is not a point's.
    assert right.constant_db == pytest.approx(truth, abs=0.5)
    assert Products(path).settings("calibration")["target"]["near_field"]


def test_command_line_pictures_and_report(corner: Path, repeats: list[Path], tmp_path: Path) -> None:
    sky = write(tmp_path / "sky.h5", noise=NOISE)
    arguments = ["analyse", str(corner), str(repeats[1]), "--sky", str(sky), "-o", str(tmp_path / "pictures")]
    done = CliRunner().invoke(build(), [*arguments, "--json"])
    assert done.exit_code == 0, done.stderr
    printed = json.loads(done.stdout)
    assert printed["repeats"] == 2
    assert printed["peaks"].keys() == {"HH", "HV", "VH", "VV"}
    assert printed["matrix_power"][0][0] == 1
    assert len(printed["matrix_complex"][1][1]) == 2
    assert [Path(path).name for path in printed["figures"]] == [
        "analysis.png",
        "matrices.png",
        "pattern.png",
        "sky.png",
    ]
    assert all(Path(path).stat().st_size > 10_000 for path in printed["figures"])
    readable = CliRunner().invoke(build(), arguments[:2])
    assert readable.exit_code == 0
    assert "received power relative to HH" in readable.stdout
    shown = [picture.name for picture in stage_pictures(Products(corner), "analysis")]
    assert shown == ["analysis", "matrices", "pattern"]
    store = Products(corner)
    # What `polfuse focus` tells of itself.
    told = {**store.settings("focus"), "method": "bp", "interpolator": "sinc8", "predicted_error_db": -60.0}
    store.write("focus", store.read("focus"), settings=told, inputs=[], units={})
    assert {"Target in HH", "Near field in HH"} <= {number.name for number in stage_numbers(store)}


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [(["--at", "here"], 2, "--at"), (["--at", "30,8"], 1, "not in the image"), (["--strip-m", "0"], 2, "strip-m")],
)
def test_command_line_mistakes(corner: Path, arguments: list[str], status: int, words: str) -> None:
    done = CliRunner().invoke(build(), ["analyse", str(corner), *arguments, "--json"])
    assert done.exit_code == status
    assert words in done.stderr
    assert not done.stdout


def test_what_does_not_fit_is_refused(corner: Path, tmp_path: Path) -> None:
    plain = write(tmp_path / "plain.h5", TRIHEDRAL)
    with pytest.raises(PolfuseError, match="place is not known"):
        analyse(plain)
    with pytest.raises(PolfuseError, match="not calibrated"):
        analyse(corner, repeats=[plain])
    other = Products(write(tmp_path / "other.h5", TRIHEDRAL))
    focus = other.read("focus")
    cut = {**focus, "image": focus["image"][:, :, 1:], "x_m": focus["x_m"][1:]}
    other.write("focus", cut, settings=other.settings("focus"), inputs=[], units={})
    with pytest.raises(PolfuseError, match="another grid"):
        analyse(corner, repeats=[other.path])
    with pytest.raises(PolfuseError, match="polfuse focus"):
        analyse(tmp_path / "none.h5")
    with pytest.raises(DataError, match="zero or undefined"):
        analyse(write(tmp_path / "empty.h5"), (0.0, 8.0))
    sky = Products(write(tmp_path / "sky.h5", noise=NOISE))
    stage, settings = sky.read("ranging"), {**sky.settings("ranging"), "channels": ["HH"]}
    sky.write("ranging", {**stage, "profiles": stage["profiles"][:1]}, settings=settings, inputs=[], units={})
    with pytest.raises(PolfuseError, match="lacks channel"):
        analyse(corner, sky=sky.path)
