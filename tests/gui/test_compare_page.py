"""Two files side by side: the cursor of one is the cursor of both, and differences are told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import Qt

from gui.models.comparison import Side, differences, side_of
from gui.pages.compare_page import ComparePage
from gui.widgets.replay_bar import ReplayBar
from gui.widgets.status_strip import demo_status
from gui.workbench import Workbench
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.store import Products

X, Y = np.linspace(-2, 2, 41), np.linspace(3, 9, 31)


def write(path: Path, level_db: float, **settings: object) -> Path:
    image = np.full((1, 31, 41), 10 ** (level_db / 20), np.complex64)
    image[0, 0, 0] = 1.0  # what levels refer to: the brightest pixel
    Products(path).write(
        "focus", {"image": image, "x_m": X, "y_m": Y}, settings={"channels": ["HH"], **settings}, inputs=[], units={}
    )
    return path


@pytest.fixture
def page(qtbot) -> ComparePage:
    bench = Workbench()
    made = ComparePage(bench)
    bench.setParent(made)
    qtbot.addWidget(made)
    made.resize(1100, 650)
    made.show()
    qtbot.waitExposed(made)
    return made


def test_one_cursor_and_the_difference(qtbot, page: ComparePage, tmp_path: Path) -> None:
    page.open(0, write(tmp_path / "a.h5", -20.0, method="bp", tolerance_db=-50.0))
    page.open(1, write(tmp_path / "b.h5", -26.0, method="rma", tolerance_db=-50.0))
    qtbot.waitUntil(lambda: None not in page.views)
    left, right = page.views
    assert left is not None
    assert right is not None
    left.pointed.emit((0.5, 6.0))
    assert "-20.0 dB" in left.readout.text()
    assert "-26.0 dB" in right.readout.text()
    assert page.readout.text().endswith("right minus left -6.0 dB")
    rows = {page.table.item(row, 0).text(): (page.table.item(row, 1).text(), page.table.item(row, 2).text())
            for row in range(page.table.rowCount())}  # fmt: skip
    assert rows == {"focus: method": ("bp", "rma")}
    # Both show the same part of the ground, whichever is moved.
    left.item.vb.setRange(xRange=(-1, 1), yRange=(4, 6), padding=0)
    qtbot.waitUntil(lambda: right.item.vb.viewRange()[0] == pytest.approx(left.item.vb.viewRange()[0], abs=0.2))


def test_a_pixel_that_is_undefined_has_no_difference(qtbot, page: ComparePage, tmp_path: Path) -> None:
    page.open(0, write(tmp_path / "a.h5", -20.0))
    page.open(1, write(tmp_path / "b.h5", -26.0))
    qtbot.waitUntil(lambda: None not in page.views)
    left, _ = page.views
    assert left is not None
    left.pointed.emit((50.0, 6.0))
    assert page.readout.text() == " "
    left.pointed.emit(None)
    assert page.readout.text() == " "


def test_what_is_neither_session_nor_products_is_told(qtbot, page: ComparePage, tmp_path: Path) -> None:
    (tmp_path / "x.h5").write_bytes(b"nothing")
    with pytest.raises(PolfuseError):
        side_of(tmp_path / "x.h5")
    with qtbot.waitSignal(page._bench.error) as told:
        page.open(0, tmp_path / "x.h5")
    assert "x.h5" in told.args[0]


def test_facts_of_one_side_only_differ_too() -> None:
    one = Side(Path("a"), None, (), {"a": "1", "b": "2"})
    other = Side(Path("b"), None, (), {"b": "2", "c": "3"})
    assert differences(one, other) == [("a", "1", "–"), ("c", "–", "3")]


def test_the_replay_bar_asks_for_what_is_pressed(qtbot) -> None:
    bar = ReplayBar()
    qtbot.addWidget(bar)
    speeds, pauses, stops = [], [], []
    bar.speed_wanted.connect(speeds.append)
    bar.pause_wanted.connect(pauses.append)
    bar.stop_wanted.connect(lambda: stops.append(1))
    assert not bar.isVisible()
    bar.begin(2.0)
    assert bar.isVisible()
    assert bar.speed.value() == 2.0
    assert speeds == []  # it has been begun with that
    bar.show_status(demo_status(step=150, steps=600, position=14, elapsed_s=61.0))
    assert bar.line.value() / bar.line.maximum() == 0.25
    # Dragged with the keyboard or the mouse, it asks for another moment; news of where the replay is do not.
    sought = []
    bar.seek_wanted.connect(lambda *steps: sought.append(steps))
    bar.line.setFocus()
    qtbot.keyClick(bar.line, Qt.Key.Key_PageUp)
    qtbot.keyClick(bar.line, Qt.Key.Key_Home)
    bar.show_status(demo_status(step=10, steps=600, position=1, elapsed_s=2.0))
    assert sought == [(180, 150), (0, 150)]  # a page is a twentieth
    bar.show_status(demo_status(step=150, steps=600, position=14, elapsed_s=61.0))
    assert bar.words.text() == "position 15 of 61   1:01"
    bar.speed.setValue(7.5)
    bar.pause_button.click()
    bar.pause_button.click()
    assert speeds == [7.5]
    assert pauses == [True, False]
