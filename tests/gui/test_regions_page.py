"""Regions drawn by hand: every change can be undone, and the numbers are those of the pixels inside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt

from gui.models.regions import RegionList
from gui.pages.regions_page import RegionsPage, _corners
from gui.workbench import Workbench
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.region_statistics import Region, region_report
from polfuse_lab.products.store import Products

SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
LEFT = ((-2.0, 3.0), (-0.5, 3.0), (-0.5, 5.0), (-2.0, 5.0))
RIGHT = ((0.5, 3.0), (2.0, 3.0), (2.0, 5.0), (0.5, 5.0))


@pytest.fixture
def fused(tmp_path: Path) -> Path:
    path = tmp_path / "products.h5"
    rng = np.random.default_rng(5)
    x, y = np.linspace(-2.5, 2.5, 51), np.linspace(2.5, 5.5, 31)
    features = rng.normal(0.5, 0.05, (4, 31, 51))
    features[3, :, x > 0] += 0.3  # the right half is more polarized
    arrays = {
        "features": features.astype(np.float32), "classes": np.zeros((31, 51), np.int8), "x_m": x, "y_m": y,
        "dolp_on_ground": features[3].astype(np.float32), "s0_on_ground": np.ones((31, 51), np.float32),
        "rx": np.ones((31, 51), np.float32), "registration_error_px": np.ones((31, 51), np.float32),
    }  # fmt: skip
    Products(path).write("fusion", arrays, settings={"classes": {"class 1": {}}}, inputs=[], units={})
    return path


def test_every_change_can_be_undone_and_redone(qtbot, tmp_path: Path) -> None:
    regions = RegionList()
    first = regions.add(SQUARE)
    second = regions.add(LEFT)
    regions.move(first, RIGHT)
    assert regions.rename(second, "grass")
    assert not regions.rename("grass", first)
    assert not regions.rename("grass", "  ")
    regions.remove(first)
    states = [{}, {first: SQUARE}, {first: SQUARE, second: LEFT}, {first: RIGHT, second: LEFT},
              {first: RIGHT, "grass": LEFT}, {"grass": LEFT}]  # fmt: skip
    assert regions.regions == states[-1]
    for state in states[-2::-1]:
        regions.undo.undo()
        assert regions.regions == state
    assert not regions.undo.canUndo()
    for state in states[1:]:
        regions.undo.redo()
        assert regions.regions == state
    with pytest.raises(PolfuseError, match="draw two or more"):
        regions.save(tmp_path / "r.toml")
    regions.add(SQUARE)
    regions.save(tmp_path / "r.toml")
    again = RegionList()
    again.load(tmp_path / "r.toml")
    assert again.regions == regions.regions


def test_the_report_holds_the_pixels_inside(fused: Path) -> None:
    report = region_report(fused, (Region(name="left", polygon_m=LEFT), Region(name="right", polygon_m=RIGHT)))
    arrays = Products(fused).read("fusion")
    x, y = np.meshgrid(arrays["x_m"], arrays["y_m"])
    inside = (x >= -2) & (x < -0.5) & (y > 3) & (y < 5)
    # The grid's lines at x = -2 and -0.5 and y = 3 and 5 lie on the border: one of each pair counts (even-odd rule).
    assert report.regions["left"].pixels == pytest.approx(inside.sum(), rel=0.1)
    assert report.regions["left"].mean["DOLP"] == pytest.approx(arrays["features"][3][inside].mean(), abs=0.01)
    pair = report.pairs["left - right"]
    # 0.3 apart with a spread of 0.05: d^2 / (8 s^2) = 4.5, and nothing in the other features.
    assert pair.distance["pauli_dolp"] == pytest.approx(4.5, rel=0.15)
    assert pair.distance["pauli"] < 0.1


def test_regions_are_drawn_named_and_measured(qtbot, fused: Path) -> None:
    bench = Workbench()
    page = RegionsPage(bench)
    qtbot.addWidget(page)
    page.resize(1200, 700)
    with qtbot.waitExposed(page):
        page.show()
    bench.open_products(fused)
    qtbot.waitUntil(page.new_button.isEnabled)
    qtbot.waitUntil(lambda: page.view._values is not None)
    with qtbot.waitSignal(page.regions.reported, timeout=10_000):
        qtbot.mouseClick(page.new_button, Qt.MouseButton.LeftButton)
    assert page.table.rowCount() == 1
    assert int(page.table.item(0, 1).text()) > 10
    # Dragging the shape moves the region, and can be undone.
    (shape,) = page._shapes.values()
    before = _corners(shape)
    with qtbot.waitSignal(page.regions.reported, timeout=10_000):
        shape.translate((1.0, 0.0))
    (moved,) = page.regions.regions.values()
    np.testing.assert_allclose(moved, [(x + 1.0, y) for x, y in before], atol=1e-9)
    page.regions.undo.undo()
    np.testing.assert_allclose(_corners(shape), before, atol=1e-9)
    page.table.item(0, 0).setText("grass")
    assert list(page.regions.regions) == ["grass"]
    page.regions.add(RIGHT)
    qtbot.waitUntil(lambda: page.pairs.rowCount() == 1)
    assert page.pairs.item(0, 0).text().startswith("grass - ")
    page.close()
    bench.close()
