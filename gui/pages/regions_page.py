"""Regions drawn by hand on a fused picture: what they are like, and how well they can be told apart."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QComboBox,
    QFileDialog,
    QHBoxLayout,
    QHeaderView,
    QSplitter,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from gui import theme
from gui.models import background
from gui.models.regions import Corners, RegionList
from gui.widgets.layout import button, card, dim, heading, show_place, title, undo_buttons
from gui.widgets.picture_view import PictureView, Quantity
from gui.workbench import Workbench
from polfuse_lab.errors import PolfuseError
from polfuse_lab.products.fused_colours import class_rgb
from polfuse_lab.products.pictures import Picture, load_picture, picture_names
from polfuse_lab.products.region_statistics import RegionReport
from polfuse_lab.products.store import Products

BACKGROUNDS = ("polarimetry.pauli", "fusion.colours", "fusion.classes", "fusion.dolp_on_ground", "fusion.s0_on_ground")
FEATURE_DIGITS = 3
NEVER = 1e-6
"""Smaller bounds of an error say nothing about any region that could be drawn."""


class RegionsPage(QWidget):
    """Draw with "New region", then drag its corners; every change can be undone."""

    def __init__(self, bench: Workbench, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bench = bench
        self.regions = RegionList(self)
        self._shapes: dict[str, pg.PolyLineROI] = {}
        self._names: list[str] = []
        self.where = dim(self.tr("Open products that have been fused"))
        self.background = QComboBox()
        self.background.currentIndexChanged.connect(lambda _: self._load())
        self.view = PictureView(Quantity("", ""), bar=False)
        self.table = QTableWidget(0, 3)
        self.table.setHorizontalHeaderLabels([self.tr("name"), self.tr("pixels"), self.tr("mean of each feature")])
        self.table.horizontalHeader().setStretchLastSection(True)
        self.table.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.table.verticalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.table.verticalHeader().hide()
        self.table.setWordWrap(True)
        self.table.itemChanged.connect(self._renamed)
        self.pairs = QTableWidget(0, 4)
        self.pairs.setHorizontalHeaderLabels(
            [self.tr("pair"), self.tr("B, Pauli"), self.tr("B, Pauli + DOLP"), self.tr("Bayes error")]
        )
        self.pairs.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
        self.pairs.horizontalHeader().setStretchLastSection(True)
        self.pairs.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.pairs.verticalHeader().hide()
        self.words = dim("")
        undo_button, redo_button = undo_buttons(self.regions.undo, self.tr("Undo"), self.tr("Redo"))
        tools = QHBoxLayout()
        self.new_button = button(self.tr("New region"), self.draw, self.tr("In the middle of what is shown"), "primary")
        for made in (
            self.new_button,
            button(self.tr("Remove"), self._remove, self.tr("The region chosen in the table")),
            undo_button,
            redo_button,
            button(self.tr("Open…"), self._open),
            button(self.tr("Save…"), self._save, self.tr("For 'polfuse fuse --regions'")),
        ):
            tools.addWidget(made)
        tools.addStretch(1)
        tools.addWidget(self.background)
        right = card(
            heading(self.tr("Regions")),
            self.table,
            heading(self.tr("How well they can be told apart")),
            self.pairs,
            dim(self.tr("B: Bhattacharyya distance; Bayes error: lower and upper bound with equal priors")),
            self.words,
        )
        parts = QSplitter(Qt.Orientation.Horizontal)
        parts.addWidget(self.view)
        parts.addWidget(right)
        parts.setSizes([640, 460])
        column = QVBoxLayout(self)
        column.setContentsMargins(24, 20, 24, 16)
        top = QHBoxLayout()
        top.addWidget(title(self.tr("Regions")))
        top.addWidget(self.where, 1)
        column.addLayout(top)
        column.addLayout(tools)
        column.addWidget(parts, 1)
        bench.products_opened.connect(self.open)
        bench.products_changed.connect(self._again)
        self.regions.changed.connect(self._redraw)
        self.regions.reported.connect(self._show)
        self.regions.failed.connect(self.words.setText)

    def open(self, path: Path) -> None:
        """Draw on the pictures of a products file."""
        show_place(self.where, path)
        self.regions.look_at(path)
        background.run(self, lambda: picture_names(Products(path)), self._listed, self._bench.error.emit)

    def _again(self) -> None:
        """There may be a fused picture now."""
        if self._bench.products is not None and self.background.count() == 0:
            self.open(self._bench.products)

    def draw(self) -> None:
        """Add a square in the middle of what is shown."""
        (left, right), (bottom, top) = self.view.item.vb.viewRange()
        x, y = (left + right) / 2, (bottom + top) / 2
        half = 0.1 * min(abs(right - left), abs(top - bottom))
        self.regions.add(((x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)))

    def _listed(self, names: list[tuple[str, str]]) -> None:
        titles = dict(names)
        self.background.blockSignals(True)
        self.background.clear()
        for name in BACKGROUNDS:
            if name in titles:
                self.background.addItem(titles[name], name)
        self.background.blockSignals(False)
        self.new_button.setEnabled(self.background.count() > 0)
        self._load()

    def _load(self) -> None:
        path, name = self._bench.products, self.background.currentData()
        if path is not None and name is not None:
            background.run(self, lambda: load_picture(Products(path), name), self._picture, self._bench.error.emit)

    def _picture(self, picture: Picture) -> None:
        self.view.quantity = Quantity(picture.title, picture.unit)
        if picture.kind == "colours":
            self.view.show_colours(picture.values, picture.x, picture.y)
        elif picture.kind == "classes":
            colours = np.nan_to_num(255 * class_rgb(picture.values)).astype(np.uint8)
            self.view.show_colours(colours, picture.x, picture.y)
        else:
            self.view.show_values(picture.values.astype("float32"), picture.x, picture.y, limits=picture.limits)

    # -- shapes and tables --------------------------------------------------------------------------------------------

    def _redraw(self) -> None:
        regions = self.regions.regions
        for name in [name for name in self._shapes if name not in regions]:
            self.view.item.removeItem(self._shapes.pop(name))
        colours = theme.current().curves
        for number, (name, corners) in enumerate(regions.items()):
            pen = pg.mkPen(colours[number % len(colours)], width=2)
            shape = self._shapes.get(name)
            if shape is None:
                shape = self._shapes[name] = pg.PolyLineROI(corners, closed=True, pen=pen)
                shape.sigRegionChangeFinished.connect(lambda _, name=name: self._dragged(name))
                self.view.item.addItem(shape)
            elif _corners(shape) != corners:
                shape.blockSignals(True)
                shape.setPos((0, 0), update=False)
                shape.setPoints(corners)
                shape.blockSignals(False)
            shape.setPen(pen)
        self._names = list(regions)
        self.table.blockSignals(True)
        self.table.setRowCount(len(regions))
        for row, name in enumerate(regions):
            self.table.setItem(row, 0, QTableWidgetItem(name))
            for column in (1, 2):
                self.table.setItem(row, column, _fixed("…"))
        self.table.blockSignals(False)
        self.pairs.setRowCount(0)
        self.words.setText("")

    def _dragged(self, name: str) -> None:
        shape = self._shapes.get(name)
        if shape is not None:
            self.regions.move(name, _corners(shape))

    def _renamed(self, item: QTableWidgetItem) -> None:
        if item.column() == 0 and not self.regions.rename(self._names[item.row()], item.text()):
            self.words.setText(self.tr("each region has a name of its own"))
            self._redraw()

    def _remove(self) -> None:
        row = self.table.currentRow()
        if 0 <= row < len(self._names):
            self.regions.remove(self._names[row])

    def _show(self, report: RegionReport) -> None:
        self.table.blockSignals(True)
        for row, name in enumerate(self._names):
            found = report.regions.get(name)
            if found is not None:
                means = "\n".join(f"{key} {value:.{FEATURE_DIGITS}f}" for key, value in found.mean.items())
                self.table.setItem(row, 1, _fixed(str(found.pixels)))
                self.table.setItem(row, 2, _fixed(means))
        self.table.blockSignals(False)
        self.pairs.setRowCount(len(report.pairs))
        for row, (names, found_pair) in enumerate(report.pairs.items()):
            distance, bounds = found_pair.distance, found_pair.bounds
            cells = (
                names,
                f"{distance['pauli']:.2f}",
                f"{distance['pauli_dolp']:.2f}",
                f"{bounds.lower:.2g} – {bounds.upper:.2g}" if bounds.upper > NEVER else f"< {NEVER:g}",
            )
            for column, text in enumerate(cells):
                self.pairs.setItem(row, column, _fixed(text))
        self.words.setText("; ".join(report.notes))

    def _open(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self, self.tr("Open regions"), "", self.tr("Regions (*.toml)"))
        if name:
            try:
                self.regions.load(Path(name))
            except PolfuseError as error:
                self._bench.error.emit(str(error), "")

    def _save(self) -> None:
        name, _ = QFileDialog.getSaveFileName(
            self, self.tr("Save regions"), "regions.toml", self.tr("Regions (*.toml)")
        )
        if name:
            try:
                self.regions.save(Path(name))
            except PolfuseError as error:
                self._bench.error.emit(str(error), "")


def _corners(shape: pg.PolyLineROI) -> Corners:
    """Corners of a shape in the plane's units."""
    places = [shape.mapToParent(place) for _, place in shape.getLocalHandlePositions()]
    return tuple((float(place.x()), float(place.y())) for place in places)


def _fixed(text: str) -> QTableWidgetItem:
    item = QTableWidgetItem(text)
    item.setFlags(Qt.ItemFlag.ItemIsEnabled | Qt.ItemFlag.ItemIsSelectable)
    return item
