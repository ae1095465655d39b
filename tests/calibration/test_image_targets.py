"""Three targets in one image, clutter in it, and the walk that asks for targets one by one."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from calibration_rig import complex_noise, distortion
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.calibrate import Region, TargetSpec, calibrate
from polfuse_lab.products.store import Products
from polfuse_lab.report.builder import report
from polfuse_lab.report.calibration import calibration_tables, crosstalk_numbers
from processing.calibration.distortion import CHANNELS, channel_values
from processing.calibration.rcs import square_trihedral_rcs
from processing.errors import DataError
from processing.scene.radar_response import apparent_scattering

TRUTH = distortion(np.random.default_rng(4))
CENTRE_HZ, BANDWIDTH_HZ, GROUND_Z_M = 2.4e9, 80e6, -1.069
WAVELENGTH_M = 299_792_458.0 / CENTRE_HZ
AMPLITUDE = 0.02
X, Y = np.arange(-6, 6.001, 0.1), np.arange(4.0, 16.001, 0.2)
ANTENNA = np.column_stack([np.linspace(-0.9, 0.9, 37), np.zeros((37, 2))])
CORNER = TargetSpec("trihedral", 0.0, 6.0, 0.61, np.radians(42), np.radians(33), name="trihedral")
UPRIGHT = TargetSpec("dihedral", -3.0, 9.0, 0.61, fold_rad=np.pi / 2, angle_sd_rad=np.radians(0.3), name="dihedral")
TURNED = TargetSpec("dihedral", 3.0, 9.0, 0.61, fold_rad=np.pi / 4, angle_sd_rad=np.radians(0.3), name="dihedral_45")
MEADOW = Region((-5.0, 5.0), (11.5, 16.0))


def write_image(path: Path, targets, *, meadow=0.0, seed=0) -> Path:
    """A focused image whose targets have Gaussian main lobes (for which finding a peak is exact), noise and clutter."""
    random = np.random.default_rng(seed)
    s = np.zeros((len(Y), len(X), 2, 2), dtype=complex)
    for spec in targets:
        x, y = spec.image_place(GROUND_Z_M)
        lobe = np.exp(-((X[None, :] - x) ** 2) / 0.08 - (Y[:, None] - y) ** 2 / 0.3) * np.exp(40j * Y[:, None])
        gain = (X[None, :] ** 2 + Y[:, None] ** 2 + GROUND_Z_M**2) / (x**2 + y**2 + GROUND_Z_M**2)
        s += (lobe * gain)[..., None, None] * apparent_scattering(spec.reflector(GROUND_Z_M), ANTENNA, WAVELENGTH_M)
    if meadow:
        rows = Y > 11.0
        shape = (int(rows.sum()), len(X))
        hh = complex_noise(random, shape, meadow)
        vv, x = 0.5 * hh + 0.8 * complex_noise(random, shape, meadow), 0.4 * complex_noise(random, shape, meadow)
        s[rows] += np.moveaxis(np.array([[hh, x], [x, vv]]), (0, 1), (2, 3))
    image = AMPLITUDE * np.moveaxis(channel_values(TRUTH.apply(s)), -1, 0)
    image = image + complex_noise(random, image.shape, 1e-8)
    products = Products(path)
    shared = {"channels": CHANNELS, "range_compensated": True, "window": "hann", "oversampling": 8}
    blank = {"profiles": np.zeros((4, 37, 2), np.complex64), "range_m": np.arange(2.0), "antenna_m": ANTENNA}
    products.write("ranging", blank, settings=shared, inputs=[], units={})
    made = {"method": "bp", "interpolator": "sinc8", "predicted_error_db": -90.0}
    settings = {"channels": CHANNELS, "z_m": GROUND_Z_M, "centre_hz": CENTRE_HZ, "bandwidth_hz": BANDWIDTH_HZ} | made
    arrays = {"image": image.astype(np.complex64), "x_m": X, "y_m": Y}
    products.write("focus", arrays, settings=settings, inputs=[], units={})
    return path


def test_three_targets_in_one_image(tmp_path: Path) -> None:
    path = write_image(tmp_path / "p.h5", [CORNER, UPRIGHT, TURNED])
    found = calibrate(path, CORNER, targets=[UPRIGHT, TURNED], draws=200)
    left = TRUTH.residual(found.distortion)
    # Noise 1e-8 under 0.02 x 18 m squared: 71 dB.
    assert found.method == "targets"
    assert left.worst_crosstalk_db < -45
    assert found.constant_db == pytest.approx(-20 * np.log10(AMPLITUDE), abs=0.02)
    assert set(found.target_errors_db) == {"trihedral", "dihedral", "dihedral_45"}
    assert max(map(abs, found.target_errors_db.values())) < 0.1
    isolated = calibrate(path, CORNER, draws=200)
    assert isolated.method == "isolated"
    assert not isolated.distortion.has_crosstalk
    # What is left in is said: twice the crosstalk squared.
    assert [line.cause for line in isolated.budget.lines][-1] == "crosstalk left in"
    assert isolated.budget.sd("co_imbalance_db") > found.budget.sd("co_imbalance_db")


def test_sets_at_two_ranges_give_a_distortion_for_each(tmp_path: Path) -> None:
    far = [
        dataclasses.replace(spec, x_m=x, y_m=13.0, name=f"far {spec.name}")
        for spec, x in ((CORNER, 0.0), (UPRIGHT, -3.0), (TURNED, 3.0))
    ]
    near = [dataclasses.replace(spec, y_m=6.0) for spec in (CORNER, UPRIGHT, TURNED)]
    path = write_image(tmp_path / "p.h5", [*near, *far])
    found = calibrate(path, near[0], targets=[*near[1:], *far], draws=50)
    assert found.by_range is not None
    np.testing.assert_allclose(found.by_range.range_m, np.hypot([6.0, 13.0], GROUND_Z_M), atol=0.01)
    for one in found.by_range.distortions:
        assert TRUTH.residual(one).worst_crosstalk_db < -40
    assert found.distortion is found.by_range.distortions[0]
    assert len(Products(path).settings("calibration")["by_range"]) == 2
    scattering = Products(path).read("calibration")["scattering"]
    x, y = far[1].image_place(GROUND_Z_M)
    values = scattering[:, np.argmin(abs(Y - y)), np.argmin(abs(X - x))]
    np.testing.assert_allclose(values / values[0], [1, 0, 0, -1], atol=0.02)


def test_the_report_shows_targets_and_budget(tmp_path: Path) -> None:
    path = write_image(tmp_path / "p.h5", [CORNER, UPRIGHT, TURNED])
    calibrate(path, CORNER, targets=[UPRIGHT, TURNED], draws=100)
    targets, budget = calibration_tables(Products(path))
    assert [row[0] for row in targets.rows] == ["trihedral", "dihedral", "dihedral_45"]
    assert {row[2] for row in targets.rows} == {"used"}
    assert "orientation of the folds" in [row[0] for row in budget.rows]
    assert budget.rows[-1][0] == "Expanded (95 %)"
    assert len({len(row) for row in (*budget.rows, budget.heads)}) == 1
    page = report(path, tmp_path / "r.html", pictures=[]).read_text(encoding="utf-8")
    assert "Uncertainty of the calibration" in page
    assert "Crosstalk taken off, receive h" in page
    # The sd of a crosstalk of -20 dB whose error is x of the gain is 8.7 x / 0.1 dB.
    told = Products(path).settings("calibration")["crosstalk_paths"]["receive_h"]
    number = crosstalk_numbers(Products(path).settings("calibration"))[0]
    assert number.value == pytest.approx(-20, abs=0.5)
    assert number.sd == pytest.approx(86.9 * told["sd"], rel=0.05)


def test_three_channels_are_freed_of_crosstalk_by_a_full_calibration(tmp_path: Path) -> None:
    # Without VH the targets do not tell the crosstalk; the trihedral alone is used, and nothing is invented.
    path = write_image(tmp_path / "p.h5", [CORNER, UPRIGHT, TURNED])
    store = Products(path)
    settings = {**store.settings("focus"), "channels": ["HH", "HV", "VV"]}
    focus = store.read("focus")
    store.write("focus", {**focus, "image": focus["image"][[0, 1, 3]]}, settings=settings, inputs=[], units={})
    with pytest.raises(PolfuseError, match="too few targets are left"):
        calibrate(path, CORNER, targets=[UPRIGHT, TURNED], draws=100)
    assert calibrate(path, CORNER, draws=100).method == "isolated"


@pytest.mark.parametrize("method", ["quegan", "ainsworth"])
def test_a_meadow_tells_the_crosstalk(tmp_path: Path, method) -> None:
    path = write_image(tmp_path / "p.h5", [CORNER], meadow=1.0)
    found = calibrate(path, CORNER, clutter=Region(MEADOW.x_m, MEADOW.y_m, method), draws=100)
    assert found.method == method
    assert found.clutter is not None
    assert found.clutter.pixels > 2000
    if method == "quegan":
        # |x| / |hh| / sqrt(2300 pixels) = 0.8 %, 1.3 % for HH and VV are half alike; the worst of four, three of them.
        assert TRUTH.residual(found.distortion).worst_crosstalk_db < -28
        for name, told in found.paths().items():
            assert abs(found.distortion.crosstalk[name] - TRUTH.crosstalk[name]) < 4 * told["sd"] < 0.1
    assert found.constant_db == pytest.approx(-20 * np.log10(AMPLITUDE), abs=0.15)
    with pytest.raises(DataError, match="too few"):
        calibrate(path, CORNER, clutter=Region((20, 21), (20, 21)), draws=100)


def test_refused_targets_are_named(tmp_path: Path) -> None:
    path = write_image(tmp_path / "p.h5", [CORNER, UPRIGHT])
    with pytest.raises(PolfuseError, match=r"too few targets are left \(dihedral_45: .* dB above the background"):
        calibrate(path, CORNER, targets=[UPRIGHT, TURNED], draws=100)


ARGUMENTS = ["--target", "trihedral", "--at", "0,6", "--azimuth-deg", "42", "--elevation-deg", "33"]


def test_further_targets_on_the_command_line(tmp_path: Path) -> None:
    path = write_image(tmp_path / "p.h5", [CORNER, UPRIGHT, TURNED])
    also = ["--also", "dihedral@-3,9", "--also", "dihedral_45@3,9@0.61", "--angle-sd-deg", "0.3"]
    done = CliRunner().invoke(build(), ["calibrate", str(path), *ARGUMENTS, *also, "--json"])
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["method"] == "targets"
    assert "dihedral_45: found at (3.00, 9.00) m" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "--target and --at, or --series, or --walk"),
        (["--target", "trihedral"], "give a target and its place together"),
        ([*ARGUMENTS, "--also", "cube@1,2"], "'cube' is none of"),
        ([*ARGUMENTS, "--also", "dihedral@1"], "is not X,Y"),
        ([*ARGUMENTS, "--also", "dihedral@1,2@wide"], "is not a number in metres"),
        ([*ARGUMENTS, "--clutter", "1,2,3"], "is not X0,X1,Y0,Y1"),
        ([*ARGUMENTS, "--clutter", "2,1,3,4"], "is empty"),
    ],
)
def test_command_line_mistakes(tmp_path: Path, arguments: list[str], words: str) -> None:
    path = write_image(tmp_path / "p.h5", [CORNER])
    done = CliRunner().invoke(build(), ["calibrate", str(path), *arguments], env={"COLUMNS": "400"})
    assert done.exit_code == 2
    assert words in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def printed(stdout: str) -> dict[str, object]:
    """The JSON object; the test runner's terminal echoes answers before it."""
    found: dict[str, object] = json.loads(stdout[stdout.index("{") :])
    return found


def test_the_walk_asks_for_each_target_and_says_what_is_wrong(tmp_path: Path) -> None:
    path = write_image(tmp_path / "p.h5", [CORNER, UPRIGHT, TURNED])
    answers = [
        # Kind, a place that is none, a wrong place, edge, height, both angles, sd: refused; again, now right.
        "trihedral", "here", "3,5", "0.61", "0", "42", "33", "0.3", "yes",
        "trihedral", "0,6", "0.61", "0", "42", "33", "0.3",
        "yes", "-3,9", "0.61", "0", "0.3",
        "yes", "3,9", "0.61", "0", "0.3",
    ]  # fmt: skip
    done = CliRunner().invoke(build(), ["calibrate", str(path), "--walk", "--json"], input="\n".join(answers) + "\n")
    assert done.exit_code == 0, done.stderr
    assert printed(done.stdout)["method"] == "targets"
    assert "'here' is not X,Y" in done.stderr
    assert "trihedral: REFUSED: " in done.stderr
    assert "Step 3 of 3" in done.stderr


def test_the_walk_may_end_after_the_trihedral_or_be_left(tmp_path: Path) -> None:
    path = write_image(tmp_path / "p.h5", [CORNER])
    first = ["plate", "0,6", "0.61", "0", "0", "0", "2"]
    done = CliRunner().invoke(
        build(), ["calibrate", str(path), "--walk", "--json"], input="\n".join([*first, "no", "no"]) + "\n"
    )
    assert done.exit_code == 0, done.stderr
    assert printed(done.stdout)["method"] == "isolated"
    left = CliRunner().invoke(build(), ["calibrate", str(path), "--walk"], input="trihedral\n0,6\n")
    assert left.exit_code == 1
    wrong = CliRunner().invoke(build(), ["calibrate", str(path), "--walk"], input="plate\n3,12\n0.61\n0\n0\n0\n2\nno\n")
    assert wrong.exit_code == 1
    assert "REFUSED" in wrong.stderr


def test_a_position_error_costs_what_the_angle_costs(tmp_path: Path) -> None:
    path = write_image(tmp_path / "p.h5", [CORNER])
    spec = TargetSpec("trihedral", 0.0, 6.0, 0.61, np.radians(42), np.radians(33), position_sd_m=0.1, edge_sd_m=0.003)
    lines = {line.cause: line.contributions["constant_db"] for line in calibrate(path, spec, draws=100).budget.lines}
    # Edge: fourth power. Position: 0.1 m over 6.09 m is 0.94 degrees of azimuth; of elevation 0.1 y z / R^2 less.
    assert lines["edge of the reference"] == pytest.approx(40 / np.log(10) * 0.003 / 0.61, rel=0.02)
    step = 1e-3
    rcs = [
        10 * np.log10(float(square_trihedral_rcs(0.61, WAVELENGTH_M, np.radians(42) + d, np.radians(33))))
        for d in (-step, step)
    ]
    by_azimuth = abs(rcs[1] - rcs[0]) / (2 * step) * 0.1 / np.hypot(6.0, GROUND_Z_M)
    # The mean over the aperture blunts the slope a little; elevation adds a few percent.
    assert lines["position of the reference"] == pytest.approx(by_azimuth, rel=0.35)
