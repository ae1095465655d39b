"""Windows without a display; a test that leaves a widget or a thread behind fails."""

from __future__ import annotations

import gc
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest.importorskip("PySide6", reason="the window's packages are not installed (extra 'gui')")
pytest.importorskip("pyqtgraph", reason="the window's packages are not installed (extra 'gui')")

import shiboken6
from PySide6.QtCore import QCoreApplication, QEvent, QThreadPool
from PySide6.QtWidgets import QApplication, QWidget

from gui import theme
from gui.main_window import MainWindow

THREADS_END_S = 10.0


@pytest.fixture(scope="session")
def qapp_args() -> list[str]:
    return ["polfuse"]


@pytest.fixture(scope="session", autouse=True)
def _settled(qapp: QApplication) -> None:
    """What the program has loaded lives as long as it does: looking for garbage among it after each test takes long."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def _tidy(qapp: QApplication, request: pytest.FixtureRequest) -> Iterator[None]:
    """The dark theme, and afterwards no window, no task and no thread more than before."""
    theme.apply(qapp, theme.ThemeName.DARK)
    widgets = set(map(_address, qapp.topLevelWidgets()))
    threads = set(threading.enumerate())
    yield
    request.node.funcargs.clear()  # pytest holds what the test was given until after this
    assert QThreadPool.globalInstance().waitForDone(10_000)
    for _ in range(3):
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        qapp.processEvents()
        gc.collect()
    left = [widget for widget in qapp.topLevelWidgets() if _address(widget) not in widgets]
    assert not left, f"widgets left behind: {left}"
    end = time.monotonic() + THREADS_END_S
    while (alive := _new_threads(threads)) and time.monotonic() < end:
        qapp.processEvents()
        time.sleep(0.05)
    assert not alive, f"threads left behind: {alive}"


def _address(widget: QWidget) -> int:
    # Not its id: what Qt made itself gets a new wrapper each time that it is asked for.
    address: int = shiboken6.getCppPointer(widget)[0]
    return address


def _new_threads(before: set[threading.Thread]) -> list[threading.Thread]:
    # Threads of Qt's pool that have run Python show up as dummies; the pool keeps them for the next task.
    return [
        thread
        for thread in threading.enumerate()
        if thread not in before and thread.is_alive() and not isinstance(thread, threading._DummyThread)
    ]


@pytest.fixture
def window(qtbot, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[MainWindow]:
    """The whole window, of a user without any settings."""
    monkeypatch.setenv("HOME", str(tmp_path))
    made = MainWindow()
    qtbot.addWidget(made)
    with qtbot.waitExposed(made):
        made.show()
    yield made
    made.close()
