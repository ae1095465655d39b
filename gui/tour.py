"""Walks every page with the simulated rig and saves a picture of each: for the documentation, and to look at."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QCoreApplication, QEventLoop

from gui.app import make_application
from gui.main_window import MainWindow
from gui.pages.collect_page import CollectPage
from gui.pages.live_page import LivePage
from gui.pages.products_page import ProductsPage
from gui.pages.session_page import SessionPage
from gui.pages.setup_page import SetupPage
from polfuse_lab.errors import PolfuseError

PLAN = """\
name = "tour"
kind = "rail_sar"
aperture_m = 0.8128
step_m = 0.0508
channels = ["HH", "HV", "VV", "VH"]
sweeps_per_channel = 1
move_settle_s = 0.05
[optics]
frames_per_angle = 2
settle_s = 0.0
"""
LONGEST_S = 120.0


def tour(folder: Path) -> list[dict[str, str]]:
    """Save a picture of each page; a session is collected, played and focused on the way.

    Returns:
        ``name`` and ``file`` of each.

    Raises:
        PolfuseError: something did not come to its end in time, or told of an error.
    """
    folder.mkdir(parents=True, exist_ok=True)
    make_application()
    with tempfile.TemporaryDirectory(prefix="polfuse-tour-") as scratch:
        window = MainWindow()
        walk = _Walk(window, folder)
        try:
            window.show()
            _steps(walk, Path(scratch) / "tour.h5")
        finally:
            window.close()
            QCoreApplication.processEvents()
    return walk.pages


class _Walk:
    """Waits, looks and saves."""

    def __init__(self, window: MainWindow, folder: Path) -> None:
        self.window = window
        self._folder = folder
        self._errors: list[str] = []
        window.bench.error.connect(lambda sentence, _: self._errors.append(sentence))
        self.pages: list[dict[str, str]] = []

    def until(self, reached: Callable[[], bool], what: str, seconds: float = LONGEST_S) -> None:
        """Let the window live until something is so."""
        end = time.monotonic() + seconds
        while not reached():
            QCoreApplication.processEvents(QEventLoop.ProcessEventsFlag.AllEvents, 50)
            if self._errors:
                raise PolfuseError(self._errors[0], where="tour", advice="mend that, then walk again")
            if time.monotonic() > end:
                raise PolfuseError(f"{what} did not happen in {seconds:g} s", where="tour", advice="try again")

    def rest(self, seconds: float) -> None:
        """Let the window live for so long."""
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() >= end, "resting", seconds + 60)

    def save(self, name: str) -> None:
        """A picture of the window as it is."""
        self.rest(0.4)
        path = self._folder / f"{name}.png"
        if not self.window.grab().save(str(path)):
            raise PolfuseError("cannot be written", where=str(path), advice="choose a folder that may be written")
        self.pages.append({"name": name, "file": str(path)})


def _steps(walk: _Walk, session: Path) -> None:
    window = walk.window
    setup, collect, live = window.page("setup"), window.page("collect"), window.page("live")
    assert isinstance(setup, SetupPage)
    assert isinstance(collect, CollectPage)
    assert isinstance(live, LivePage)
    walk.save("start")
    window.start_page.try_button.click()
    walk.until(lambda: setup.all_ready, "that every device is ready")
    walk.until(lambda: setup.seen, "that signals and picture are seen")
    walk.rest(2.0)
    walk.save("setup")
    window.show_page("collect")
    collect.text.setPlainText(PLAN)
    collect.output.setText(str(session))
    walk.until(lambda: collect.start_button.isEnabled(), "that the plan is judged")
    walk.save("plan")
    collect.start_button.click()
    walk.until(lambda: collect.done_share > 0.25, "a quarter of the collect")
    walk.save("collect")
    window.show_page("live")
    for tab in ("ranges", "speeds"):
        live.show_tab(tab)
        walk.rest(1.0)
        walk.save(f"live-{tab}")
    live.show_tab("sar")
    walk.until(lambda: collect.done_share > 0.6 or collect.outcome is not None, "most of the collect")
    walk.save("live-sar")
    live.show_tab("camera")
    walk.until(lambda: collect.outcome is not None, "the end of the collect")
    walk.save("live-camera")
    live.show_tab("fused")
    walk.until(lambda: live.fused.shows, "radar over camera")
    walk.save("live-fused")
    assert collect.outcome is not None
    if collect.outcome.state != "finished":
        raise PolfuseError(collect.outcome.reason, where="tour", advice="mend that, then walk again")
    window.show_page("collect")
    walk.save("collected")
    _after(walk, collect)
    window.show_page("settings")
    walk.save("settings")


def _after(walk: _Walk, collect: CollectPage) -> None:
    window = walk.window
    session, products = window.page("session"), window.page("products")
    assert isinstance(session, SessionPage)
    assert isinstance(products, ProductsPage)
    collect.look_button.click()
    walk.until(lambda: session.predicted, "a prediction")
    walk.save("session")
    session.optics_button.click()
    walk.until(lambda: not window.bench.jobs.busy, "the polarization pictures")
    window.show_page("session")
    session.focus_button.click()
    walk.until(lambda: window.current == "products" and bool(products.views), "the focused picture")
    walk.save("products")
    products.choose("focus.HH", "optics.dolp")
    walk.until(lambda: len(products.views) == 2, "two pictures")
    walk.save("products-two")
