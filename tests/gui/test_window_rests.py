"""What keeps the window from being held up: garbage, first pictures, colour bars."""

from __future__ import annotations

import gc
import threading
import weakref
from pathlib import Path

import numpy as np
import pytest
from PySide6.QtCore import QCoreApplication, QObject

from gui import maps
from gui.garbage import Garbage
from gui.pages.live_page import PIXELS_A_TICK, LivePage
from gui.widgets.picture_view import PictureView, demo_image
from gui.widgets.plots import SIDES
from gui.widgets.turns import TURNS
from polfuse_lab.live import Board, LiveView


class Knot:
    """Reachable from nothing but itself."""

    def __init__(self) -> None:
        self.own = self


def test_garbage_is_never_destroyed_by_a_thread_of_the_background(qtbot) -> None:
    before = gc.get_threshold()
    owner = QObject()
    garbage = Garbage(owner)
    try:
        knot = weakref.ref(Knot())
        # Far more allocations than Python's thresholds: it would have looked, in that thread.
        thread = threading.Thread(target=lambda: [[number] for number in range(100_000)])
        thread.start()
        thread.join()
        assert knot() is not None
        kept = [[number] for number in range(before[0] + 100)]
        garbage.look()
        assert knot() is None
        assert len(kept) > before[0]
    finally:
        garbage.end()
    assert gc.isenabled()


def test_what_is_there_to_stay_is_not_looked_at(qtbot) -> None:
    kept = [[number] for number in range(1000)]
    owner = QObject()
    garbage = Garbage(owner)
    try:
        assert gc.get_freeze_count() > len(kept)
        assert len(gc.get_objects()) < 1000  # all that a whole look would go through
    finally:
        garbage.end()


@pytest.mark.parametrize(
    ("now", "expected"),
    # 3 % of a span of 100 are 3.
    [((2.9, 97.1), (0.0, 100.0)), ((3.1, 100.0), (3.1, 100.0)), ((0.0, 103.1), (0.0, 103.1))],
)
def test_limits_follow_when_they_are_out_by_more_than_their_share(
    now: tuple[float, float], expected: tuple[float, float]
) -> None:
    assert maps.settled(now, (0.0, 100.0)) == expected
    assert maps.settled(now, None) == now


def test_a_bar_tells_the_limits_that_the_picture_has(qtbot) -> None:
    from gui.pages.live_page import LEVEL

    view = PictureView(LEVEL)
    qtbot.addWidget(view)
    values = np.linspace(-60, 0, 10_000, dtype=np.float32).reshape(100, 100)
    view.show_values(values)
    first = view.bar.levels()
    view.show_values(values + np.float32(0.5))
    assert view.bar.levels() == tuple(view.image.levels) == first
    view.show_values(values + np.float32(20.0))
    assert view.bar.levels() == tuple(view.image.levels) == pytest.approx(np.add(first, 20.0), abs=0.01)
    view.bar.setLevels((-10.0, 10.0))
    view.bar.sigLevelsChanged.emit(view.bar)
    view.automatic_levels()
    assert view.bar.levels() == tuple(view.image.levels) != (-10.0, 10.0)


def test_axes_do_not_move_when_their_numbers_come(qtbot) -> None:
    from gui.pages.live_page import LEVEL

    view = PictureView(LEVEL)
    qtbot.addWidget(view)
    with qtbot.waitExposed(view):
        view.show()

    def rooms() -> list[float]:
        bottom, left = (view.item.getAxis(side) for side in SIDES)
        return [bottom.height(), left.width()]

    empty = rooms()
    view.show_values(*demo_image())
    qtbot.wait(30)
    assert rooms() == empty


def test_a_tick_draws_one_new_picture_and_afterwards_no_more_than_it_has_time_for(window, tmp_path: Path) -> None:
    page = window.page("live")
    assert isinstance(page, LivePage)
    window.show_page("live")
    page.show_tab("sar")
    level_db, x_m, y_m = demo_image(300)
    assert 2 * level_db.size <= PIXELS_A_TICK < 3 * level_db.size
    board = Board(tmp_path)

    def put() -> None:
        arrays = {"x_m": x_m, "y_m": y_m, "level_db": np.stack([level_db] * 4)}
        values = {"channels": list(page.sar), "low_db": -40.0, "high_db": 0.0}
        board.put("sar", arrays, t_sample_ns=1, values=values)

    def ticks() -> list[list[str]]:
        """What is drawn in each tick until nothing is."""
        found: list[list[str]] = []
        while not found or found[-1]:
            before = {channel: view.image.image for channel, view in page.sar.items()}
            while TURNS.busy:
                QCoreApplication.processEvents()
            page.link.tick.emit()
            found.append([channel for channel, view in page.sar.items() if view.image.image is not before[channel]])
        return found[:-1]

    put()
    page.link.open(LiveView(tmp_path))
    try:
        page.link._timer.stop()  # ticks come from here
        assert ticks() == [["HH"], ["HV"], ["VH"], ["VV"]]
        put()
        assert ticks() == [["HH", "HV"], ["VH", "VV"]]
    finally:
        page.link.close()
        board.close()
