"""Walks every page with the simulated rig and saves a picture of each: for the documentation, and to look at."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from PySide6.QtCore import QCoreApplication, QEventLoop
from PySide6.QtGui import QImage

from gui.app import make_application
from gui.main_window import MainWindow
from gui.pages.calibrate_page import CalibratePage
from gui.pages.collect_page import CollectPage
from gui.pages.compare_page import ComparePage
from gui.pages.live_page import LivePage
from gui.pages.products_page import ProductsPage
from gui.pages.regions_page import RegionsPage
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
LONGEST_S = 240.0


def tour(folder: Path) -> list[dict[str, str]]:
    """Save a picture of each page; a session is collected, played and focused on the way.

    Returns:
        ``name`` and ``file`` of each.

    Raises:
        PolfuseError: something did not come to its end in time, or told of an error.
    """
    folder = folder.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="polfuse-tour-") as scratch, _a_new_user(Path(scratch)):
        make_application()
        window = MainWindow()
        walk = _Walk(window, folder)
        try:
            window.show()
            _steps(walk)
        finally:
            window.close()
            QCoreApplication.processEvents()
    return walk.pages


@contextmanager
def _a_new_user(home: Path) -> Iterator[None]:
    """Pictures show neither the folders nor the settings of whoever makes them."""
    import matplotlib

    # Otherwise each process would look at every font of the computer first.
    new = {"HOME": str(home), "MPLCONFIGDIR": matplotlib.get_cachedir(), "POLFUSE_USER_DATA": str(home / ".polfuse")}
    before = {name: os.environ.get(name) for name in new}
    os.environ |= new
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _saved(window: MainWindow, path: Path) -> bool:
    """Save a picture in 256 colours, which is a third of the size."""
    from PIL import Image

    picture = window.grab().toImage().convertToFormat(QImage.Format.Format_RGB888)
    rows = np.frombuffer(picture.constBits(), np.uint8).reshape(picture.height(), picture.bytesPerLine())
    colours = rows[:, : 3 * picture.width()].reshape(picture.height(), picture.width(), 3)
    try:
        Image.fromarray(colours).quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
    except OSError:
        return False
    return True


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
        if not _saved(self.window, path):
            raise PolfuseError("cannot be written", where=str(path), advice="choose a folder that may be written")
        self.pages.append({"name": name, "file": str(path)})


def _steps(walk: _Walk) -> None:
    window = walk.window
    setup, collect, live = window.page("setup"), window.page("collect"), window.page("live")
    assert isinstance(setup, SetupPage)
    assert isinstance(collect, CollectPage)
    assert isinstance(live, LivePage)
    window.start_page.try_button.click()
    walk.until(lambda: _ready(setup), "that every device is ready")
    walk.until(lambda: setup.seen, "that signals and picture are seen")
    walk.rest(2.0)
    walk.save("setup")
    window.show_page("live")
    live.show_tab("speeds")
    walk.until(lambda: live.doppler.shows, "that speeds are seen")
    walk.rest(1.0)
    walk.save("live-speeds")
    window.show_page("collect")
    collect.text.setPlainText(PLAN)
    collect.output.setText("~/polfuse-sessions/field.h5")
    walk.until(lambda: collect.start_button.isEnabled(), "that the plan is judged")
    walk.save("plan")
    collect.start_button.click()
    walk.until(lambda: collect.done_share > 0.25, "a quarter of the collect")
    walk.save("collect")
    window.show_page("live")
    live.show_tab("ranges")
    walk.rest(1.0)
    walk.save("live-ranges")
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
    collect.look_button.click()
    _after(walk)
    window.show_page("settings")
    walk.save("settings")
    window.show_page("start")
    walk.save("start")


def _ready(setup: SetupPage) -> bool:
    """Whether every device can be used; one that did not open in time, on a busy computer, is tried again."""
    for card in setup.cards.values():
        if card.light == "bad":
            card.retry_button.click()
    return setup.all_ready


def _after(walk: _Walk) -> None:
    """Everything that is made of the session that is open."""
    window = walk.window
    session, products, live = window.page("session"), window.page("products"), window.page("live")
    assert isinstance(live, LivePage)
    assert isinstance(session, SessionPage)
    assert isinstance(products, ProductsPage)
    walk.until(lambda: session.predicted, "a prediction")
    walk.save("session")
    session.optics_button.click()
    walk.until(lambda: window.current == "products" and products.holds("optics.dolp"), "the polarization pictures")
    window.show_page("session")
    session.focus_button.click()
    walk.until(lambda: products.shown_names == ["focus.HH"], "the focused picture")
    walk.save("products")
    _calibrate(walk)
    window.show_page("products")
    products.fuse()
    walk.until(lambda: not window.bench.jobs.busy and products.holds("fusion.classes"), "fused products")
    products.choose("polarimetry.pauli")
    walk.until(lambda: products.shown_names == ["polarimetry.pauli"], "the Pauli picture")
    walk.save("products-pauli")
    products.choose("focus.HH", "optics.dolp")
    walk.until(lambda: len(products.views) == 2, "two pictures")
    products.linked.move((1.2, 8.9))
    walk.save("products-two")
    products.choose("fusion.colours", "fusion.space")
    walk.until(lambda: sorted(products.shown_names) == ["fusion.colours", "fusion.space"], "fused colours")
    products.linked.move((1.2, 8.9))
    walk.save("products-fused")
    _regions_and_comparison(walk, session)
    window.show_page("session")
    session.speed.setValue(4.0)
    session.replay_button.click()
    walk.until(lambda: live.replay.isVisible() and live.replay.line.value() > 40, "a replay")
    live.show_tab("sar")
    walk.until(lambda: live.pauli.shows, "the replay's picture")
    walk.save("live-replay")
    window.bench.engine.abort()
    walk.until(lambda: not window.bench.engine.busy, "the end of the replay")


def _calibrate(walk: _Walk) -> None:
    """On the simulated scene's trihedral, with its dihedral to check the outcome."""
    window = walk.window
    page = window.page("calibrate")
    assert isinstance(page, CalibratePage)
    window.show_page("calibrate")
    walk.until(lambda: page.view.shows, "the focused picture")
    for role, kind, x_m, y_m, height_m in (
        ("constant", "trihedral", 1.2, 8.6, 0.469),
        ("check", "dihedral", -1.8, 11.2, 0.319),
    ):
        page.role.setCurrentIndex(page.role.findData(role))
        page.kind.setCurrentText(kind)
        page.view.clicked.emit((x_m, y_m))
        page.height_m.setValue(height_m)
        page.look_button.click()
    page.role.setCurrentIndex(page.role.findData("crosstalk"))
    page.view.clicked.emit((4.5, 16.5))
    page.look_button.click()
    walk.until(lambda: page.targets.ready, "targets that are found")
    page.calibrate_button.click()
    walk.until(lambda: bool(page.outcome.toPlainText()), "the calibration")
    walk.save("calibrate")


def _regions_and_comparison(walk: _Walk, session: SessionPage) -> None:
    window = walk.window
    regions, compare = window.page("regions"), window.page("compare")
    assert isinstance(regions, RegionsPage)
    assert isinstance(compare, ComparePage)
    window.show_page("regions")
    walk.until(lambda: regions.new_button.isEnabled() and regions.view.shows, "a picture to draw on")
    for x_m, y_m in ((1.2, 9.0), (-1.8, 11.6)):
        corners = ((x_m - 0.8, y_m - 1), (x_m + 0.8, y_m - 1), (x_m + 0.8, y_m + 1), (x_m - 0.8, y_m + 1))
        regions.regions.add(corners)
    walk.until(lambda: regions.pairs.rowCount() > 0, "the regions' statistics")
    walk.save("regions")
    window.show_page("compare")
    compare.open(0, session.products)
    assert window.bench.session is not None
    compare.open(1, window.bench.session)  # its products are beside it
    walk.until(lambda: all(picture.count() for picture in compare.pictures), "both files")
    for number, name in enumerate(("calibration.HH", "calibration.HV")):
        compare.choose(number, name)
    walk.until(lambda: all(compare.shows(n, name) for n, name in enumerate(("Calibrated HH", "Calibrated HV"))),
               "both pictures")  # fmt: skip
    compare.linked.move((1.2, 8.9))
    walk.save("compare")
