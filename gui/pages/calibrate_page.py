"""Calibration step by step: show where the reflectors stand, see what is found of them, and take the errors off."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QComboBox,
    QDoubleSpinBox,
    QFormLayout,
    QHBoxLayout,
    QListWidget,
    QListWidgetItem,
    QPlainTextEdit,
    QSizePolicy,
    QSplitter,
    QVBoxLayout,
    QWidget,
)

from gui import theme
from gui.models import background
from gui.models.targets import KINDS, Looked, Role, Stated, TargetList
from gui.widgets.job_bar import JobBar
from gui.widgets.layout import button, card, dim, heading, show_place, title, undo_buttons
from gui.widgets.picture_view import PictureView, Quantity
from gui.workbench import Workbench
from polfuse_lab.jobs import Job
from polfuse_lab.products.pictures import Picture, load_picture, picture_names
from polfuse_lab.products.store import Products

LEAST_PX = 60
SIGNS = {True: "✓", False: "✕", None: "…"}


class CalibratePage(QWidget):
    """The picture to point at on the left, the targets on the right."""

    def __init__(self, bench: Workbench, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bench = bench
        self._job: Job | None = None
        self.targets = TargetList(self)
        self.targets.changed.connect(self._redraw)
        self.targets.failed.connect(bench.error)
        self.where = dim(self.tr("Open products with a focused picture"))
        self.view = PictureView(Quantity("level", "dB"))
        self.view.clicked.connect(self._pointed)
        self._marks = pg.ScatterPlotItem(pxMode=True, size=22, brush=None)
        self._labels: list[pg.TextItem] = []
        self.view.item.addItem(self._marks)
        column = QVBoxLayout(self)
        column.setContentsMargins(16, 16, 16, 12)
        top = QHBoxLayout()
        top.addWidget(title(self.tr("Calibrate")))
        top.addWidget(self.where, 1)
        parts = QSplitter(Qt.Orientation.Horizontal)
        parts.addWidget(self.view)
        parts.addWidget(self._target_part())
        parts.setSizes([620, 480])
        column.addLayout(top)
        column.addWidget(JobBar(bench.jobs))
        column.addWidget(parts, 1)
        bench.products_opened.connect(self.open)
        bench.jobs.over.connect(self._over)
        self._role_chosen()
        self._redraw()

    def open(self, path: Path) -> None:
        """Calibrate the focused picture of a file."""
        show_place(self.where, path)
        self.targets.look_at(path)
        self.outcome.clear()

        def load() -> Picture | None:
            products = Products(path)
            first = next((name for name, _ in picture_names(products) if name.startswith("focus.")), None)
            return None if first is None else load_picture(products, first)

        background.run(self, load, self._picture, self._bench.error.emit)

    def _target_part(self) -> QWidget:
        self.role = QComboBox()
        for role, words in (
            ("constant", self.tr("1. the constant")),
            ("crosstalk", self.tr("2. the crosstalk: dihedrals, upright and at 45°")),
            ("check", self.tr("3. a check of the outcome")),
        ):
            self.role.addItem(words, role)
        self.role.currentIndexChanged.connect(lambda _: self._role_chosen())
        self.kind = QComboBox()
        self.x_m, self.y_m = _metres(-100, 100), _metres(0.01, 1000)
        self.edge_m, self.height_m = _metres(0.01, 10, 0.61), _metres(-10, 10)
        self.angle_sd = QDoubleSpinBox()
        self.angle_sd.setRange(0, 45)
        self.angle_sd.setValue(2.0)
        self.angle_sd.setSuffix(" °")
        self.edge_m.setToolTip(self.tr("Edge of its faces in metres; a sphere's diameter"))
        self.height_m.setToolTip(self.tr("Height of its corner, fold or middle above the ground, in metres"))
        self.angle_sd.setToolTip(self.tr("How well its angles are known, standard deviation in degrees"))
        place = QHBoxLayout()
        place.addWidget(self.x_m)
        place.addWidget(self.y_m)
        size = QHBoxLayout()
        size.addWidget(self.edge_m)
        size.addWidget(self.height_m)
        size.addWidget(self.angle_sd)
        form = QFormLayout()
        form.addRow(self.tr("It is there for"), self.role)
        form.addRow(self.tr("Kind"), self.kind)
        form.addRow(self.tr("Place x, y"), place)
        form.addRow(self.tr("Edge, height, angles ±"), size)
        self.look_button = button(self.tr("Look for it"), self._look, self.tr("In the picture, about its place"))
        self.list = QListWidget()
        self.list.setWordWrap(True)
        self.list.setAccessibleName(self.tr("targets"))
        self.remove_button = button(self.tr("Remove"), lambda: self.targets.remove(self.list.currentRow()), key="Del")
        self.calibrate_button = button(self.tr("Calibrate"), self._calibrate, role="primary", key="Ctrl+K")
        self.outcome = QPlainTextEdit()
        self.outcome.setReadOnly(True)
        self.outcome.setPlaceholderText(self.tr("Constant, imbalance and crosstalk with their uncertainties"))
        for tall in (self.list, self.outcome):
            tall.setMinimumHeight(LEAST_PX)
        buttons = QHBoxLayout()
        buttons.addWidget(self.remove_button)
        for made in undo_buttons(self.targets.undo, self.tr("Undo"), self.tr("Redo")):
            buttons.addWidget(made)
        buttons.addStretch(1)
        buttons.addWidget(self.calibrate_button)
        lists = QSplitter(Qt.Orientation.Vertical)
        # As tall as there is room; as tall as lists would like to be, the page would not fit a small screen.
        lists.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Ignored)
        lists.setMinimumHeight(5 * LEAST_PX)
        for parts in ((self.list, buttons), (heading(self.tr("Outcome")), self.outcome)):
            half = QWidget()
            column = QVBoxLayout(half)
            column.setContentsMargins(0, 4, 0, 4)
            for part in parts:
                if isinstance(part, QWidget):
                    column.addWidget(part, int(part in (self.list, self.outcome)))
                else:
                    column.addLayout(part)
            lists.addWidget(half)
        return card(
            heading(self.tr("A target")),
            dim(self.tr("Click where it stands in the picture, say what it is, then look for it.")),
            form, self.look_button, lists, stretch=4,
        )  # fmt: skip

    def _role_chosen(self) -> None:
        self.kind.clear()
        self.kind.addItems(KINDS[self._role])
        self.kind.setToolTip(self.tr("dihedral: its fold stands upright; dihedral_45: at 45 degrees"))

    @property
    def _role(self) -> Role:
        role: Role = self.role.currentData()
        return role

    def _pointed(self, place: tuple[float, float]) -> None:
        self.x_m.setValue(place[0])
        self.y_m.setValue(place[1])

    def _look(self) -> None:
        self.targets.add(
            Stated(
                self._role, self.kind.currentText(), self.x_m.value(), self.y_m.value(), self.edge_m.value(),
                self.height_m.value(), self.angle_sd.value(),
            )
        )  # fmt: skip

    def _picture(self, picture: Picture | None) -> None:
        self.look_button.setEnabled(picture is not None)
        if picture is None:
            self.where.setText(self.tr("{0}: has no focused picture").format(self.where.text()))
            return
        self.view.quantity = Quantity(picture.title, picture.unit)
        self.view.item.setTitle(picture.title)
        self.view.show_values(picture.values, picture.x, picture.y, limits=picture.limits)

    def _redraw(self) -> None:
        shown = theme.current()
        row = self.list.currentRow()
        self.list.clear()
        spots = []
        for label in self._labels:
            self.view.item.removeItem(label)
        self._labels = []
        for number, looked in enumerate(self.targets.targets, start=1):
            good = None if looked.waiting else looked.good
            item = QListWidgetItem(f"{SIGNS[good]}  {number}. {looked.words}")
            item.setForeground(pg.mkColor({True: shown.ok, False: shown.bad, None: shown.text}[good]))
            self.list.addItem(item)
            x, y = _spot(looked)
            pen = pg.mkPen({True: "#3ccf7e", False: "#ff6b60", None: "#ffffff"}[good], width=3)
            spots.append({"pos": (x, y), "symbol": "x" if good is False else "o", "pen": pen})
            label = pg.TextItem(str(number), color="#ffffff", anchor=(-0.4, 1.2))
            label.setPos(x, y)
            self.view.item.addItem(label)
            self._labels.append(label)
        self._marks.setData(spots)
        self.list.setCurrentRow(min(row, self.list.count() - 1))
        self.calibrate_button.setEnabled(self.targets.ready and self._job is None)

    def _calibrate(self) -> None:
        self._job = self._bench.jobs.submit(self.targets.job())
        self.calibrate_button.setEnabled(False)

    def _over(self, job: Job) -> None:
        if job is not self._job:
            return
        self._job = None
        self.calibrate_button.setEnabled(self.targets.ready)
        if job.state == "done" and job.result is not None:
            self.outcome.setPlainText("\n".join(self._told(job.result)))
            if not self.isVisible():  # here the outcome is seen anyway
                self._bench.told.emit(self.tr("Calibrated: the products hold the calibrated pictures now"), None)
            self._bench.products_changed.emit()

    def _told(self, result: dict[str, Any]) -> list[str]:
        """The command's JSON in words."""
        lines = [
            self.tr("method: {method}"),
            self.tr("constant {constant_db:.2f} ± {constant_sd_db:.2f} dB"),
            self.tr("VV over HH {imbalance_db:+.2f} dB, {imbalance_deg:+.1f}°"),
            self.tr("largest crosstalk seen {crosstalk_db:.1f} dB"),
            self.tr("noise-equivalent RCS {noise_equivalent_dbsm:.1f} dBsm ({noise_source})"),
        ]
        told = [line.format(**result) for line in lines]
        if result.get("check"):
            words = self.tr(
                "check in {channel}: {rcs_dbsm:.2f} dBsm, expected {expected_dbsm:.2f}, difference {error_db:+.2f} ± "
                "{sd_db:.2f} dB"
            )
            told.append(words.format(**result["check"]))
        return told


def _spot(looked: Looked) -> tuple[float, float]:
    """Where it is marked: where it was found, else where it was stated."""
    if looked.good and looked.view is not None:
        return looked.view.x_m, looked.view.y_m
    return looked.stated.x_m, looked.stated.y_m


def _metres(low: float, high: float, value: float = 0.0) -> QDoubleSpinBox:
    made = QDoubleSpinBox()
    made.setRange(low, high)
    made.setDecimals(3)
    made.setSingleStep(0.05)
    made.setSuffix(" m")
    made.setValue(value)
    made.setMinimumWidth(90)
    return made
