"""A real collect through the window, against the simulated rig: as a user does it, and when the window is killed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import matplotlib
import pytest
from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QApplication, QFileDialog, QPushButton

from gui.main_window import MainWindow
from gui.models.simulator import Simulator
from gui.pages.collect_page import CollectPage
from gui.pages.products_page import ProductsPage
from gui.pages.session_page import SessionPage
from gui.pages.setup_page import SetupPage
from gui.pages.start_page import SCENE
from polfuse_lab.engine import engines
from polfuse_lab.engine.serving import LINGER_S
from polfuse_lab.products.store import Products
from polfuse_lab.session import info, open_session

PLAN = """
name = "short"
aperture_m = {aperture_m}
step_m = 0.1
sweeps_per_channel = 1
move_settle_s = 0.0
"""
OPTICS = """[optics]
frames_per_angle = 1
settle_s = 0.0
"""
LONG_MS = 120_000
"""An overloaded machine takes its time; each of these is a second or two on a quiet one."""


@pytest.fixture(autouse=True)
def active(qtbot, window: MainWindow) -> Iterator[None]:
    """The window takes keys; afterwards no engine is left."""
    with qtbot.waitActive(window):
        window.activateWindow()
    yield
    window.close()
    end = time.monotonic() + LINGER_S + 10
    while engines() and time.monotonic() < end:
        time.sleep(0.05)
    assert engines() == []


def click(qtbot, button: QPushButton) -> None:
    qtbot.waitUntil(lambda: button.isVisible() and button.isEnabled(), timeout=LONG_MS)
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def ready(qtbot, setup: SetupPage) -> bool:
    """Whether every light is green or amber; what did not open in time is tried again, as its card advises."""
    for card in setup.cards.values():
        if card.light == "bad":
            qtbot.mouseClick(card.retry_button, Qt.MouseButton.LeftButton)
    return setup.all_ready


def press(qtbot, window: MainWindow, key: Qt.Key, held: Qt.KeyboardModifier = Qt.KeyboardModifier.NoModifier) -> None:
    qtbot.keyClick(window, key, held)


@pytest.mark.skipif(
    shutil.which("Xvfb") is not None and "POLFUSE_UNDER_X" not in os.environ,
    reason="carried out on an X server, see test_window_under_x.py",
)
@pytest.mark.timeout(400)
def test_from_the_start_page_to_the_report(
    qtbot, qapp: QApplication, window: MainWindow, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert qapp.platformName() == os.environ["QT_QPA_PLATFORM"]
    setup, collect = window.page("setup"), window.page("collect")
    session_page, products_page = window.page("session"), window.page("products")
    assert isinstance(setup, SetupPage)
    assert isinstance(collect, CollectPage)
    assert isinstance(session_page, SessionPage)
    assert isinstance(products_page, ProductsPage)
    told: list[str] = []
    window.bench.error.connect(lambda sentence, _: told.append(sentence))

    def until(reached) -> None:
        qtbot.waitUntil(lambda: bool(told) or reached(), timeout=LONG_MS)
        assert not told

    # Set-up: every light is green, then the trolley is moved by hand.
    click(qtbot, window.start_page.try_button)
    until(lambda: window.current == "setup" and bool(setup.cards))
    until(lambda: ready(qtbot, setup))
    jog = next(found for found in setup.findChildren(QPushButton) if found.text() == "+10 cm")
    click(qtbot, jog)
    until(lambda: setup.place.text().startswith("x = +0.100 m"))

    # The plan is pasted and its file named with the keyboard; F5 starts it.
    press(qtbot, window, Qt.Key.Key_3, Qt.KeyboardModifier.ControlModifier)
    assert window.current == "collect"
    QGuiApplication.clipboard().setText(PLAN.format(aperture_m=0.2) + OPTICS)
    collect.text.setFocus()
    qtbot.keyClick(collect.text, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier)
    qtbot.keyClick(collect.text, Qt.Key.Key_V, Qt.KeyboardModifier.ControlModifier)
    output = tmp_path / "field" / "s.h5"
    collect.output.selectAll()
    qtbot.keyClicks(collect.output, str(output))
    until(collect.start_button.isEnabled)
    # 0.2 m in steps of 0.1 m are 3 positions, each with four channels; four angles of the polarizer.
    assert "3 positions, 12 audio records, 4 camera frames" in collect.verdict.text()
    press(qtbot, window, Qt.Key.Key_F5)

    # While it runs: a note, a pause, and on again.
    until(lambda: window.bench.engine.client is not None and collect.pause_button.isEnabled())
    collect.note.setFocus()
    qtbot.keyClicks(collect.note, "a dog in front of the plate")
    qtbot.keyClick(collect.note, Qt.Key.Key_Return)
    press(qtbot, window, Qt.Key.Key_F6)
    until(lambda: collect.pause_button.text() == "Go on" or collect.outcome is not None)
    assert collect.outcome is None
    press(qtbot, window, Qt.Key.Key_F6)
    until(lambda: collect.outcome is not None)
    assert collect.outcome is not None
    assert collect.outcome.state == "finished"
    assert collect.outcome.samples_lost + collect.outcome.frames_lost == 0
    assert collect.grid.state(2, "VV") == collect.grid.state(0, "HH") == "done"
    found = info(output)
    assert (found["positions"], found["sweeps"], found["frames"], found["complete"]) == (3, 12, 4, True)
    with open_session(output) as session:
        assert b"a dog in front of the plate" in session.notes["text"].tolist()

    # What comes after: the picture, and the report.
    click(qtbot, collect.look_button)
    until(lambda: session_page.predicted)
    assert "Error about" in session_page.prediction.text()
    press(qtbot, window, Qt.Key.Key_F, Qt.KeyboardModifier.ControlModifier)
    until(lambda: window.current == "products" and bool(products_page.views))
    assert "focus" in Products(session_page.products).stages()
    page = tmp_path / "report.html"
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(page), ""))
    report = next(found for found in products_page.findChildren(QPushButton) if found.text().startswith("Report"))
    click(qtbot, report)
    until(lambda: page.is_file() and not window.bench.jobs.busy)
    assert "</html>" in page.read_text(encoding="utf-8")
    # It is told, and can be opened from there.
    until(lambda: window.error_bar.text.endswith("report.html is written"))
    assert window.error_bar.open_button.isVisible()


WINDOW = """
import sys
import time
from pathlib import Path
from gui.app import make_application
from gui.main_window import MainWindow
application = make_application()
window = MainWindow()
window.show()
page = window.page("collect")
window.bench.rig = Path(sys.argv[1])
page.text.setPlainText(sys.argv[3])
page.output.setText(sys.argv[2])
def until(reached):
    while not reached():
        application.processEvents()
        time.sleep(0.02)
until(page.start_button.isEnabled)
page.start()
until(lambda: page.done_share >= 0.2)
print("seen", flush=True)
application.exec()
"""


@pytest.mark.skipif(os.name != "posix", reason="kills a process")
@pytest.mark.timeout(400)
def test_a_killed_window_harms_no_collect_and_the_next_one_watches_it(
    qtbot, window: MainWindow, tmp_path: Path
) -> None:
    simulator = Simulator(SCENE)
    try:
        with qtbot.waitSignal(simulator.ready, timeout=LONG_MS):
            simulator.start()
        output = tmp_path / "s.h5"
        other = subprocess.Popen(
            [sys.executable, "-c", WINDOW, str(simulator.rig), str(output), PLAN.format(aperture_m=1.0)],
            stdout=subprocess.PIPE,
            # Its home is empty: without this it would look at every font of the computer first.
            env={**os.environ, "MPLCONFIGDIR": matplotlib.get_cachedir()},
        )
        timer = threading.Timer(LONG_MS / 1000, other.kill)
        timer.start()
        assert other.stdout is not None
        line = other.stdout.readline()
        timer.cancel()
        timer.join()
        other.kill()
        other.wait(10)
        other.stdout.close()
        assert line == b"seen\n"

        window.start_page.refresh()
        qtbot.waitUntil(lambda: watch_buttons(window) != [], timeout=LONG_MS)
        click(qtbot, watch_buttons(window)[0])
        page = window.page("collect")
        assert isinstance(page, CollectPage)
        assert window.current == "collect"
        qtbot.waitUntil(lambda: page.done_share > 0.2 or page.outcome is not None, timeout=LONG_MS)
        assert page.outcome is None, "the collect was over before it could be watched"
        assert page.grid.positions == 11
        qtbot.waitUntil(lambda: page.outcome is not None, timeout=LONG_MS)
        assert page.outcome is not None
        assert page.outcome.state == "finished"
        assert page.outcome.samples_lost + page.outcome.frames_lost == 0
        found = info(output)
        assert (found["positions"], found["sweeps"], found["complete"]) == (11, 44, True)
    finally:
        simulator.stop()


def watch_buttons(window: MainWindow) -> list[QPushButton]:
    return [found for found in window.start_page.findChildren(QPushButton) if found.text() == "Watch it"]
