"""PolSARpro folders in and out, ``polfuse decompose``, and real L-band data against PolSARpro's own pictures."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from real_data import real_data
from scipy.stats import spearmanr
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.errors import PolfuseError
from polfuse_lab.exports.polsarpro import Matrix, export_polsarpro
from polfuse_lab.imports.polsarpro import import_polsarpro, read_folder
from polfuse_lab.polsarpro import plane_names, write_config, write_plane
from polfuse_lab.products.decompose import METHODS, decompose
from polfuse_lab.products.figures_decompose import signature_figure
from polfuse_lab.products.store import Products
from polfuse_lab.products.style import save
from processing.polarimetry import targets
from processing.polarimetry.averaging import window_average
from processing.polarimetry.freeman import freeman_durden
from processing.polarimetry.matrices import covariance_of_coherency, planes_of_vector, total_power
from processing.polarimetry.pauli import pauli_of_matrix, pauli_vector
from processing.polarimetry.signatures import signature

ROWS, COLUMNS = 12, 15


def scattering() -> np.ndarray:
    rng = np.random.default_rng(3)
    s = (rng.normal(size=(4, ROWS, COLUMNS)) + 1j * rng.normal(size=(4, ROWS, COLUMNS))).astype(np.complex64)
    s[2] = s[1]
    return s


def folder_of(path: Path, matrix: Matrix) -> np.ndarray:
    """A folder as PolSARpro writes it; returns its planes."""
    s = scattering()
    planes = s
    if matrix != "S2":
        planes = planes_of_vector(pauli_vector(s[0], s[1], s[3]).astype(np.complex64))
        planes = planes if matrix == "T3" else covariance_of_coherency(planes)
    path.mkdir()
    write_config(path, ROWS, COLUMNS)
    for name, plane in zip(plane_names(matrix), planes, strict=True):
        write_plane(path, name, plane)
    return planes


def calibrated(path: Path) -> Path:
    """A products file with a calibrated image on the ground, one pixel of it undefined."""
    s = scattering()
    s[:, 4, 5] = np.nan
    x, y = np.linspace(-2, 2, COLUMNS), np.linspace(5, 9, ROWS)
    Products(path).write(
        "calibration",
        {"scattering": s, "x_m": x, "y_m": y},
        settings={"channels": ["HH", "HV", "VH", "VV"]},
        inputs=[],
        units={"scattering": "sqrt(m^2)"},
    )
    return path


@pytest.mark.parametrize("matrix", ["S2", "C3", "T3"])
def test_a_folder_comes_out_as_it_went_in(tmp_path: Path, matrix: Matrix) -> None:
    planes = folder_of(tmp_path / "in", matrix)
    found = import_polsarpro(tmp_path / "in", tmp_path / "p.h5")
    assert found.matrix == matrix
    export_polsarpro(tmp_path / "p.h5", tmp_path / "out")
    for name, plane in zip(plane_names(matrix), planes, strict=True):
        content = (tmp_path / "out" / f"{name}.bin").read_bytes()
        assert content == plane.astype("<c8" if matrix == "S2" else "<f4").tobytes()
    assert not (tmp_path / "out" / "mask_valid_pixels.bin").exists()
    # The order that PolSARpro's config.txt has, and ENVI's type numbers: 4 float32, 6 complex of two.
    words = (tmp_path / "out" / "config.txt").read_text().split()
    assert (
        words == f"Nrow {ROWS} --------- Ncol {COLUMNS} --------- PolarCase monostatic --------- PolarType full".split()
    )
    header = (tmp_path / "out" / f"{plane_names(matrix)[0]}.bin.hdr").read_text()
    assert f"data type = {6 if matrix == 'S2' else 4}" in header
    assert f"samples = {COLUMNS}" in header


def test_s12_is_received_with_h_and_sent_with_v(tmp_path: Path) -> None:
    export_polsarpro(calibrated(tmp_path / "p.h5"), tmp_path / "s2")
    s12 = np.fromfile(tmp_path / "s2" / "s12.bin", "<c8").reshape(ROWS, COLUMNS)
    np.testing.assert_array_equal(s12[0], scattering()[2, 0])  # VH: sent with V


def test_undefined_pixels_are_masked_for_polsarpro(tmp_path: Path) -> None:
    products = calibrated(tmp_path / "p.h5")
    for matrix in ("S2", "C3", "T3"):
        export_polsarpro(products, tmp_path / matrix, matrix)  # type: ignore[arg-type]
        first = np.fromfile(tmp_path / matrix / f"{plane_names(matrix)[0]}.bin", "<f4")
        assert np.isfinite(first).all()
        planes = read_folder(tmp_path / matrix).planes
        assert np.isnan(planes[:, 4, 5]).all()
        assert np.isfinite(planes).sum() == len(planes) * (ROWS * COLUMNS - 1)
    t = planes_of_vector(pauli_vector(*scattering()[[0, 1, 3]]).astype(np.complex64))
    np.testing.assert_allclose(read_folder(tmp_path / "T3").planes[:, 0], t[:, 0], rtol=1e-6, atol=1e-6)


def test_big_endian_planes_are_read(tmp_path: Path) -> None:
    planes = folder_of(tmp_path / "in", "T3")
    for name, plane in zip(plane_names("T3"), planes, strict=True):
        (tmp_path / "in" / f"{name}.bin").write_bytes(plane.astype(">f4").tobytes())
        header = tmp_path / "in" / f"{name}.bin.hdr"
        header.write_text(header.read_text().replace("byte order = 0", "byte order = 1"))
    np.testing.assert_array_equal(read_folder(tmp_path / "in").planes, planes)


def test_bad_folders_are_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(PolfuseError, match="is no folder"):
        read_folder(tmp_path / "none")
    (tmp_path / "empty").mkdir()
    with pytest.raises(PolfuseError, match=r"config.txt: cannot be read"):
        read_folder(tmp_path / "empty")
    write_config(tmp_path / "empty", 3, 4)
    with pytest.raises(PolfuseError, match="holds no s11"):
        read_folder(tmp_path / "empty")
    folder_of(tmp_path / "cut", "T3")
    (tmp_path / "cut" / "T33.bin").write_bytes(b"1234")
    with pytest.raises(PolfuseError, match="holds 4 bytes where 12 x 15 pixels take 720"):
        read_folder(tmp_path / "cut")
    (tmp_path / "cut" / "T33.bin").unlink()
    with pytest.raises(PolfuseError, match=r"T33.bin: cannot be read"):
        read_folder(tmp_path / "cut")
    (tmp_path / "cut" / "config.txt").write_text("Nrow\nmany\n")
    with pytest.raises(PolfuseError, match="tells no number for Nrow"):
        read_folder(tmp_path / "cut")


@pytest.mark.parametrize("method", [name for name in METHODS if name != "signature"])
def test_every_method_on_a_calibrated_image(tmp_path: Path, method: str) -> None:
    products = calibrated(tmp_path / "p.h5")
    made = decompose(products, method, folder=tmp_path / "planes")
    arrays = Products(products).read(made.stage)
    assert {"x_m", "y_m", *made.planes} == set(arrays)
    assert Products(products).provenance(made.stage)["stages"].keys() == {"calibration"}
    planes = [path for path in made.files if path.suffix == ".bin"]
    assert len(planes) == len(made.planes)
    for path, name in zip(planes, made.planes, strict=True):
        stored = np.fromfile(path, "<f4").reshape(ROWS, COLUMNS)
        np.testing.assert_array_equal(stored, arrays[name])
        assert name == "class" or np.isnan(stored[4, 5])
        shown = made.planes[name]
        finite = stored[np.isfinite(stored)]
        assert shown["max"] == (finite.max() if finite.size else None)
    if method in ("freeman", "yamaguchi"):
        s = scattering()
        t = planes_of_vector(pauli_vector(s[0], s[1], s[3]).astype(np.complex64))
        t[:, 4, 5] = np.nan
        span = total_power(window_average(t, 5))
        np.testing.assert_allclose(sum(arrays[name] for name in made.planes), span, rtol=1e-5)


def test_the_command_answers_as_agreed(tmp_path: Path) -> None:
    folder_of(tmp_path / "in", "T3")
    products = tmp_path / "p.h5"
    run = CliRunner()
    answer = run.invoke(build(), ["import", str(tmp_path / "in"), "-o", str(products), "--as", "polsarpro", "--json"])
    assert answer.exit_code == 0, answer.output
    imported = json.loads(answer.stdout)
    assert (imported["rows"], imported["cols"], imported["matrix"]) == (ROWS, COLUMNS, "T3")
    words = ["decompose", str(products), "--method", "h-a-alpha", "--window", "3", "-o", str(tmp_path / "o"), "--json"]
    answer = run.invoke(build(), words)
    assert answer.exit_code == 0, answer.output
    found = json.loads(answer.stdout)
    assert set(found["planes"]["entropy"]) == {"median", "min", "max"}
    assert 0 <= found["planes"]["entropy"]["min"] <= found["planes"]["entropy"]["max"] <= 1
    assert "9 looks" in found["note"]
    names = {Path(path).name for path in found["files"]}
    assert {"config.txt", "entropy.bin", "alpha.bin.hdr", "p_h_a_alpha.png", "p_h_a_alpha_plane.png"} <= names
    assert all(Path(path).stat().st_size for path in found["files"])


def test_what_cannot_be_done_is_said(tmp_path: Path) -> None:
    folder_of(tmp_path / "in", "C3")
    import_polsarpro(tmp_path / "in", tmp_path / "p.h5")
    with pytest.raises(PolfuseError, match="holds C3, averages that have lost the phases"):
        decompose(tmp_path / "p.h5", "cameron")
    with pytest.raises(PolfuseError, match="takes single scattering matrices"):
        decompose(tmp_path / "p.h5", "krogager", window=3)
    with pytest.raises(PolfuseError, match="no method 'magic'"):
        decompose(tmp_path / "p.h5", "magic")
    answer = CliRunner().invoke(build(), ["decompose", str(tmp_path / "p.h5"), "-m", "freeman", "--window", "4"])
    assert answer.exit_code == 1
    assert "a window of 4 pixels has no centre" in answer.stderr


def test_signature_picture(tmp_path: Path) -> None:
    k = pauli_of_matrix(targets.dihedral())
    path = save(signature_figure(signature(np.outer(k, k.conj()))), tmp_path / "signature.png")
    assert np.asarray(Image.open(path)).std() > 1


def test_freeman_of_real_data_is_what_polsarpro_shows() -> None:
    # PolSARpro's pictures of the three powers are on a scale of its own (256 grey levels of dB), so ranks are compared:
    # they were made with a 3 x 3 average. Other windows correlate by 0.93 (1 x 1) and 0.96 (5 x 5) only.
    folder = real_data("polsar")
    rows, columns = slice(200, 500), slice(300, 700)
    planes = read_folder(folder / "san_francisco_T3").planes[:, rows, columns]
    powers = freeman_durden(window_average(np.ascontiguousarray(planes), 3))
    for power, name in zip(powers, ("Ps", "Pd", "Pv"), strict=True):
        grey = np.asarray(Image.open(folder / f"{name}.bmp").convert("L"))[rows, columns].astype(float)
        inside = np.zeros(grey.shape, dtype=bool)
        inside[2:-2, 2:-2] = True
        shown = inside & (grey > 0) & (grey < 255) & (power > 0)
        assert spearmanr(grey[shown], power[shown]).statistic > 0.999
