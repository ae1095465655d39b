"""Pages as a user drives them, without devices."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from PySide6.QtCore import Qt, QTimer
from PySide6.QtWidgets import QApplication

from gui import theme
from gui.app import make_application
from gui.errors import Uncaught, log_file
from gui.main_window import MainWindow
from gui.pages.collect_page import CollectPage
from gui.pages.products_page import ProductsPage
from gui.pages.session_page import SessionPage
from polfuse_lab import remembered
from polfuse_lab.rig.examples import write_examples


def collect_page(window: MainWindow) -> CollectPage:
    page = window.page("collect")
    assert isinstance(page, CollectPage)
    return page


def test_every_page_is_reached_by_the_keyboard(qtbot, window: MainWindow) -> None:
    window.activateWindow()
    with qtbot.waitActive(window):
        window.activateWindow()
    for number, name in enumerate(window.names, start=1):
        qtbot.keyClick(window, Qt.Key(Qt.Key.Key_0 + number % 10), Qt.KeyboardModifier.ControlModifier)
        assert window.current == name


def test_it_fits_a_small_laptop(window: MainWindow, qapp: QApplication) -> None:
    window.resize(1366, 768)
    for name in window.names:
        window.show_page(name)
        page = window.page(name)
        assert page.minimumSizeHint().width() <= 1366 - 150, name
        qapp.processEvents()
        # What is left of the height by the strip below; a page that needs more would have to be scrolled.
        assert page.height() <= 768 - window.strip.height(), name


def test_a_plan_is_judged_while_it_is_written(qtbot, window: MainWindow, tmp_path: Path) -> None:
    page = collect_page(window)
    qtbot.waitUntil(lambda: page.draft.verdict is not None)
    assert "choose a rig first" in page.verdict.text()
    assert not page.start_button.isEnabled()
    window.bench.rig = write_examples(tmp_path / "rig")["rig"]  # without opening its devices
    page.output.setText(str(tmp_path / "new folder" / "s.h5"))
    qtbot.waitUntil(page.start_button.isEnabled)
    # The example plan: 10 ft in steps of 2 in are 61 positions, four channels each.
    assert "61 positions, 244 audio records" in page.verdict.text()
    page.text.setPlainText(page.text.toPlainText().replace("step_m = 0.0508", "step_mm = 0.0508"))
    assert not page.start_button.isEnabled()
    qtbot.waitUntil(lambda: page.draft.verdict is not None)
    assert "step_mm" in page.verdict.text()
    assert "step_m" in page.verdict.text()
    assert not page.start_button.isEnabled()


def test_another_kind_of_plan_begins_with_its_example(qtbot, window: MainWindow) -> None:
    page = collect_page(window)
    page.kinds.setCurrentIndex(page.kinds.findData("polarizer_series"))
    page.kinds.activated.emit(page.kinds.currentIndex())
    assert 'kind = "polarizer_series"' in page.text.toPlainText()
    qtbot.waitUntil(lambda: page.draft.verdict is not None)


def test_looks_are_changed_and_remembered(qtbot, window: MainWindow, qapp: QApplication) -> None:
    page = window.settings_page
    page.looks_changed.connect(lambda name, points: theme.apply(qapp, theme.ThemeName(name), points))
    page.themes.setCurrentIndex(page.themes.findData("light"))
    page.sizes.setCurrentIndex(page.sizes.findData(15.0))
    assert theme.current().name == theme.ThemeName.LIGHT
    assert qapp.font().pointSizeF() == 15.0
    theme.apply(qapp, theme.ThemeName.DARK)
    make_application()
    assert theme.current().name == theme.ThemeName.LIGHT
    assert qapp.font().pointSizeF() == 15.0


def test_an_exception_in_a_slot_is_shown_and_logged(qtbot, window: MainWindow, monkeypatch: pytest.MonkeyPatch) -> None:
    uncaught = Uncaught()
    uncaught.tell_in(window.error_bar.tell)
    uncaught.install()
    try:
        with qtbot.captureExceptions():  # pytest-qt's own hook stands aside
            uncaught.install()
            QTimer.singleShot(0, lambda: 1 / 0)
            qtbot.waitUntil(lambda: "ZeroDivisionError" in window.error_bar.text)
        thread = threading.Thread(target=lambda: [][1])
        thread.start()
        thread.join()
        qtbot.waitUntil(lambda: "IndexError" in window.error_bar.text)
    finally:
        uncaught.remove()
    assert "ZeroDivisionError" in log_file().read_text(encoding="utf-8")


def test_files_that_are_gone_are_told(qtbot, window: MainWindow, tmp_path: Path) -> None:
    rig = write_examples(tmp_path / "rig")["rig"]
    remembered.remember_rig(rig)
    window.start_page.refresh()
    assert window.start_page.rigs.item(0).text().startswith(rig.name)
    rig.unlink()
    window.start_page.refresh()
    item = window.start_page.rigs.item(0)
    assert "not there any more" in item.text()
    assert item.flags() == Qt.ItemFlag.NoItemFlags


def test_a_file_that_is_no_session_is_told_in_words(qtbot, window: MainWindow, tmp_path: Path) -> None:
    broken = tmp_path / "broken.h5"
    broken.write_bytes(b"nothing of the kind")
    window.open(broken)
    assert window.current == "session"
    qtbot.waitUntil(lambda: bool(window.error_bar.text))
    assert "broken.h5" in window.error_bar.text
    page = window.page("session")
    assert isinstance(page, SessionPage)
    assert not page.focus_button.isEnabled()


def test_products_are_shown_one_or_two_at_a_time(qtbot, window: MainWindow, tmp_path: Path) -> None:
    import numpy as np

    from polfuse_lab.products.store import Products

    path = tmp_path / "products.h5"
    x, y = np.linspace(-2, 2, 41), np.linspace(3, 9, 31)
    rng = np.random.default_rng(1)
    image = (rng.normal(size=(2, 31, 41)) + 1j * rng.normal(size=(2, 31, 41))).astype(np.complex64)
    Products(path).write(
        "focus", {"image": image, "x_m": x, "y_m": y}, settings={"channels": ["HH", "VV"]}, inputs=[], units={}
    )
    window.open(path)
    page = window.page("products")
    assert isinstance(page, ProductsPage)
    qtbot.waitUntil(lambda: len(page.views) == 1)
    page.choose("focus.HH", "focus.VV")
    qtbot.waitUntil(lambda: len(page.views) == 2)
    page.views[0].pointed.emit((0.0, 6.0))
    # Level below the brightest pixel of all channels, at the middle of the grid.
    level = 20 * np.log10(np.abs(image[1, 15, 20]) / np.abs(image).max())
    assert f"Focused VV {level:.1f} dB" in page.views[1].readout.text()
