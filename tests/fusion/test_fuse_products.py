"""Fusion of a calibrated scene with a camera picture, its pictures and its command."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import CAMERA, DIHEDRAL, GRID, GROUND_Z_M, TRIHEDRAL, deg
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products import style
from polfuse_lab.products.calibrate import TargetSpec, calibrate
from polfuse_lab.products.figures_fusion import both_figure, draw_all, pauli_rgb
from polfuse_lab.products.fuse import fuse
from polfuse_lab.products.store import Products
from processing.polarimetry.pauli import lexicographic_vector, matrix_of_pauli, pauli_vector

REGIONS = """
[[region]]
name = "dihedral"
polygon_m = [[-2.6, 11.2], [-1.4, 11.2], [-1.4, 12.8], [-2.6, 12.8]]

[[region]]
name = "trihedral"
polygon_m = [[-0.2, 7.0], [0.8, 7.0], [0.8, 9.0], [-0.2, 9.0]]
"""


@pytest.fixture(scope="module")
def calibrated(focused_path: Path, sky_path: Path, tmp_path_factory) -> Path:
    path = Path(shutil.copy(focused_path, tmp_path_factory.mktemp("fuse") / "p.h5"))
    calibrate(path, TargetSpec("trihedral", 0.3, 8.0, 0.61, deg(42), deg(33)), sky=sky_path)
    return path


@pytest.fixture
def products(calibrated: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(calibrated, tmp_path / "p.h5"))


def at(plane: np.ndarray, x: float, y: float) -> np.ndarray:
    return plane[..., int(np.argmin(np.abs(GRID.y_m - y))), int(np.argmin(np.abs(GRID.x_m - x)))]


def test_cells_too_long_for_a_refined_registration_are_told(products: Path) -> None:
    made = fuse(products, refine=True)
    assert made.shift is None
    assert Products(products).settings("fusion")["registration_shift_px"] is None
    # 80 MHz at a grazing angle: a cell is longer in the picture than the camera's direction is uncertain.
    assert any("radar's cell spans" in note for note in made.notes)


def test_a_tolerance_chooses_how_to_look_between_pixels(products: Path) -> None:
    ran = CliRunner().invoke(build(), ["fuse", str(products), "--tolerance", "perfect"])
    assert ran.exit_code != 0
    assert "preview, field, paper" in ran.output
    made = fuse(products, tolerance_db=-1.0)
    assert made.resampling is not None
    assert "by straight lines: the cheapest within -1 dB" in made.resampling.explain()[0]
    by_lines = Products(products).read("fusion")["s0_on_ground"]
    made = fuse(products, tolerance_db=-250.0)
    assert made.resampling is not None
    settings = Products(products).settings("fusion")
    assert settings["tolerance_kept"] is False
    assert settings["predicted_error_db"] == made.resampling.predicted_error_db
    assert settings["resampling_degree"] == made.resampling.degree
    np.testing.assert_allclose(Products(products).read("fusion")["s0_on_ground"], by_lines, rtol=0.1)


def test_both_pictures_meet_at_the_targets(products: Path) -> None:
    fuse(products)
    stage = Products(products).read("fusion")
    assert stage["features"].shape == (4, *GRID.shape)
    # The picture's DOLP is 0.5 around the dihedral and 0.1 elsewhere, with 0.01 noise: five of them.
    dihedral, trihedral = (at(stage["features"], *r.position_m[:2]) for r in (DIHEDRAL, TRIHEDRAL))
    assert dihedral[3] == pytest.approx(0.5, abs=0.05)
    assert trihedral[3] == pytest.approx(0.1, abs=0.05)
    # Normalized mechanism: even bounce and odd bounce, the rest below crosstalk and side lobes.
    np.testing.assert_allclose(dihedral[:3], [1, 0, 0], atol=0.1)
    np.testing.assert_allclose(trihedral[:3], [0, 0, 1], atol=0.1)
    assert at(stage["classes"], *DIHEDRAL.position_m[:2]) != at(stage["classes"], *TRIHEDRAL.position_m[:2])
    u, v, _ = CAMERA.project(np.array([*DIHEDRAL.position_m[:2], GROUND_Z_M]))
    # The nearest grid point is at most half a pixel of the grid (0.05 m, 0.1 m) away.
    assert at(stage["u_px"], *DIHEDRAL.position_m[:2]) == pytest.approx(float(u), abs=1.5)
    assert at(stage["v_px"], *DIHEDRAL.position_m[:2]) == pytest.approx(float(v), abs=1.5)


def test_undefined_pixels_are_nan_everywhere_and_have_no_class(products: Path) -> None:
    found = fuse(products)
    stage = Products(products).read("fusion")
    undefined = np.isnan(stage["features"]).any(axis=0)
    np.testing.assert_array_equal(stage["classes"] == -1, undefined)
    np.testing.assert_array_equal(np.isnan(stage["rx"]), undefined)
    assert np.isnan(stage["features"][:, undefined]).all()
    assert found.pixels == (~undefined).sum() == sum(item.pixels for item in found.classes.values())
    # Out of the camera's frame there is no DOLP.
    np.testing.assert_array_equal(np.isnan(stage["u_px"]), np.isnan(stage["registration_error_px"]))
    assert np.isnan(stage["dolp_on_ground"][np.isnan(stage["u_px"])]).all()
    # Within the frame, at least the error of the camera's direction: 1 degree about each axis.
    least = np.radians(1) * CAMERA.focal_length_px * np.sqrt(2)
    assert np.nanmin(stage["registration_error_px"]) >= least * (1 - 1e-6)


def test_a_scene_on_a_height_map(products: Path, tmp_path: Path) -> None:
    # A wall of 0.6 m across the scene at 10 m: what lies behind is in the radar's shadow, 1.07 m up, to
    # 10.1 * 1.07 / 0.47 = 23 m; the camera stands as high.
    x, y = np.linspace(-6, 6, 7), np.array([3.0, 9.9, 9.95, 10.05, 10.1, 20.0])
    heights = GROUND_Z_M + np.repeat(np.array([0, 0, 0.6, 0.6, 0, 0])[:, None], 7, axis=1)
    np.savez(tmp_path / "wall.npz", x_m=x, y_m=y, height_m=heights, sd_m=np.full(heights.shape, 0.02))
    fuse(products)
    flat = Products(products).read("fusion")
    found = fuse(products, heights=tmp_path / "wall.npz")
    stage, settings = Products(products).read("fusion"), Products(products).settings("fusion")
    assert any("lie in the radar's shadow" in note for note in found.notes)
    assert np.isnan(at(stage["features"], *DIHEDRAL.position_m[:2])).all()
    assert np.isnan(stage["u_px"][GRID.y_m > 10.2]).all()
    # Before the wall nothing changes but the error, whose height is better known.
    before = GRID.y_m < 9.5
    np.testing.assert_allclose(stage["u_px"][before], flat["u_px"][before], atol=1e-3)
    seen = np.isfinite(flat["u_px"]) & before[:, None]
    assert (stage["registration_error_px"][seen] < flat["registration_error_px"][seen]).all()
    assert settings["heights"] == "wall.npz"
    style.save(both_figure(Products(products)), tmp_path / "f.png")


def test_a_picture_that_was_focused_on_heights(products: Path) -> None:
    store = Products(products)
    focus = store.read("focus")
    raised = np.full(GRID.shape, GROUND_Z_M) + 0.02 * (GRID.y_m[:, None] - 3.0)
    settings = {**store.settings("focus"), "grid": "heights"}
    store.write("focus", {**focus, "height_m": raised}, settings=settings, inputs=[], units={})
    made = fuse(products)
    stage = store.read("fusion")
    u, v, _ = CAMERA.project(np.stack([*np.meshgrid(GRID.x_m, GRID.y_m), raised], axis=-1))
    seen = np.isfinite(stage["u_px"])
    np.testing.assert_allclose(stage["u_px"][seen], u[seen], atol=1e-3)
    np.testing.assert_allclose(stage["v_px"][seen], v[seen], atol=1e-3)
    np.testing.assert_array_equal(seen, CAMERA.inside(u, v))  # a slope that rises away from both hides nothing
    assert any("0 pixels are hidden from the camera" in note for note in made.notes)
    with pytest.raises(PolfuseError, match="heights of its own"):
        fuse(products, heights="any.npz")


def test_same_seed_same_arrays(products: Path) -> None:
    fuse(products, seed=3)
    first = Products(products).read("fusion")
    fuse(products, seed=3)
    second = Products(products).read("fusion")
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], err_msg=name)


def test_regions_are_told_apart_better_with_dolp(products: Path, tmp_path: Path) -> None:
    (tmp_path / "r.toml").write_text(REGIONS)
    found = fuse(products, regions=tmp_path / "r.toml")
    assert list(found.pairs) == ["dihedral - trihedral"]
    pair = found.pairs["dihedral - trihedral"]
    # More features never lower the Bhattacharyya distance of normal classes.
    assert pair.distance["pauli_dolp"] > pair.distance["pauli"]
    assert pair.distance["pauli_dolp"] > pair.distance["even_odd_dolp"]
    assert pair.bounds.lower <= pair.bounds.upper < 1e-3
    assert found.regions["dihedral"].mechanism == "even bounce"
    assert found.regions["trihedral"].mechanism == "odd bounce"
    assert found.regions["dihedral"].mean["DOLP"] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (REGIONS.replace("trihedral", "dihedral"), "twice"),
        (
            REGIONS.replace("[0.8, 7.0]", "[0.8, 99.0]").replace("7.0", "90.0").replace("9.0]", "95.0]"),
            "holds no pixel",
        ),
        (REGIONS.replace("polygon_m", "polygon"), "line 4"),
        ("[[region]]", "name"),
    ],
)
def test_bad_regions_are_refused(products: Path, tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "r.toml").write_text(text)
    with pytest.raises(PolfuseError, match=words):
        fuse(products, regions=tmp_path / "r.toml")


def test_missing_stages_and_pictures_that_do_not_meet(focused_path: Path, products: Path, tmp_path: Path) -> None:
    raw = Path(shutil.copy(focused_path, tmp_path / "raw.h5"))
    with pytest.raises(PolfuseError, match="polfuse calibrate"):
        fuse(raw)
    store = Products(products)
    optics, settings = store.read("optics"), store.settings("optics")
    away = {**settings, "camera": {**settings["camera"], "depression_rad": -1.0}}
    store.write("optics", optics, settings=away, inputs=[], units={})
    with pytest.raises(PolfuseError, match="no pixel is defined in both"):
        fuse(products)


def test_pictures(products: Path, tmp_path: Path) -> None:
    fuse(products)
    paths = draw_all(Products(products), tmp_path / "f.png")
    assert [path.name for path in paths] == [
        "f.png",
        *(f"f_{name}.png" for name in ("pauli", "lexicographic", "colours", "classes", "space", "overlay")),
    ]
    for path in paths:
        assert path.read_bytes().startswith(b"\x89PNG")
    again = draw_all(Products(products), tmp_path / "g.png")
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in paths]


def test_pauli_colours() -> None:
    # Odd bounce is blue, even bounce red, cross polarization green; equal amplitudes 17.5 dB down are half as bright.
    k = pauli_vector([[1.0, 1.0, 0.0, np.nan]], [[0.0, 0.0, 2.0, 0.0]], [[1.0, -1.0, 0.0, 0.0]])
    rgb = pauli_rgb(k, span_db=35.0)
    np.testing.assert_allclose(rgb[0, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-9)
    assert np.isnan(rgb[0, 3]).any()
    faint = 10 ** (-17.5 / 20)
    np.testing.assert_allclose(pauli_rgb(pauli_vector([[1, faint]], [[0, 0]], [[1, faint]]))[0, 1], [0, 0, 0.5])
    np.testing.assert_array_equal(pauli_rgb(np.zeros((3, 2, 2), dtype=complex)), np.zeros((2, 2, 3)))


def test_command_line(products: Path, tmp_path: Path) -> None:
    (tmp_path / "r.toml").write_text(REGIONS)
    app = build()
    done = CliRunner().invoke(app, ["fuse", str(products), "--regions", str(tmp_path / "r.toml"), "--json"])
    assert done.exit_code == 0, done.stderr
    printed = json.loads(done.stdout)
    assert set(printed["bhattacharyya"]) == {"dihedral - trihedral"}
    lower, upper = printed["bayes_bounds"]["dihedral - trihedral"]
    assert 0 <= lower <= upper <= 0.5
    assert set(printed["classes"]) == {"class 1", "class 2", "class 3"}
    assert Path(printed["figure"]).is_file()
    assert Path(printed["figure"]) == products.with_name("p_fusion.png")
    readable = CliRunner().invoke(app, ["fuse", str(products), "--classes", "2", "--start", "even"])
    assert readable.exit_code == 0, readable.stderr
    assert "class 2" in readable.stdout
    missing = CliRunner().invoke(app, ["fuse", str(tmp_path / "none.h5"), "--json"])
    assert missing.exit_code == 1
    assert "no such products file" in missing.stderr


def test_lexicographic_components_of_a_reciprocal_target() -> None:
    # (|HH|, sqrt 2 |HV|, |VV|) back from the Pauli vector, by hand: HH = 3, HV = 4j, VV = -5.
    s = matrix_of_pauli(pauli_vector([[3.0]], [[4.0j]], [[-5.0]]))
    lexicographic = np.abs(lexicographic_vector(s[..., 0, 0], s[..., 0, 1], s[..., 1, 1]))
    np.testing.assert_allclose(lexicographic.ravel(), [3.0, 4.0 * np.sqrt(2.0), 5.0], rtol=1e-12)


@pytest.mark.parametrize("method", ["isodata", "mixture"])
def test_classes_that_are_found(products: Path, method: str) -> None:
    made = fuse(products, classifier=method, classes=3)
    stage = Products(products).read("fusion")
    assert at(stage["classes"], *DIHEDRAL.position_m[:2]) != at(stage["classes"], *TRIHEDRAL.position_m[:2])
    assert made.confusion is None
    assert next(iter(made.classes)) == "class 1"  # most even-bounce first
    assert made.classes["class 1"].mean["even bounce"] == max(k.mean["even bounce"] for k in made.classes.values())
    draw_all(Products(products), products.with_name("f.png"))


def test_classes_that_are_learnt_are_judged_on_other_pixels(products: Path, tmp_path: Path) -> None:
    (tmp_path / "r.toml").write_text(REGIONS)
    made = fuse(products, regions=tmp_path / "r.toml", classifier="likelihood")
    assert made.confusion is not None
    counts = np.array(made.confusion["counts"])
    # Between an even and an odd bounce nothing is mistaken; half of the regions, by squares, was learnt from.
    assert counts[0, 1] + counts[1, 0] == 0
    assert 0 < counts.sum() < sum(region.pixels for region in made.regions.values())
    assert list(made.classes) == ["dihedral", "trihedral"]
    assert Products(products).settings("fusion")["confusion"]["accuracy"] == 1.0
    draw_all(Products(products), products.with_name("f.png"))
    run = CliRunner().invoke(
        build(), ["fuse", str(products), "--regions", str(tmp_path / "r.toml"), "--classifier", "svm", "--json"]
    )
    assert json.loads(run.stdout)["confusion"]["names"] == ["dihedral", "trihedral"]
    with pytest.raises(PolfuseError, match="learnt by forest from regions"):
        fuse(products, classifier="forest")


def test_what_differs_from_its_neighbourhood_is_told(products: Path) -> None:
    fuse(products)
    stage = Products(products).read("fusion")
    assert stage["local_rx"].shape == GRID.shape
    assert (stage["local_rx"][np.isfinite(stage["local_rx"])] >= 0).all()
