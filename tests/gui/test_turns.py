"""Costly changes of many plots: one at a time, never for what has gone or is not seen."""

from __future__ import annotations

import gc

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QTabWidget

from gui.widgets.picture_view import PictureView, Quantity, demo_image
from gui.widgets.turns import Turns


def test_one_change_at_a_time_and_once_for_each_owner(qtbot) -> None:
    turns = Turns()
    owners = [QObject() for _ in range(3)]
    made: list[int] = []
    for number, owner in enumerate(owners):
        turns.ask(owner, lambda number=number: made.append(number))
    turns.ask(owners[2], lambda: made.append(99))
    assert made == [0]  # the first at once, the others with the window alive in between
    assert turns.busy
    qtbot.waitUntil(lambda: not turns.busy)
    assert made == [0, 1, 2]


def test_what_has_gone_gets_no_turn(qtbot) -> None:
    turns = Turns()
    first, second, third = QObject(), QObject(), QObject()
    made: list[str] = []
    turns.ask(first, lambda: made.append("first"))
    second.destroyed.connect(lambda: made.append("gone"))
    turns.ask(second, lambda: made.append("second"))
    turns.ask(third, lambda: made.append("third"))
    import shiboken6

    shiboken6.delete(second)
    gc.collect()
    qtbot.waitUntil(lambda: not turns.busy)
    assert made == ["first", "gone", "third"]


def test_a_picture_fills_its_room_whatever_becomes_of_the_window(qtbot) -> None:
    tabs = QTabWidget()
    views = [PictureView(Quantity("level", "dB")) for _ in range(2)]
    for number, view in enumerate(views):
        view.show_values(*demo_image())
        tabs.addTab(view, str(number))
    qtbot.addWidget(tabs)
    tabs.resize(700, 500)
    with qtbot.waitExposed(tabs):
        tabs.show()

    def fills(view: PictureView) -> bool:
        # One side of the picture is as long as its room, less a margin of 2 % at each end (aspect locked).
        (left, right), (bottom, top) = view.item.vb.viewRange()
        box = view._box
        share = max(box.width() / (right - left), box.height() / (top - bottom))
        return view.graph.size() == view._space.size() and 0.93 < share < 1.0

    qtbot.waitUntil(lambda: fills(views[0]))
    assert views[1].graph.isHidden() or not views[1].isVisible()
    tabs.resize(420, 700)
    qtbot.waitUntil(lambda: fills(views[0]))
    tabs.setCurrentIndex(1)
    qtbot.waitUntil(lambda: views[1].graph.isVisible() and fills(views[1]))
    # A part that was chosen with the mouse stays, until everything is asked for.
    views[1].item.vb.setRange(xRange=(-1, 1), yRange=(7, 9), padding=0)
    views[1].item.vb.sigRangeChangedManually.emit([True, True])
    tabs.resize(600, 600)
    qtbot.waitUntil(lambda: views[1].graph.size() == views[1]._space.size())
    assert not fills(views[1])
    views[1].show_everything()
    qtbot.waitUntil(lambda: fills(views[1]))
