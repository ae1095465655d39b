"""The first page: a rig, a session, or a simulated rig to try the program with."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path

from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QLabel, QListWidget, QListWidgetItem, QVBoxLayout, QWidget

import polfuse_lab.demo
from gui.models import background
from gui.models.simulator import Simulator
from gui.models.words import place
from gui.widgets.layout import button, card, dim, heading, title
from gui.workbench import Workbench
from polfuse_lab import remembered
from polfuse_lab.engine import EngineInfo, engines

SCENE = Path(polfuse_lab.demo.__file__).with_name("scene.toml")


class StartPage(QWidget):
    """Recent rigs and sessions, running collects, and the simulated rig in one click."""

    def __init__(self, bench: Workbench, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bench = bench
        self.simulator = Simulator(SCENE, self)
        self.simulator.ready.connect(self._simulated)
        self.simulator.failed.connect(bench.error)
        self.try_button = button(
            self.tr("Try it with a simulated rig"),
            self.try_simulated,
            self.tr("Starts switches, trolley, radar, polarizer and camera that all look at one made-up scene"),
            role="primary",
        )
        self.rigs = self._list(self._open_rig)
        self.sessions = self._list(self._open_session)
        self.running = QVBoxLayout()
        left = card(
            heading(self.tr("Rigs")),
            self.rigs,
            button(self.tr("Open a rig file…"), self._choose_rig, self.tr("A rig file says which devices there are")),
            button(self.tr("Write example files…"), self._write_examples, self.tr("A commented rig and its plans")),
            stretch=1,
        )
        right = card(
            heading(self.tr("Sessions and products")),
            self.sessions,
            button(self.tr("Open a session or products…"), self._choose_session, key="Ctrl+O"),
            stretch=1,
        )
        lists = QHBoxLayout()
        lists.addWidget(left)
        lists.addWidget(right)
        column = QVBoxLayout(self)
        column.setContentsMargins(24, 20, 24, 16)
        column.setSpacing(12)
        column.addWidget(title(self.tr("PolFuse Lab")))
        column.addWidget(dim(self.tr("Radar on a rail and a polarization camera, looking at the same scene.")))
        column.addLayout(self.running)
        first = QHBoxLayout()
        first.addWidget(self.try_button)
        first.addStretch(1)
        column.addLayout(first)
        column.addLayout(lists, 1)
        self.refresh()

    def refresh(self) -> None:
        """Look again for recent files and running collects."""
        _fill(self.rigs, remembered.recent_rigs(), self.tr("none yet: open one, or try the simulated rig"))
        _fill(self.sessions, remembered.recent_sessions(), self.tr("none yet: collect one"))
        background.run(self, engines, self._show_running, lambda *_: None)

    def try_simulated(self) -> None:
        """Start the simulated rig and go to its set-up."""
        self.try_button.setEnabled(False)
        self.try_button.setText(self.tr("Starting…"))
        self.simulator.start()

    def shown(self) -> None:
        """The page has come to the front."""
        self.refresh()

    def close_down(self) -> None:
        """The window closes."""
        self.simulator.stop()

    def _simulated(self, rig: Path) -> None:
        self.try_button.setEnabled(True)
        self.try_button.setText(self.tr("Try it with a simulated rig"))
        self._bench.simulated = rig
        self._bench.use_rig(rig)
        self._bench.page_wanted.emit("setup")

    def _show_running(self, found: list[EngineInfo]) -> None:
        while (item := self.running.takeAt(0)) is not None:
            if (widget := item.widget()) is not None:
                widget.deleteLater()
        for engine in found:
            if engine.mode != "collect" or (
                (client := self._bench.engine.client) is not None and client.pid == engine.pid
            ):
                continue
            words = self.tr("A collect is running: {0} with {1}, into {2}").format(
                engine.plan_name, engine.rig_name, Path(engine.output).name
            )
            row = QHBoxLayout()
            row.addWidget(QLabel(words), 1)
            row.addWidget(button(self.tr("Watch it"), partial(self._attach, engine.directory), role="primary"))
            self.running.addWidget(card(row))

    def _attach(self, directory: Path) -> None:
        self._bench.engine.attach(directory)
        self._bench.page_wanted.emit("collect")

    def _list(self, opened: object) -> QListWidget:
        made = QListWidget()
        made.itemActivated.connect(opened)
        made.itemClicked.connect(opened)
        made.setAlternatingRowColors(False)
        return made

    def _open_rig(self, item: QListWidgetItem) -> None:
        path = item.data(Qt.ItemDataRole.UserRole)
        if path is not None:
            self._use_rig(Path(path))

    def _open_session(self, item: QListWidgetItem) -> None:
        path = item.data(Qt.ItemDataRole.UserRole)
        if path is not None:
            self.open_file(Path(path))

    def _choose_rig(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self, self.tr("Open a rig file"), "", self.tr("Rig files (*.toml)"))
        if name:
            self._use_rig(Path(name))

    def _use_rig(self, path: Path) -> None:
        remembered.remember_rig(path)
        self._bench.use_rig(path)
        self._bench.page_wanted.emit("setup")

    def _choose_session(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self, self.tr("Open a session or products"), "", "HDF5 (*.h5)")
        if name:
            self.open_file(Path(name))

    def open_file(self, path: Path) -> None:
        """Open a session, or products, whichever the file is."""
        from polfuse_lab.products.store import is_products

        if is_products(path):
            self._bench.open_products(path)
            self._bench.page_wanted.emit("products")
        else:
            remembered.remember_session(path)
            self._bench.open_session(path)
            self._bench.page_wanted.emit("session")

    def _write_examples(self) -> None:
        from polfuse_lab.rig.examples import write_examples

        folder = QFileDialog.getExistingDirectory(self, self.tr("Where to write the example files"))
        if not folder:
            return
        background.run(
            self, lambda: write_examples(folder), lambda made: self._use_rig(made["rig"]), self._bench.error.emit
        )


def _fill(view: QListWidget, found: list[remembered.Recent], nothing: str) -> None:
    view.clear()
    for recent in found:
        when = time.strftime("%Y-%m-%d %H:%M", time.localtime(recent.opened_unix_s))
        item = QListWidgetItem(f"{recent.name}\n{place(Path(recent.path).parent)}   {when}")
        item.setData(Qt.ItemDataRole.UserRole, str(recent.path) if recent.exists else None)
        if not recent.exists:
            item.setFlags(Qt.ItemFlag.NoItemFlags)
            gone = QCoreApplication.translate("StartPage", "not there any more")
            item.setText(f"{recent.name}\n{place(Path(recent.path).parent)}   {gone}")
        view.addItem(item)
    if not found:
        item = QListWidgetItem(nothing)
        item.setFlags(Qt.ItemFlag.NoItemFlags)
        view.addItem(item)
