"""Two sessions, or products, side by side: one cursor, one view of the ground, and what they differ in."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QComboBox,
    QFileDialog,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QSplitter,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from gui.models import background
from gui.models.comparison import Side, differences, side_of
from gui.models.cursor import LinkedCursor
from gui.widgets.layout import button, card, dim, heading, title
from gui.widgets.picture_view import PictureView
from gui.widgets.pictured import view_of
from gui.workbench import Workbench
from polfuse_lab import remembered
from polfuse_lab.products.pictures import Picture, load_picture
from polfuse_lab.products.store import Products

NAMES = ("left", "right")


class ComparePage(QWidget):
    """Choose a file for each side; choosing a picture on one side chooses it on the other, where it is there."""

    def __init__(self, bench: Workbench, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bench = bench
        self.sides: list[Side | None] = [None, None]
        self.views: list[PictureView | None] = [None, None]
        self._values: list[tuple[str, float] | None] = [None, None]
        self.linked = LinkedCursor(self)
        self._camera = LinkedCursor(self)  # places in the camera's picture are none on the ground
        for cursor in (self.linked, self._camera):
            cursor.moved.connect(self._tell)
        self.files = [QComboBox() for _ in NAMES]
        self.pictures = [QComboBox() for _ in NAMES]
        self.places = [QVBoxLayout() for _ in NAMES]
        parts = QSplitter(Qt.Orientation.Horizontal)
        for number, name in enumerate((self.tr("left"), self.tr("right"))):
            self.files[number].setAccessibleName(self.tr("file, {0}").format(name))
            self.files[number].setMinimumContentsLength(14)
            self.files[number].activated.connect(partial(self._recent, number))
            self.pictures[number].setAccessibleName(self.tr("picture, {0}").format(name))
            self.pictures[number].activated.connect(partial(self._chosen, number))
            choose = QHBoxLayout()
            choose.addWidget(self.files[number], 3)
            choose.addWidget(button(self.tr("Open…"), partial(self._browse, number)))
            choose.addWidget(self.pictures[number], 2)
            side = QWidget()
            inside = QVBoxLayout(side)
            inside.setContentsMargins(0, 0, 0, 0)
            inside.addLayout(choose)
            inside.addLayout(self.places[number], 1)
            self.places[number].addWidget(dim(self.tr("Choose a session or products")))
            parts.addWidget(side)
        self.readout = QLabel(" ")
        self.readout.setProperty("role", "heading")
        self.table = QTableWidget(0, 3)
        self.table.setHorizontalHeaderLabels([self.tr("what differs"), self.tr("left"), self.tr("right")])
        self.table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        self.table.verticalHeader().hide()
        self.table.setMaximumHeight(170)
        column = QVBoxLayout(self)
        column.setContentsMargins(16, 16, 16, 12)
        column.addWidget(title(self.tr("Compare")))
        column.addWidget(parts, 1)
        column.addWidget(self.readout)
        column.addWidget(card(heading(self.tr("What they differ in")), self.table))
        bench.products_opened.connect(self._opened)

    def shown(self) -> None:
        """The page has come to the front."""
        for number, files in enumerate(self.files):
            side = self.sides[number]
            files.clear()
            known = [recent.path for recent in remembered.recent_sessions() if recent.exists]
            paths = list(dict.fromkeys([*([side.path] if side is not None else []), *map(Path, known)]))
            files.addItem(self.tr("choose…"), None)
            for path in paths:
                files.addItem(path.name, str(path))
                files.setItemData(files.count() - 1, str(path), Qt.ItemDataRole.ToolTipRole)
            files.setCurrentIndex(0 if side is None else files.findData(str(side.path)))

    def open(self, number: int, path: Path) -> None:
        """Put a session or products on one side (0: left, 1: right)."""
        background.run(self, lambda: side_of(path), partial(self._looked, number), self._bench.error.emit)

    def choose(self, number: int, name: str) -> None:
        """Choose a picture of one side by its name; the other side keeps its own."""
        row = self.pictures[number].findData(name)
        if row >= 0:
            self.pictures[number].setCurrentIndex(row)
            self._load(number)

    def shows(self, number: int, title: str) -> bool:
        """Whether a side shows the picture of that title."""
        view = self.views[number]
        return view is not None and view.quantity.name == title

    def _opened(self, path: Path) -> None:
        """What was opened last is on the left until something else is chosen there."""
        if self.sides[0] is None:
            self.open(0, path)

    def _recent(self, number: int, row: int) -> None:
        path = self.files[number].itemData(row)
        if path is not None:
            self.open(number, Path(path))

    def _browse(self, number: int) -> None:
        name, _ = QFileDialog.getOpenFileName(self, self.tr("Open a session or products"), "", "HDF5 (*.h5)")
        if name:
            self.open(number, Path(name))

    def _looked(self, number: int, side: Side) -> None:
        self.sides[number] = side
        self.shown()
        pictures = self.pictures[number]
        pictures.clear()
        for name, text in side.pictures:
            pictures.addItem(text, name)
        other = self.pictures[1 - number].currentData()
        if side.products is None:
            self._place(number, dim(self.tr("has no pictures yet: focus it on the session page")))
        else:
            pictures.setCurrentIndex(max(pictures.findData(other), 0))
            self._load(number)
        left, right = self.sides
        rows = differences(left, right) if left is not None and right is not None else []
        self.table.setRowCount(len(rows))
        for row, cells in enumerate(rows):
            for column, text in enumerate(cells):
                self.table.setItem(row, column, QTableWidgetItem(text))

    def _chosen(self, number: int, row: int) -> None:
        self._load(number)
        same = self.pictures[1 - number].findData(self.pictures[number].itemData(row))
        if same >= 0 and same != self.pictures[1 - number].currentIndex():
            self.pictures[1 - number].setCurrentIndex(same)
            self._load(1 - number)

    def _load(self, number: int) -> None:
        side, name = self.sides[number], self.pictures[number].currentData()
        if side is None or side.products is None or name is None:
            return
        path = side.products
        background.run(
            self, lambda: load_picture(Products(path), name), partial(self._show, number), self._bench.error.emit
        )

    def _show(self, number: int, picture: Picture) -> None:
        view = view_of(picture)
        view.follow(self.linked if view.ground else self._camera)
        self._place(number, view)
        self.views[number] = view
        left, right = self.views
        if left is not None and right is not None and left.ground == right.ground:
            right.item.setXLink(left.item)
            right.item.setYLink(left.item)

    def _place(self, number: int, widget: QWidget) -> None:
        self.views[number] = None
        while (item := self.places[number].takeAt(0)) is not None:
            if (before := item.widget()) is not None:
                before.setParent(None)
                before.deleteLater()
        self.places[number].addWidget(widget, 1)

    def _tell(self, place: tuple[float, float] | None) -> None:
        left, right = self.views
        if place is None or left is None or right is None or left.ground != right.ground:
            self.readout.setText(" ")
            return
        one, other = left.value_at(*place), right.value_at(*place)
        unit = left.quantity.unit
        if one is None or other is None or unit != right.quantity.unit:
            self.readout.setText(" ")
            return
        digits = left.quantity.digits
        self.readout.setText(
            self.tr("left {0:.{d}f} {u}, right {1:.{d}f} {u}: right minus left {2:+.{d}f} {v}").format(
                one, other, other - one, d=digits, u=unit, v="dB" if unit.startswith("dB") else unit
            )
        )
