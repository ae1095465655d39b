"""A calibration series carries its constant to another image; closed-form beats, so that the truth is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rail_data import CENTRE_HZ, HEIGHT_M, C
from rail_session import write_session

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import SeriesTarget, parse_plan
from polfuse_lab.products.calibrate import calibrate
from polfuse_lab.products.calibration_inputs import TargetSpec
from polfuse_lab.products.focus import focus
from polfuse_lab.products.store import Products
from processing.sar.grid import ImageGrid

PLATE = SeriesTarget(name="plate", kind="plate", edge_m=0.5, range_m=6.0)
SERIES = """
kind = "calibration_series"
channels = ["HH", "VV"]
aperture_m = 0.2
step_m = 0.1
repeats = 2
[[targets]]
name = "plate"
kind = "plate"
edge_m = 0.5
range_m = 6.0
[[targets]]
name = "other"
kind = "plate"
edge_m = 0.5
range_m = 6.0
"""
GRID = ImageGrid(np.arange(-2.0, 2.01, 0.1), np.arange(3.0, 12.01, 0.25), -HEIGHT_M)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The series' focused plate, and the scene: something of 100 m^2 in HH and 25 m^2 in VV, 9 m away."""
    made = tmp_path_factory.mktemp("series")
    # An apparent plate: 4 pi a^4 / lambda^2 at its normal, which it keeps over so short an aperture within 0.01 dB.
    plate = np.sqrt(4 * np.pi) * 0.5**2 / (C / CENTRE_HZ) * np.eye(2)
    ground = (0.0, 6.0, -HEIGHT_M)
    x = np.array(parse_plan(SERIES, "plan.toml").positions_m)
    assert len(x) == 2 * 2 * 3
    # The records of "other" come from elsewhere, so that taking them for the plate's would show.
    x[6:] += 1.0
    one = write_session(made / "plate.h5", [(ground, plate)], x, (Channel.HH, Channel.VV), plan=SERIES)
    focus(one, made / "reference.h5", target="plate", grid=GRID)
    scene = [((0.0, 9.0, -HEIGHT_M), np.diag([10.0, 5.0]))]
    session = write_session(made / "scene.h5", scene, np.linspace(-0.3, 0.3, 7), (Channel.HH, Channel.VV))
    focus(session, made / "scene_products.h5", grid=GRID)
    return made


def test_the_constant_is_carried_over(folder: Path) -> None:
    spec = TargetSpec.of(PLATE)
    found = calibrate(folder / "scene_products.h5", spec, reference=folder / "reference.h5")
    arrays = Products(folder / "scene_products.h5").read("calibration")
    row = int(np.argmin(abs(arrays["y_m"] - 9.0)))
    hh, vv = (np.abs(arrays["scattering"][channel][row]).max() for channel in (0, 1))
    # The stated plate's apparent RCS over its own aperture of 0.2 m is below that at the normal by what its pattern
    # loses at 0.1 m / 6 m = 1 degree (0.02 dB); the rest is the grid's step and the window: 0.3 dB.
    assert 20 * np.log10(hh) == pytest.approx(20.0, abs=0.3)
    assert hh / vv == pytest.approx(2.0, rel=0.01)
    assert found.target.y_m == pytest.approx(6.0, abs=0.15)
    assert Products(folder / "reference.h5").read("ranging")["antenna_m"].shape == (3, 3)


def test_a_reference_made_otherwise_is_refused(folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.h5"
    focus(folder / "plate.h5", other, target="plate", grid=GRID, window="taylor")
    with pytest.raises(PolfuseError, match="was focused with another window than the image"):
        calibrate(folder / "scene_products.h5", TargetSpec.of(PLATE), reference=other)


def test_a_target_of_no_series_is_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(PolfuseError, match="holds no target called 'sphere'"):
        focus(folder / "plate.h5", tmp_path / "p.h5", target="sphere", grid=GRID)


def test_targets_as_calibration_knows_them() -> None:
    dihedral = TargetSpec.of(SeriesTarget(name="d", kind="dihedral_45", edge_m=1.0, range_m=4.0, azimuth_deg=10))
    assert (dihedral.kind, dihedral.y_m) == ("dihedral", 4.0)
    assert np.degrees([dihedral.fold_rad, dihedral.azimuth_rad]) == pytest.approx([45, 10])
    assert TargetSpec.of(SeriesTarget(name="t", kind="trihedral_square", edge_m=1.0, range_m=4.0)).kind == "trihedral"
    triangular = TargetSpec.of(SeriesTarget(name="t", kind="trihedral", edge_m=1.0, range_m=4.0))
    assert triangular.kind == "trihedral_triangular"
