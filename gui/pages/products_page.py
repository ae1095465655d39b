"""Pictures of a products file, one or two side by side under one cursor, and what was done to make them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import (
    QFileDialog,
    QHBoxLayout,
    QListWidget,
    QListWidgetItem,
    QMenu,
    QPlainTextEdit,
    QSplitter,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from gui.models import background
from gui.models.cursor import JoinedCursors, LinkedCursor
from gui.models.words import place
from gui.saving import save_view
from gui.widgets.job_bar import JobBar
from gui.widgets.layout import button, card, dim, heading, show_place, title
from gui.widgets.picture_view import PictureView
from gui.widgets.pictured import view_of
from gui.widgets.space_view import SpaceView
from gui.workbench import Workbench
from polfuse_lab import jobs
from polfuse_lab.jobs import Job
from polfuse_lab.products.pauli_space import SPACE, PauliSpace, load_space, space_names
from polfuse_lab.products.pictures import Picture, load_picture, picture_names
from polfuse_lab.products.places import Places, load_places
from polfuse_lab.products.store import Products

SUFFIXES = {"png": ".png", "geotiff": ".tif", "kmz": ".kmz", "envi": "", "polsarpro": "", "sicd": ".nitf",
            "cphd": ".cphd"}  # fmt: skip
"""Formats of export, and how their files are called; folders have no suffix."""
DECOMPOSITIONS = ("pauli", "h-a-alpha", "freeman", "yamaguchi", "krogager", "cameron", "touzi")


@dataclass(frozen=True, eq=False)
class Loaded:
    """What is to be shown."""

    names: list[str]
    shown: list[Picture | PauliSpace]
    places: Places | None
    """Of ground and camera, where both are shown and were registered."""
    settings: str


class ProductsPage(QWidget):
    """Choose a picture on the left; hold Ctrl to choose two."""

    def __init__(self, bench: Workbench, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bench = bench
        self.linked = LinkedCursor(self)
        self.where = dim(self.tr("No products are open: focus a session, or open a file on the start page"))
        self.list = QListWidget()
        self.list.setSelectionMode(QListWidget.SelectionMode.ExtendedSelection)
        self.list.setToolTip(self.tr("Two pictures beside each other: choose the second with Ctrl"))
        self.list.itemSelectionChanged.connect(self._chosen)
        self.settings = QPlainTextEdit()
        self.settings.setReadOnly(True)
        self.views: list[PictureView | SpaceView] = []
        self._linked: list[QObject] = [self.linked]
        self._shown_names: list[str] = []
        self.pictures = QSplitter(Qt.Orientation.Horizontal)
        self._wanted: list[str] = []
        left = QVBoxLayout()
        left.addWidget(
            card(heading(self.tr("Pictures")), self.list, heading(self.tr("Made with")), self.settings, stretch=1)
        )
        top = QHBoxLayout()
        top.addWidget(title(self.tr("Products")))
        top.addWidget(self.where, 1)
        for text, clicked, tip in (
            (self.tr("Report…"), self._report, self.tr("One page with pictures, numbers and provenance")),
            (self.tr("Save view…"), self._save, self.tr("As PNG or PDF, with where it comes from")),
        ):
            top.addWidget(button(text, clicked, tip))
        self.export_button = QToolButton()
        self.export_button.setText(self.tr("Export"))
        self.export_button.setToolTip(self.tr("For other programs"))
        self.export_button.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        menu = QMenu(self.export_button)
        for to in SUFFIXES:
            menu.addAction(to, partial(self._export, to))
        self.export_button.setMenu(menu)
        self.make_button = QToolButton()
        self.make_button.setText(self.tr("Make"))
        self.make_button.setToolTip(self.tr("More from this file: decompositions, radar and camera fused"))
        self.make_button.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        make = QMenu(self.make_button)
        make.addAction(self.tr("Fuse radar and camera"), self.fuse)
        for method in DECOMPOSITIONS:
            make.addAction(self.tr("Decompose: {0}").format(method), partial(self._decompose, method))
        self.make_button.setMenu(make)
        top.addWidget(self.make_button)
        top.addWidget(self.export_button)
        row = QHBoxLayout()
        row.addLayout(left, 1)
        row.addWidget(self.pictures, 4)
        column = QVBoxLayout(self)
        column.setContentsMargins(24, 20, 24, 16)
        column.addLayout(top)
        column.addWidget(JobBar(bench.jobs))
        column.addLayout(row, 1)
        bench.products_opened.connect(self.open)
        bench.products_changed.connect(self._again)
        bench.jobs.over.connect(self._over)
        self._mine: set[int] = set()
        self._written: dict[int, Path] = {}
        self._path: Path | None = None
        self._known: set[str] = set()

    def open(self, path: Path) -> None:
        """Show the pictures of a file."""
        if path != self._path:
            self._path, self._wanted, self._known = path, [], set()
        show_place(self.where, path)

        def names() -> list[tuple[str, str]]:
            products = Products(path)
            return picture_names(products) + space_names(products)

        background.run(self, names, self._listed, self._bench.error.emit)

    def choose(self, *names: str) -> None:
        """Choose one or two pictures by their names."""
        self.list.clearSelection()
        for row in range(self.list.count()):
            item = self.list.item(row)
            if item.data(Qt.ItemDataRole.UserRole) in names:
                item.setSelected(True)

    def holds(self, name: str) -> bool:
        """Whether there is a picture of that name."""
        items = (self.list.item(row) for row in range(self.list.count()))
        return any(item.data(Qt.ItemDataRole.UserRole) == name for item in items)

    @property
    def shown_names(self) -> list[str]:
        """Names of the pictures that are shown."""
        return list(self._shown_names)

    def _again(self) -> None:
        if self._path is not None:
            self.open(self._path)

    def fuse(self) -> None:
        """Begin to put radar and camera together, with the usual settings."""
        if self._path is not None:
            self._mine.add(id(self._bench.jobs.submit(jobs.fuse(self._path))))

    def _decompose(self, method: str) -> None:
        if self._path is not None:
            self._mine.add(id(self._bench.jobs.submit(jobs.decompose(self._path, method))))

    def _over(self, job: Job) -> None:
        if id(job) in self._mine and job.state == "done":
            self._bench.products_changed.emit()
        written = self._written.pop(id(job), None)
        if written is not None and job.state == "done":
            self._bench.told.emit(self.tr("{0} is written").format(place(written)), written)

    def _write(self, spec: jobs.JobSpec, path: Path) -> None:
        self._written[id(self._bench.jobs.submit(spec))] = path

    def _listed(self, names: list[tuple[str, str]]) -> None:
        chosen = list(self._wanted)
        new = [name for name, _ in names if name not in self._known]
        if self._known and new:
            chosen = new[:1]  # what has just been made is what one wants to see
        self._known = {name for name, _ in names}
        self.list.blockSignals(True)
        self.list.clear()
        for name, text in names:
            item = QListWidgetItem(text)
            item.setData(Qt.ItemDataRole.UserRole, name)
            self.list.addItem(item)
        self.list.blockSignals(False)
        if chosen and chosen[0] in dict(names):
            self.choose(*chosen)
        elif names:
            best = next((row for row, (name, _) in enumerate(names) if name == "polarimetry.pauli"), 0)
            self.list.setCurrentRow(best)

    def _chosen(self) -> None:
        path = self._bench.products
        names = [item.data(Qt.ItemDataRole.UserRole) for item in self.list.selectedItems()][:2]
        if path is None or not names or names == self._wanted:
            return
        self._wanted = names

        def load() -> Loaded:
            products = Products(path)
            shown = [load_space(products) if name == SPACE else load_picture(products, name) for name in names]
            planes = {picture.x is None for picture in shown if isinstance(picture, Picture)}
            # Only places on the ground and in the camera's picture that were registered can be told of each other.
            places = load_places(products) if True in planes and len(names) > 1 else None
            return Loaded(names, shown, places, _lines(products.settings(names[0].partition(".")[0])))

        background.run(self, load, self._show, self._bench.error.emit)

    def _show(self, found: Loaded) -> None:
        if found.names != self._wanted:
            return  # something else has been chosen meanwhile
        for view in self.views:
            view.setParent(None)
            view.deleteLater()
        for link in self._linked:
            link.deleteLater()
        self.linked, camera = LinkedCursor(self), LinkedCursor(self)
        self._linked = [self.linked, camera]
        if found.places is not None:
            ways = found.places.to_camera, found.places.to_ground
            self._linked.append(JoinedCursors(self.linked, camera, *ways, self))
        self.views = [SpaceView(shown) if isinstance(shown, PauliSpace) else view_of(shown) for shown in found.shown]
        for view in self.views:
            ground = isinstance(view, SpaceView) or view.ground
            view.follow(self.linked if ground else camera)
            self.pictures.addWidget(view)
        self.pictures.setSizes([self.pictures.width() // len(self.views)] * len(self.views))
        self.settings.setPlainText(found.settings)
        self._shown_names = found.names

    def _save(self) -> None:
        name, _ = QFileDialog.getSaveFileName(self, self.tr("Save this view"), "view.png", "PNG (*.png);;PDF (*.pdf)")
        if name:
            try:
                save_view(self.pictures, Path(name), self._bench.provenance())
            except OSError as error:
                self._bench.error.emit(self.tr("{0} cannot be written ({1})").format(name, error), "")

    def _report(self) -> None:
        if self._bench.products is not None:
            name, _ = QFileDialog.getSaveFileName(self, self.tr("Write the report"), "report.html", "HTML (*.html)")
            if name:
                self._write(jobs.report(self._bench.products, Path(name)), Path(name))

    def _export(self, to: str) -> None:
        if self._bench.products is not None:
            name, _ = QFileDialog.getSaveFileName(self, self.tr("Export as {0}").format(to), f"export{SUFFIXES[to]}")
            if name:
                self._write(jobs.export(self._bench.products, to, Path(name)), Path(name))


def _lines(settings: dict[str, Any], indent: str = "") -> str:
    """Settings as people read them."""
    lines = []
    for key, value in settings.items():
        if isinstance(value, dict):
            lines += [f"{indent}{key}:", _lines(value, indent + "  ")]
        elif isinstance(value, list):
            lines.append(f"{indent}{key}: " + ", ".join(map(str, value)))
        else:
            lines.append(f"{indent}{key}: {f'{value:.6g}' if isinstance(value, float) else value}")
    return "\n".join(lines)
