"""The scripts in examples/, each run as its heading says, against the simulated rig."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from hw_mocks.rig import SimulatedRig
from polfuse_lab.products.store import Products
from polfuse_lab.session import info

pytestmark = pytest.mark.realtime

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    folder = tmp_path_factory.mktemp("simulated")
    with SimulatedRig(EXAMPLES / "scenes" / "field.toml", folder, seed=1) as simulated:
        yield simulated.write_rig(folder / "rig.toml")


def run(script: str, *arguments: Path) -> str:
    """Run an example to its end and return what it printed."""
    command = [sys.executable, str(EXAMPLES / script), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=110)
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr
    return done.stdout


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.name)
def test_examples_are_short(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) < 40


def test_collect_watch_and_select(rig: Path, tmp_path: Path) -> None:
    session, arrays = tmp_path / "session.h5", tmp_path / "arrays.npz"
    told = run("collect_and_watch.py", rig, session)
    assert "step 55 of 55: all steps carried out" in told
    # 2 passes over 3 places in 2 channels; a polarizer series of 4 frames in the first pass.
    assert "12 audio records, 4 frames, 3 places along the rail" in told
    assert re.search(r"(HH|VV) is strongest at \d+\.\d m", told)
    found = info(session)
    assert found["complete"]
    # A loaded machine may make the sound card's clock jump, and says so; but nothing may be missing.
    assert not [problem for problem in found["problems"] if "missing" in problem or "lost" in problem]

    told = run("select_records.py", session, arrays)
    assert "the same scheduler once more: identical" in told
    assert "55 steps were planned, the first of them MoveTo(x_m=-0.0508, position=0)" in told
    with np.load(arrays) as saved:
        # HH at the first three positions; four angles of 782 x 582 pixels, see the scene file.
        assert saved["beats"].shape == (3, 4096, 2)
        np.testing.assert_allclose(saved["x_m"], [-0.0508, 0.0, 0.0508], atol=2e-6)
        np.testing.assert_allclose(saved["angles_deg"], [0, 45, 90, 135], atol=0.1)
        assert saved["images"].shape == (4, 582, 782)
        assert float(saved["sample_rate_hz"]) == 48_000.0


def test_calibration_series(rig: Path, tmp_path: Path) -> None:
    told = run("calibration_series.py", rig, tmp_path)
    assert told.count("Place corner (trihedral with square faces, edge 0.61 m)") == 1
    assert "series finished" in told
    assert "scene finished" in told
    products = Products(tmp_path / "products.h5")
    assert str(tmp_path / "reference.h5") in str(products.provenance("calibration"))
    assert "strongest in HH" in told
    arrays = products.read("calibration")
    x, y = np.meshgrid(arrays["x_m"], arrays["y_m"])
    hh = np.abs(arrays["scattering"][0]) ** 2
    # The scene's trihedral stands at x = 1.2 m, y = 8.6 m, 0.469 m above the ground; 12 pi a^4 / lambda^2 = 25.2 dBsm.
    near = (abs(x - 1.2) < 0.5) & (abs(y - np.sqrt(8.6**2 + 0.6**2 - 1.069**2)) < 0.6)
    measured = 10 * np.log10(np.nanmax(hh[near]))
    assert measured == pytest.approx(25.2, abs=1.0), told
