"""Calibration of focused images whose truth is the scene: constants, imbalance, crosstalk, noise, check target."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import (
    AMPLITUDE,
    CHANNELS,
    DEPRESSION_RAD,
    DIHEDRAL,
    GRID,
    GROUND_Z_M,
    NOISE,
    POINT,
    RECEIVE,
    TRANSMIT,
    TRIHEDRAL,
    WAVELENGTH_M,
    antennas,
    deg,
    range_profiles,
    write_radar,
)
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.calibrate import TargetSpec, calibrate
from polfuse_lab.products.calibration_inputs import read_focused
from polfuse_lab.products.store import Products
from processing.errors import DataError
from processing.sar.grid import ImageGrid
from processing.scene.model import Reflector, Scene
from processing.scene.radar_response import apparent_scattering

TARGET = TargetSpec("trihedral", 0.3, 8.0, 0.61, deg(42), deg(33))
CHECK = TargetSpec("dihedral", -2.0, 12.0, 0.61, fold_rad=np.pi / 2)
SIDE_LOBES = 10 ** (-32 / 20)
"""Amplitude of other targets' side lobes over the trihedral's or dihedral's peak in this scene: below -32 dB (product
of a hann range lobe and a rectangular aperture's far side lobes, two metres or more away)."""


@pytest.fixture
def products(focused_path: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(focused_path, tmp_path / "p.h5"))


def db(ratio: float) -> float:
    return 20 * np.log10(ratio)


def test_constants_of_the_rig_are_recovered(products: Path, sky_path: Path) -> None:
    found = calibrate(products, TARGET, sky=sky_path, check=CHECK)
    # What the front end does to a trihedral: M = R T, HH first.
    m = RECEIVE @ TRANSMIT
    tolerance = db(1 + SIDE_LOBES)
    assert found.constant_db == pytest.approx(-db(AMPLITUDE * abs(m[0, 0])), abs=tolerance)
    assert found.imbalance_db == pytest.approx(db(abs(m[1, 1] / m[0, 0])), abs=2 * tolerance)
    assert found.imbalance_deg == pytest.approx(np.degrees(np.angle(m[1, 1] / m[0, 0])), abs=np.degrees(2 * SIDE_LOBES))
    leak = {"HV": abs(m[1, 0] / m[0, 0]), "VH": abs(m[0, 1] / m[1, 1])}
    for name, amplitude in leak.items():
        # Side lobes of co-polarized targets leak by the same crosstalk; the bush's own cross polarization is far off.
        assert found.crosstalk_db[name] == pytest.approx(db(amplitude), abs=db(1 + 4 * SIDE_LOBES))
    assert found.worst_crosstalk_db == max(found.crosstalk_db.values())
    # Crosstalk perturbs the cross ratio by its amplitude over the margin of 10 dB at most.
    true = (RECEIVE[1, 1] / RECEIVE[0, 0]) / (TRANSMIT[1, 1] / TRANSMIT[0, 0])
    assert found.cross_imbalance == pytest.approx(true, rel=0.1)
    assert (found.target.x_m, found.target.y_m) == pytest.approx((0.3, 8.0), abs=0.05)
    assert found.slope == 1


def test_check_target_is_measured_within_its_side_lobes(products: Path) -> None:
    found = calibrate(products, TARGET, check=CHECK).check
    assert found is not None
    assert found.channel == "HH"
    assert found.error_db == pytest.approx(0, abs=2 * db(1 + 2 * SIDE_LOBES))
    assert found.rcs_dbsm - found.expected_dbsm == pytest.approx(found.error_db)
    assert found.thesis_accuracy_percent == pytest.approx(100 * found.rcs_dbsm / found.expected_dbsm)
    # Even bounce: VV is the negative of HH once the imbalance is gone.
    assert found.values["VV"] / found.values["HH"] == pytest.approx(-1, abs=4 * SIDE_LOBES)


def test_calibrated_scattering_and_pauli_of_the_dihedral_and_trihedral(products: Path) -> None:
    calibrate(products, TARGET)
    stage, polarimetry = Products(products).read("calibration"), Products(products).read("polarimetry")
    assert stage["scattering"].shape == (4, *GRID.shape)
    for reflector, component in ((TRIHEDRAL, 0), (DIHEDRAL, 1)):
        row = int(np.argmin(np.abs(GRID.y_m - reflector.position_m[1])))
        column = int(np.argmin(np.abs(GRID.x_m - reflector.position_m[0])))
        k = np.abs(polarimetry["pauli"][:, row, column])
        assert np.argmax(k) == component
        assert np.delete(k, component).max() < 5 * SIDE_LOBES * k[component]
        expected = np.sum(np.abs(stage["scattering"][[0, 3], row, column]) ** 2)
        assert polarimetry["span"][row, column] == pytest.approx(expected, rel=0.02)


def test_noise_equivalent_rcs_from_the_sky(products: Path, sky_path: Path) -> None:
    found = calibrate(products, TARGET, sky=sky_path)
    slant = np.hypot(8.0, GROUND_Z_M)
    expected = db(NOISE * slant**2 / np.sqrt(61) / AMPLITUDE)
    # Median of 120 independent bins of one position: 1 / (ln 2 sqrt 120) = 13 %, 0.55 dB; three of them.
    assert found.noise_equivalent_dbsm == pytest.approx(expected, abs=1.65)
    assert "sky" in found.noise_source
    without = calibrate(products, TARGET)
    # The image's own background is an upper bound, for side lobes and clutter are in it.
    assert without.noise_equivalent_dbsm > found.noise_equivalent_dbsm
    assert "upper bound" in without.noise_source


def test_sd_of_the_constant_counts_noise_and_angles(products: Path) -> None:
    plain = calibrate(products, TARGET)
    angles = calibrate(products, dataclasses.replace(TARGET, angle_sd_rad=deg(5)))
    assert 0 < plain.constant_sd_db < 0.2
    assert angles.constant_sd_db > 0.5
    assert angles.constant_db == plain.constant_db


def test_layover_of_an_elevated_target(tmp_path: Path) -> None:
    # The same isotropic point 0.4 m above the ground shows nearer to the rail, by its range.
    spec = TargetSpec("plate", -3.0, 7.0, 0.5, height_m=0.4)
    x, y = spec.image_place(GROUND_Z_M)
    assert np.hypot(y, GROUND_Z_M) == pytest.approx(np.hypot(7.0, GROUND_Z_M + 0.4))
    assert x == -3.0
    reflector = dataclasses.replace(TRIHEDRAL, position_m=(0.3, 8.0, GROUND_Z_M + 0.5))
    scene = Scene("one", reflectors=(reflector,))
    path = tmp_path / "p.h5"
    write_radar(path, range_profiles(scene, np.eye(2), np.eye(2)), GRID)
    found = calibrate(path, dataclasses.replace(TARGET, height_m=0.5))
    assert found.target.y_m == pytest.approx(
        dataclasses.replace(TARGET, height_m=0.5).image_place(GROUND_Z_M)[1], abs=0.03
    )
    # An isolated target: what is left is the parabola through the peak and the envelope's curvature over the aperture.
    assert found.constant_db == pytest.approx(-db(AMPLITUDE), abs=0.03)
    assert found.cross_imbalance is None


def test_apparent_scattering_is_what_a_pattern_compensated_image_shows(tmp_path: Path) -> None:
    # A plate's flash is narrow, so what the image shows of it depends on how the positions are weighted: with a
    # pattern of 40 degrees the far ends of the aperture count less, by g^2.
    plate = Reflector("plate", "plate", (1.0, 8.0, GROUND_Z_M), 0.61, deg(4))
    beamwidth = deg(40)
    profiles = range_profiles(Scene("one", reflectors=(plate,)), np.eye(2), np.eye(2), beamwidth_rad=beamwidth)
    around = ImageGrid(1.0 + 0.1 * np.arange(-3, 4), 8.0 + 0.1 * np.arange(-3, 4), GROUND_Z_M)
    path = tmp_path / "p.h5"
    write_radar(path, profiles, around, beamwidth_rad=beamwidth, depression_rad=DEPRESSION_RAD)
    focused = read_focused(Products(path))
    weights = focused.pulse_weights(np.asarray(plate.position_m))
    expected = apparent_scattering(plate, antennas(), WAVELENGTH_M, weights)[0, 0]
    # Single-precision image and an eight-point interpolator of profiles with eight samples in a cell: 1e-3.
    assert focused.image[0, 3, 3] == pytest.approx(AMPLITUDE * expected, rel=2e-3)
    equal = apparent_scattering(plate, antennas(), WAVELENGTH_M)[0, 0]
    assert abs(expected / equal - 1) > 0.05
    # Noise averages less well over positions that the pattern weakens.
    averaging = focused.noise_averaging()
    assert averaging.shape == around.y_m.shape
    assert (averaging > 1 / 61).all()


def test_thesis_mode_draws_a_line_through_target_and_noise(products: Path, sky_path: Path) -> None:
    found = calibrate(products, TARGET, sky=sky_path, check=CHECK, mode="thesis")
    offset = calibrate(products, TARGET, sky=sky_path, check=CHECK)
    assert found.constant_db == pytest.approx(offset.constant_db)
    # Target and noise are about 23.8 + 61.6 dB apart (the noise is put at 0 dBsm).
    assert found.slope == pytest.approx(
        found.expected_dbsm / (offset.expected_dbsm - offset.noise_equivalent_dbsm), rel=1e-6
    )
    assert found.check is not None
    assert abs(found.check.error_db) < abs(found.check.expected_dbsm)


@pytest.mark.parametrize(
    ("target", "error", "reason"),
    [
        (dataclasses.replace(TARGET, x_m=9.0), DataError, "outside the image"),
        (dataclasses.replace(TARGET, x_m=4.5, y_m=18.5), DataError, "peak"),
        (dataclasses.replace(TARGET, azimuth_rad=deg(130)), PolfuseError, "returns nothing"),
        (CHECK, PolfuseError, "no target to calibrate on"),
    ],
)
def test_bad_targets_are_refused(products: Path, target: TargetSpec, error: type[Exception], reason: str) -> None:
    with pytest.raises(error, match=reason):
        calibrate(products, target, search_radius_m=0.4, min_snr_db=25)
    assert "calibration" not in Products(products).stages()


@pytest.mark.parametrize(
    "change", [{"kind": "cube"}, {"edge_m": 0.0}, {"y_m": float("nan")}, {"y_m": -1.0}, {"angle_sd_rad": -0.1}]
)
def test_bad_descriptions_are_refused(change: dict[str, object]) -> None:
    with pytest.raises(DataError):
        dataclasses.replace(TARGET, **change)


def test_missing_stages_channels_and_compensation(tmp_path: Path, products: Path) -> None:
    with pytest.raises(PolfuseError, match="polfuse focus"):
        calibrate(tmp_path / "none.h5", TARGET)
    store = Products(products)
    focus, settings = store.read("focus"), store.settings("focus")
    co = {**settings, "channels": ["HH", "VV"]}
    store.write("focus", {**focus, "image": focus["image"][[0, 3]]}, settings=co, inputs=[], units={})
    found = calibrate(products, TARGET)
    assert np.isnan(found.worst_crosstalk_db)
    assert "polarimetry" not in store.stages()
    store.write(
        "focus", {**focus, "image": focus["image"][3:]}, settings={**settings, "channels": ["VV"]}, inputs=[], units={}
    )
    with pytest.raises(PolfuseError, match="no channel HH"):
        calibrate(products, TARGET)
    store.write("focus", focus, settings=settings, inputs=[], units={})
    ranging = store.read("ranging")
    store.write("ranging", ranging, settings={"channels": CHANNELS, "range_compensated": False}, inputs=[], units={})
    with pytest.raises(PolfuseError, match="range compensation"):
        calibrate(products, TARGET)


def test_sky_that_lacks_a_channel_is_refused(products: Path, sky_path: Path, tmp_path: Path) -> None:
    sky = Products(shutil.copy(sky_path, tmp_path / "sky.h5"))
    stage = sky.read("ranging")
    settings = {"channels": ["HH"], "range_compensated": True}
    sky.write("ranging", {**stage, "profiles": stage["profiles"][:1]}, settings=settings, inputs=[], units={})
    with pytest.raises(PolfuseError, match="lacks channel HV, VH, VV"):
        calibrate(products, TARGET, sky=sky.path)


def test_command_line(products: Path, sky_path: Path) -> None:
    app = build()
    arguments = ["calibrate", str(products), "--target", "trihedral", "--at", "0.3,8", "--azimuth-deg", "42"]
    arguments += ["--elevation-deg", "33", "--check", "dihedral", "--check-at", "-2,12", "--check-fold-deg", "90"]
    done = CliRunner().invoke(app, [*arguments, "--sky", str(sky_path), "--json"])
    assert done.exit_code == 0, done.stderr
    printed = json.loads(done.stdout)
    expected = calibrate(products, TARGET, sky=sky_path, check=CHECK)
    assert printed["constant_db"] == pytest.approx(expected.constant_db)
    assert printed["constant_sd_db"] == pytest.approx(expected.constant_sd_db)
    assert printed["crosstalk_db"] == pytest.approx(expected.worst_crosstalk_db)
    assert printed["imbalance_db"] == pytest.approx(expected.imbalance_db)
    assert printed["imbalance_deg"] == pytest.approx(expected.imbalance_deg)
    assert {"rcs_dbsm", "expected_dbsm", "error_db", "thesis_accuracy_percent"} <= printed["check"].keys()
    readable = CliRunner().invoke(app, arguments)
    assert readable.exit_code == 0
    assert "check:" in readable.stdout


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["--target", "trihedral", "--at", "here"], 2, "--at"),
        (["--target", "cube", "--at", "0,8"], 2, "cube"),
        (["--target", "trihedral", "--at", "0.3,8", "--check", "dihedral"], 2, "--check-at"),
        (["--target", "trihedral", "--at", "0.3,8", "--check-at", "1,2"], 2, "--check"),
        (["--target", "trihedral", "--at", "40,8"], 1, "outside the image"),
    ],
)
def test_command_line_mistakes(products: Path, arguments: list[str], status: int, words: str) -> None:
    done = CliRunner().invoke(build(), ["calibrate", str(products), *arguments, "--json"])
    assert done.exit_code == status
    assert words in done.stderr
    assert not done.stdout
    assert "Traceback" not in done.stderr


def test_point_of_known_rcs_in_the_same_scene(products: Path) -> None:
    # One square metre, isotropic: 0 dBsm; 7 dB below the trihedral's side-lobe limited accuracy of -32 + 24 dB.
    calibrate(products, TARGET)
    stage = Products(products).read("calibration")
    row = int(np.argmin(np.abs(GRID.y_m - POINT.position_m[1])))
    column = int(np.argmin(np.abs(GRID.x_m - POINT.position_m[0])))
    # Side lobes of the trihedral (23.8 dBsm) here: 3.3 m aside, 1.5 m nearer.
    assert db(abs(stage["scattering"][0, row, column])) == pytest.approx(0, abs=db(1 + 10 ** (23.8 / 20) * SIDE_LOBES))
