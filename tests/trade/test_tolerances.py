"""Tolerances by name or number in the commands: what is chosen, why, and what the product keeps of it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from polfuse_lab.cli import build
from polfuse_lab.imports.polsarpro import import_polsarpro
from polfuse_lab.polsarpro import plane_names, write_config, write_plane
from polfuse_lab.products.store import Products
from processing.polarimetry.speckle.simulation import speckled

GROUND = np.array([1.0, 0.3, 0.1, 0.05, -0.02, 0.5, 0.0, 0.04, 0.2])


@pytest.fixture
def products(tmp_path: Path) -> Path:
    """Four-look speckle over even ground, as PolSARpro stores it."""
    planes = speckled(np.broadcast_to(GROUND[:, None, None], (9, 60, 60)), 4, np.random.default_rng(5))
    folder = tmp_path / "T3"
    folder.mkdir()
    write_config(folder, 60, 60)
    for name, plane in zip(plane_names("T3"), planes, strict=True):
        write_plane(folder, name, plane.astype(np.float32))
    import_polsarpro(folder, tmp_path / "p.h5")
    return tmp_path / "p.h5"


def test_a_tolerance_chooses_the_window_and_the_product_says_so(products: Path) -> None:
    words = ["decompose", str(products), "--method", "freeman", "--filter-looks", "4"]
    answer = CliRunner().invoke(build(), [*words, "--tolerance", "field", "--json"])
    assert answer.exit_code == 0, answer.output
    told = json.loads(answer.stdout)
    # By hand: varies 2.09, squares 1.40, four looks: -4.3 dB; 3 x 3 pixels take 9.5 more, which is beyond -12.5 dB.
    assert told["window"] == 3
    assert "smallest within -12 dB" in told["explanation"][0]
    settings = Products(products).settings("decomposition_freeman")
    assert settings["predicted_error_db"] == pytest.approx(-13.8, abs=0.3)
    assert settings["tolerance_db"] == -12.0
    answer = CliRunner().invoke(build(), [*words, "--tolerance", "-20", "--explain"])
    assert "window 7" in answer.stdout
    assert "not 5" in answer.stdout


@pytest.mark.parametrize(
    "words",
    [
        ["--method", "freeman", "--tolerance", "field", "--window", "5"],
        ["--method", "freeman", "--tolerance", "field", "--filter", "nlm"],
        ["--method", "freeman", "--tolerance", "perfect"],
        ["--method", "freeman", "--tolerance", "3"],
        ["--method", "cameron", "--tolerance", "field"],
    ],
)
def test_tolerances_that_do_not_go(products: Path, words: list[str]) -> None:
    answer = CliRunner().invoke(build(), ["decompose", str(products), *words])
    assert answer.exit_code == 1
    assert answer.stderr.startswith("error: ")
    assert "defect" not in answer.stderr
