"""The list of keys: whole, told in words, and in nobody's way."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QApplication, QWidget

from gui.main_window import MainWindow
from gui.widgets.keys_panel import KeysPanel, keys_of


def test_all_keys_are_told_and_none_twice_where_it_would_matter(window: MainWindow) -> None:
    groups = dict(window.keys())
    everywhere = dict(groups.pop("Everywhere"))
    assert everywhere["Ctrl+1"] == "Start"
    assert everywhere["Ctrl+0"] == "Settings"
    assert everywhere["F1"] == "Keys"
    assert dict(groups["Collect"])["F5"] == "Start the collect"
    assert dict(groups["Set-up"])["Esc"] == "Stop"
    # A clicker's forward button is Page Down.
    assert ("Return, Enter, PgDown", "What was asked is done") in groups["Collect"]
    told = 0
    for page, pairs in (("", list(everywhere.items())), *groups.items()):
        keys = [key for pair in pairs for key in pair[0].split(", ")]
        assert len(set(keys)) == len(keys), page
        assert all(len(what) > 2 for _, what in pairs), page
        assert page == "" or not set(keys) & set(everywhere), page
        told += len(keys)
    assert told == len(window.findChildren(QShortcut))


def test_the_list_comes_and_goes_by_f1_and_takes_no_key_away(qtbot, window: MainWindow, qapp: QApplication) -> None:
    window.activateWindow()
    with qtbot.waitActive(window):
        window.activateWindow()
    window.show_page("setup")
    focus = qapp.focusWidget()
    panel = window.keys_panel
    assert not panel.isVisible()
    qtbot.keyClick(window, Qt.Key.Key_F1)
    assert panel.isVisible()
    assert not panel.isWindow()
    assert qapp.focusWidget() is focus
    assert "<b>F5</b>" in panel.words.text()
    # Esc is the page's (there it stops the trolley, once there is one), and pages are turned as ever.
    stop = QShortcut(QKeySequence("Esc"), window.page("setup"))
    with qtbot.waitSignal(stop.activated):
        qtbot.keyClick(window, Qt.Key.Key_Escape)
    qtbot.keyClick(window, Qt.Key.Key_3, Qt.KeyboardModifier.ControlModifier)
    assert window.current == "collect"
    assert panel.isVisible()
    # It stays beside the navigation and above the strip, whatever the window's size.
    window.resize(1024, 640)
    qtbot.waitUntil(lambda: panel.geometry().right() < 1024)
    assert panel.geometry().left() >= window.navigation.width()
    assert panel.geometry().bottom() < window.strip.mapTo(window, window.strip.rect().topLeft()).y()
    qtbot.keyClick(window, Qt.Key.Key_F1)
    assert not panel.isVisible()


def test_what_a_key_does_is_escaped_and_a_narrow_place_is_filled(qtbot) -> None:
    whole = QWidget()
    qtbot.addWidget(whole)
    over = QWidget(whole)
    over.setGeometry(10, 20, 200, 300)
    panel = KeysPanel(over, whole)
    panel.show_keys([("A & B", [("F2", "<i>"), ("F3", "x < y")]), ("nothing", [])])
    assert "A &amp; B" in panel.words.text()
    assert "&lt;i&gt;" in panel.words.text()
    assert "nothing" not in panel.words.text()
    assert panel.geometry().getRect() == (22, 32, 176, 276)  # 12 pixels inside
    qtbot.mouseClick(panel.close_button, Qt.MouseButton.LeftButton)
    assert panel.isHidden()
    assert keys_of([]) == []
