"""The window: pages on the left, the page in the middle, what must always be seen below."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import QByteArray, QSize, Qt
from PySide6.QtGui import QCloseEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import (
    QHBoxLayout,
    QListWidget,
    QListWidgetItem,
    QMainWindow,
    QScrollArea,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from gui.pages.calibrate_page import CalibratePage
from gui.pages.collect_page import CollectPage
from gui.pages.compare_page import ComparePage
from gui.pages.live_page import LivePage
from gui.pages.products_page import ProductsPage
from gui.pages.regions_page import RegionsPage
from gui.pages.session_page import SessionPage
from gui.pages.settings_page import SettingsPage
from gui.pages.setup_page import SetupPage
from gui.pages.start_page import StartPage
from gui.widgets.error_bar import ErrorBar
from gui.widgets.keys_panel import Group, KeysPanel, keys_of
from gui.widgets.layout import button
from gui.widgets.status_strip import StatusStrip
from gui.workbench import Workbench
from polfuse_lab import remembered
from polfuse_lab.engine.protocol import Finished, StatusEvent

SMALLEST = QSize(1024, 640)
USUAL = QSize(1366, 768)
STALE_NS = 5_000_000_000


class MainWindow(QMainWindow):
    """One window; closing it ends no collect."""

    def __init__(self, bench: Workbench | None = None) -> None:
        super().__init__()
        self.bench = bench or Workbench(self)
        self.setWindowTitle("PolFuse Lab")
        self.setMinimumSize(SMALLEST)
        self.resize(USUAL)
        self.error_bar = ErrorBar()
        self.strip = StatusStrip()
        self.navigation = QListWidget()
        self.navigation.setObjectName("navigation")
        self.navigation.setFixedWidth(150)
        self.navigation.setAccessibleName(self.tr("pages"))
        self._pages = QStackedWidget()
        self._names: list[str] = []
        self._shortcuts: list[QShortcut] = []
        self.settings_page = SettingsPage()
        self.start_page = StartPage(self.bench)
        for name, text, page in (
            ("start", self.tr("Start"), self.start_page),
            ("setup", self.tr("Set-up"), SetupPage(self.bench)),
            ("collect", self.tr("Collect"), CollectPage(self.bench)),
            ("live", self.tr("Live"), LivePage(self.bench)),
            ("session", self.tr("Session"), SessionPage(self.bench)),
            ("products", self.tr("Products"), ProductsPage(self.bench)),
            ("calibrate", self.tr("Calibrate"), CalibratePage(self.bench)),
            ("compare", self.tr("Compare"), ComparePage(self.bench)),
            ("regions", self.tr("Regions"), RegionsPage(self.bench)),
            ("settings", self.tr("Settings"), self.settings_page),
        ):
            self._add(name, text, page)
        middle = QVBoxLayout()
        middle.setContentsMargins(0, 0, 0, 0)
        middle.setSpacing(0)
        middle.addWidget(self.error_bar)
        middle.addWidget(self._pages, 1)
        row = QHBoxLayout()
        row.setContentsMargins(0, 0, 0, 0)
        row.setSpacing(0)
        self.keys_button = button(self.tr("Keys"), self._keys, self.tr("Which keys do what"), key="F1")
        left = QVBoxLayout()
        left.setContentsMargins(0, 0, 0, 4)
        left.addWidget(self.navigation, 1)
        left.addWidget(self.keys_button)
        row.addLayout(left)
        row.addLayout(middle, 1)
        whole = QWidget()
        column = QVBoxLayout(whole)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(0)
        column.addLayout(row, 1)
        column.addWidget(self.strip)
        self.setCentralWidget(whole)
        self.keys_panel = KeysPanel(self._pages, whole)
        self.navigation.currentRowChanged.connect(self._turn)
        self.bench.page_wanted.connect(self.show_page)
        self.bench.error.connect(self.error_bar.tell)
        self.bench.told.connect(self.error_bar.tell_done)
        self.bench.engine.status.connect(self._status)
        self.bench.engine.finished.connect(self._finished)
        self.bench.live.tick.connect(self._sync)
        self.bench.engine.failed.connect(lambda *_: self.strip.show_idle(self.tr("The collect did not go on")))
        self.navigation.setCurrentRow(0)
        self._restore()

    def page(self, name: str) -> QWidget:
        """A page by its name."""
        scroll = self._pages.widget(self._names.index(name))
        assert isinstance(scroll, QScrollArea)
        page = scroll.widget()
        assert page is not None
        return page

    @property
    def current(self) -> str:
        """Name of the page that is shown."""
        return self._names[self._pages.currentIndex()]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the pages, in their order."""
        return tuple(self._names)

    def show_page(self, name: str) -> None:
        """Turn to a page."""
        self.navigation.setCurrentRow(self._names.index(name))

    def keys(self) -> list[Group]:
        """Which keys do what: everywhere, then on each page that has keys of its own, in the pages' order."""
        everywhere = [*keys_of(self._shortcuts), *keys_of(self.keys_button.findChildren(QShortcut))]
        groups: list[Group] = [(self.tr("Everywhere"), everywhere)]
        for number, name in enumerate(self._names):
            here = keys_of(self.page(name).findChildren(QShortcut))
            if here:
                groups.append((self.navigation.item(number).text(), here))
        return groups

    def open(self, path: Path) -> None:
        """Begin with a rig, a session or a products file."""
        if path.suffix == ".toml":
            self.bench.use_rig(path)
            self.show_page("setup")
        else:
            self.start_page.open_file(path)

    def closeEvent(self, event: QCloseEvent) -> None:  # noqa: N802 - Qt's name
        """Remember the window; leave what runs elsewhere alone."""
        settings = remembered.Settings.load()
        settings.set("window", bytes(self.saveGeometry().toBase64().data()).decode("ascii"))
        settings.save()
        self._each("close_down")
        self.bench.close()
        event.accept()

    def _add(self, name: str, text: str, page: QWidget) -> None:
        number = (len(self._names) + 1) % 10  # the tenth page is at 0, as on the keyboard
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setWidget(page)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAsNeeded)
        self._pages.addWidget(scroll)
        self._names.append(name)
        item = QListWidgetItem(text)
        item.setToolTip(self.tr("{0} (Ctrl+{1})").format(text, number))
        item.setSizeHint(QSize(0, round(self.fontMetrics().height() * 2.1)))
        self.navigation.addItem(item)
        shortcut = QShortcut(QKeySequence(f"Ctrl+{number}"), self)
        shortcut.activated.connect(lambda: self.show_page(name))
        shortcut.setWhatsThis(text)
        self._shortcuts.append(shortcut)

    def _keys(self) -> None:
        if self.keys_panel.isVisible():
            self.keys_panel.hide()
        else:
            self.keys_panel.show_keys(self.keys())

    def _turn(self, row: int) -> None:
        before = self.page(self.current)
        self._pages.setCurrentIndex(row)
        _call(before, "hidden")
        _call(self.page(self.current), "shown")

    def _each(self, method: str) -> None:
        for name in self._names:
            _call(self.page(name), method)

    def _status(self, status: StatusEvent) -> None:
        self.strip.show_status(status)

    def _sync(self) -> None:
        found = self.bench.live.glance("levels")
        if found is None:
            return
        played = self.bench.engine.replaying and self.bench.engine.busy
        if not played and time.monotonic_ns() - found.t_sample_ns > STALE_NS:
            self.strip.show_sync("", True)
            return
        period_s = float(found.values["period_s"])
        if int(found.values["sync_channel"]) < 0:
            self.strip.show_sync(self.tr("no sync"), False)
        else:
            self.strip.show_sync(self.tr("sync every {0:.1f} ms").format(period_s * 1e3), True)

    def _finished(self, outcome: Finished) -> None:
        words = self.tr("The replay: {0}") if self.bench.engine.replaying else self.tr("The last collect: {0}")
        words = words.format(outcome.state)
        # That it was aborted by the user is known to the user.
        self.strip.show_idle(f"{words} ({outcome.reason})" if outcome.state == "failed" else words)

    def _restore(self) -> None:
        kept = remembered.Settings.load().get("window", "")
        if kept:
            self.restoreGeometry(QByteArray.fromBase64(str(kept).encode("ascii")))


def _call(page: QWidget, method: str) -> None:
    found: Callable[[], None] | None = getattr(page, method, None)
    if found is not None:
        found()
