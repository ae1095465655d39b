"""``polfuse decompose`` with filters, classes and signatures, and ``polfuse detect``, on images with known truth."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.decompose import decompose
from polfuse_lab.products.detect import POWERS, TARGETS, detect, detection_figure
from polfuse_lab.products.store import Products
from processing.errors import DataError
from processing.polarimetry import targets
from processing.polarimetry.averaging import window_average
from processing.polarimetry.detection.cfar import Ring
from processing.polarimetry.matrices import planes_of_matrix, planes_of_vector, total_power
from processing.polarimetry.pauli import pauli_of_matrix
from processing.polarimetry.signatures import signature
from processing.polarimetry.speckle.nonlocal_means import nonlocal_means
from processing.polarimetry.speckle.refined_lee import refined_lee
from processing.polarimetry.speckle.simulation import speckled

ROWS, COLUMNS = 40, 50
TARGET_AT = (28, 12)


def on_the_ground(path: Path, target: str | None = None) -> Path:
    """Single-look clutter on the ground, one pixel undefined, a target of 20 m^2 where one is asked for."""
    rng = np.random.default_rng(8)
    amplitude = np.array([0.6, 0.2, 0.2, 0.5])[:, None, None]
    s = amplitude * (rng.normal(size=(4, ROWS, COLUMNS)) + 1j * rng.normal(size=(4, ROWS, COLUMNS)))
    s[2] = s[1]
    if target is not None:
        m = np.sqrt(20) * TARGETS[target]
        s[:, *TARGET_AT] = m[0, 0], m[1, 0], m[0, 1], m[1, 1]
    s[:, 4, 5] = np.nan
    Products(path).write(
        "calibration",
        {"scattering": s.astype(np.complex64), "x_m": np.linspace(-2, 2.9, COLUMNS), "y_m": np.linspace(5, 8.9, ROWS)},
        settings={"channels": ["HH", "HV", "VH", "VV"]},
        inputs=[],
        units={},
    )
    return path


def imported(path: Path) -> np.ndarray:
    """Two kinds of ground as T3 with 8 looks; returns the planes."""
    truth = np.empty((9, ROWS, COLUMNS))
    truth[:, :, :25] = planes_of_matrix(np.diag([1.0, 0.05, 0.02]))[:, None, None]
    truth[:, :, 25:] = planes_of_matrix(np.diag([0.5, 0.4, 0.4]))[:, None, None]
    planes = speckled(truth, 8, np.random.default_rng(2)).astype(np.float32)
    Products(path).write("matrices", {"planes": planes}, settings={"matrix": "T3"}, inputs=[], units={})
    return planes


def test_filters_reach_the_method(tmp_path: Path) -> None:
    path = tmp_path / "p.h5"
    planes = imported(path)
    expected = {
        "boxcar": window_average(planes, 5),
        "refined-lee": refined_lee(planes, 7, looks=10.0),
        "nlm": nonlocal_means(planes, looks=10, search=15),
    }
    for name, filtered in expected.items():
        made = decompose(path, "span", speckle_filter=name, filter_looks=10.0)
        found = Products(path).read(made.stage)["span"]
        np.testing.assert_allclose(found, total_power(filtered), rtol=1e-6)
        settings = Products(path).settings(made.stage)
        assert (settings["filter"], settings["window"]) == (name, {"boxcar": 5, "refined-lee": 7, "nlm": 15}[name])
    decompose(path, "span", speckle_filter="refined-lee")
    # 8 looks of matrices whose span has between 8 and 24; the whole image's median kind has 8 * 1.69 / 0.57 = 24.
    assert 6 < Products(path).settings("decomposition_span")["filter_looks"] < 30


def test_classes_find_the_two_kinds_of_ground(tmp_path: Path) -> None:
    path = tmp_path / "p.h5"
    imported(path)
    made = decompose(path, "zones")
    zone = Products(path).read(made.stage)["class"]
    # p = 0.93, 0.05, 0.02 has entropy 0.27 and alpha near 7 degrees; the other 0.99 and 55.
    assert (zone[5:-5, 5:20] == 9).mean() > 0.99
    assert (zone[5:-5, 30:-5] <= 2).mean() > 0.95
    made = decompose(path, "wishart")
    found, settings = Products(path).read(made.stage)["class"], Products(path).settings(made.stage)
    left, right = np.unique(found[5:-5, 5:20]), np.unique(found[5:-5, 30:-5])
    assert not set(left) & set(right)
    assert settings["classes"][int(left[0])].endswith(" surface")
    assert sum(settings["class_pixels"]) == found.size
    assert "iterations" in made.note


def test_whitening_has_the_power_of_its_surroundings_and_less_speckle(tmp_path: Path) -> None:
    path = on_the_ground(tmp_path / "p.h5")
    made = decompose(path, "whitening")
    arrays = Products(path).read(made.stage)
    assert np.isnan(arrays["whitened"][4, 5])
    decompose(path, "span")
    span, white = Products(path).read("decomposition_span")["span"], arrays["whitened"]
    np.testing.assert_allclose(np.nanmean(white), np.nanmean(span), rtol=0.05)
    # Powers 0.72, 0.16, 0.5 of the lexicographic vector: deviation sqrt(sum of squares) of the span, 1.38 / sqrt 3 of
    # the whitened power; 2000 pixels tell it to 3 %.
    np.testing.assert_allclose(np.nanstd(span), np.sqrt(0.72**2 + 0.16**2 + 0.5**2), rtol=0.08)
    np.testing.assert_allclose(np.nanstd(white), 1.38 / np.sqrt(3), rtol=0.08)


def test_signature_of_a_region(tmp_path: Path) -> None:
    path = tmp_path / "p.h5"
    k = pauli_of_matrix(targets.dihedral())
    planes = np.zeros((9, 6, 8), dtype=np.float32)
    planes[:, 2, 3] = planes_of_vector(k)
    Products(path).write("matrices", {"planes": planes}, settings={"matrix": "T3"}, inputs=[], units={})
    made = decompose(path, "signature", region=(3, 3, 2, 2), folder=tmp_path / "o")
    found = Products(path).read(made.stage)
    expected = signature(np.outer(k, k.conj()))
    # Fig. 2.16 of the thesis: a dihedral returns all of H to H, nothing at 45 degrees.
    np.testing.assert_allclose(found["co"], expected.co, atol=1e-6)
    np.testing.assert_allclose(found["cross"], expected.cross, atol=1e-6)
    assert set(found) == {"co", "cross", "orientation_deg", "ellipticity_deg"}
    assert Products(path).units(made.stage)["orientation_deg"] == "degrees"
    with pytest.raises(PolfuseError, match="no defined pixel in the region"):
        decompose(path, "signature", region=(30, 33, 2, 2))
    # On the ground a region is in metres.
    made = decompose(on_the_ground(tmp_path / "g.h5"), "signature", region=(-1, 1, 6, 7))
    assert "mean of 231 pixels" in made.note  # columns at -1.0, -0.9 … 1.0 and rows at 6.0 … 7.0: 21 by 11


def test_what_cannot_be_filtered_is_said(tmp_path: Path) -> None:
    path = on_the_ground(tmp_path / "p.h5")
    with pytest.raises(PolfuseError, match="no filter 'magic'"):
        decompose(path, "span", speckle_filter="magic")
    with pytest.raises(PolfuseError, match="takes single scattering matrices"):
        decompose(path, "cameron", speckle_filter="nlm")
    with pytest.raises(PolfuseError, match="takes the mean of a region"):
        decompose(path, "signature", window=3)
    with pytest.raises(PolfuseError, match="takes the whole image"):
        decompose(path, "span", region=(0, 1, 0, 1))
    with pytest.raises(PolfuseError, match="no 'noise'"):
        detect(path, power="noise")
    with pytest.raises(DataError, match="false-alarm rate of 2"):
        detect(path, false_alarm=2.0)


@pytest.mark.parametrize("power", POWERS)
def test_a_target_is_detected_where_it_stands_and_nothing_else(tmp_path: Path, power: str) -> None:
    path = on_the_ground(tmp_path / "p.h5", "dihedral_45")
    # 2000 pixels at 1e-5: 0.02 false alarms.
    made = detect(path, power=power, target="dihedral_45", false_alarm=1e-5, ring=Ring(15, 5))
    assert made.count == 1
    only = made.detections[0]
    assert (only.row, only.column, only.pixels) == (*TARGET_AT, 1)
    np.testing.assert_allclose([only.x_m, only.y_m], [-0.8, 7.8], atol=1e-9)
    arrays = Products(path).read("detection")
    assert np.isnan(arrays["ratio"][4, 5])
    assert arrays["detected"].sum() == made.pixels == 1
    np.testing.assert_allclose(10 * np.log10(arrays["ratio"][TARGET_AT]), only.over_threshold_db, atol=1e-5)
    assert detection_figure(Products(path)).axes


def test_the_matched_filter_knows_its_target(tmp_path: Path) -> None:
    path = on_the_ground(tmp_path / "p.h5", "dihedral_45")
    level = {
        name: detect(path, power="matched", target=name, false_alarm=1e-5).detections
        for name in ("dihedral_45", "trihedral")
    }
    assert len(level["dihedral_45"]) == 1
    # A dihedral at 45 degrees has nothing in common with a trihedral (Pauli vectors at right angles).
    assert not level["trihedral"]


def test_commands_answer(tmp_path: Path) -> None:
    path, run = on_the_ground(tmp_path / "p.h5", "trihedral"), CliRunner()
    answer = run.invoke(build(), ["detect", str(path), "--power", "matched", "--false-alarm", "1e-5", "--json"])
    assert answer.exit_code == 0, answer.output
    found = json.loads(answer.stdout)
    assert found["count"] == 1
    assert found["detections"][0]["row"] == TARGET_AT[0]
    assert np.asarray(Image.open(found["files"][0])).std() > 1
    answer = run.invoke(build(), ["detect", str(path), "--window", "8"])
    assert answer.exit_code == 1
    assert "is no ring" in answer.stderr
    for method, words in (
        ("wishart", ["--filter", "refined-lee"]),
        ("zones", ["--filter", "boxcar", "--window", "7"]),
        ("signature", ["--region", "-1,1,6,7"]),
        ("whitening", []),
    ):
        answer = run.invoke(
            build(), ["decompose", str(path), "-m", method, "-o", str(tmp_path / "o"), "--json", *words]
        )
        assert answer.exit_code == 0, answer.output
        files = [Path(name) for name in json.loads(answer.stdout)["files"]]
        assert all(name.stat().st_size for name in files)
        assert np.asarray(Image.open(next(name for name in files if name.suffix == ".png"))).std() > 1
    answer = run.invoke(build(), ["decompose", str(path), "-m", "signature", "--region", "3,1,6,7"])
    assert answer.exit_code == 2
