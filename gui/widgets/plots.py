"""What all plots have in common: the theme, axes with units, and a cursor that tells where it is."""

from __future__ import annotations

import sys

import pyqtgraph as pg
from pyqtgraph.GraphicsScene.mouseEvents import MouseClickEvent
from PySide6.QtCore import QEvent, QObject, QPointF, Qt, Signal
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QGraphicsItem, QLabel, QMenu, QSizePolicy, QVBoxLayout, QWidget

from gui import theme
from gui.widgets.turns import TURNS

LINE_PX = 2
SMALLEST_PX = 90
BAR_ROOM_PX = 26
"""For the ticks and the label of a colour bar, beside its numbers."""
AXIS_ROOM_PX = 8
"""For the ticks of an axis, and between its numbers and its label."""
CURSOR = "#19d3e6"
"""Colour of the cross: seen on dark and on light pictures."""
SIDES = ("bottom", "left")
TICKS = 1
"""Finest ticks: numbers and halves. Each finer one costs as much again, with its lines through the whole plot."""
DIGITS = 4
"""For so many, a sign among them, there is always room beside an axis: it does not move as the numbers grow."""


def cached(axis: pg.AxisItem) -> None:
    """Keep an axis as pixels until it changes: drawing its numbers costs more than the picture beside it."""
    axis.setCacheMode(QGraphicsItem.CacheMode.DeviceCoordinateCache)


class Plot(QWidget):
    """A plot with labelled axes above one line that tells what is under the mouse."""

    pointed = Signal(object)
    """The mouse is at ``(x, y)`` of the axes, None: elsewhere."""
    clicked = Signal(object)
    """The left button was clicked at ``(x, y)`` of the axes."""

    def __init__(self, x_label: str, x_unit: str, y_label: str, y_unit: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._bars: list[pg.ColorBarItem] = []
        self._space = QWidget()
        self._space.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        self._space.setMinimumSize(SMALLEST_PX, SMALLEST_PX)
        self._space.installEventFilter(self)
        self.graph = pg.PlotWidget(self._space)
        self.item = self.graph.getPlotItem()
        self.item.setMenuEnabled(False, enableViewBoxMenu=False)  # it speaks to programmers; see fill_menu
        self.item.hideButtons()
        self.item.setContentsMargins(6, 12, 10, 4)
        for side, label, unit in (("bottom", x_label, x_unit), ("left", y_label, y_unit)):
            axis = self.item.getAxis(side)
            # Units stand as they are given: nobody wants "mm" while a range passes 1 m.
            axis.enableAutoSIPrefix(False)
            axis.setLabel(f"{label} [{unit}]" if unit else label)
            axis.setStyle(showValues=False, maxTickLevel=TICKS)
            cached(axis)
        self._empty: QLabel | None = QLabel(self.tr("nothing to show yet"))
        self._empty.setProperty("role", "dim")
        self._empty.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._empty.setWordWrap(True)
        self._empty.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        over = QVBoxLayout(self.graph)
        over.addWidget(self._empty)
        self.readout = QLabel(" ")
        self.readout.setProperty("role", "dim")
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(2)
        column.addWidget(self._space, 1)
        column.addWidget(self.readout)
        self._lines = [pg.InfiniteLine(angle=angle, pen=pg.mkPen(CURSOR, width=1)) for angle in (90, 0)]
        for line in self._lines:
            line.setVisible(False)
            self.item.addItem(line, ignoreBounds=True)
        self._proxy = pg.SignalProxy(self.graph.scene().sigMouseMoved, rateLimit=60, slot=self._mouse)
        self.graph.scene().sigMouseClicked.connect(self._click)
        self.pointed.connect(self.show_cursor)
        self.dress()

    def dress(self) -> None:
        """Take on the colours of the theme."""
        shown = theme.current()
        self.graph.setBackground(shown.panel)
        for axis in (*(self.item.getAxis(side) for side in SIDES), *(bar.axis for bar in self._bars)):
            axis.setPen(shown.dim)
            axis.setTextPen(shown.text)
        label = self.item.titleLabel
        label.setText(label.text, color=shown.text)
        self._make_room()

    def _make_room(self) -> None:
        """Room for the numbers from the beginning: the whole plot would be laid out anew, and drawn, once they come."""
        metrics = self.fontMetrics()
        bottom, left = (self.item.getAxis(side) for side in SIDES)
        words_px = [0.8 * axis.label.boundingRect().height() + AXIS_ROOM_PX for axis in (bottom, left)]
        bottom.setHeight(round(words_px[0] + 0.8 * metrics.height()))
        left.setWidth(round(words_px[1] + metrics.horizontalAdvance("0" * DIGITS)))

    def changeEvent(self, event: QEvent) -> None:  # noqa: N802 - Qt's name
        """Another theme was chosen."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange and hasattr(self, "_proxy"):
            self.dress()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:  # noqa: N802 - Qt's name
        """There is room, or more or less of it: the plot is drawn there when it is its turn."""
        if watched is self._space:
            if event.type() in (QEvent.Type.Resize, QEvent.Type.Show):
                TURNS.ask(self, self._take_room)
            elif event.type() == QEvent.Type.Hide:
                self.graph.hide()
        return False

    def _take_room(self) -> None:
        if self.graph.isHidden() and not self._space.isVisible():
            return  # another page has come to the front meanwhile
        self.graph.setGeometry(self._space.rect())
        self.graph.show()

    def fill_menu(self, menu: QMenu) -> None:
        """What a right click offers."""
        menu.addAction(self.tr("Show everything"), self.show_everything)
        told = self.readout.text().strip()
        copy = menu.addAction(
            self.tr("Copy what is under the cursor"), lambda: QGuiApplication.clipboard().setText(told)
        )
        copy.setEnabled(bool(told))

    def show_everything(self) -> None:
        """Back from a part that was chosen with the mouse."""
        self.item.autoRange()

    def show_cursor(self, place: tuple[float, float] | None) -> None:
        """Show the cross at a place of the axes and tell what is there."""
        for line, value in zip(self._lines, place or (0.0, 0.0), strict=True):
            line.setVisible(place is not None)
            line.setValue(value)
        self.readout.setText(self.describe(*place) if place is not None else " ")

    def describe(self, x: float, y: float) -> str:
        """What is at a place, with units."""
        return f"{x:.3g}, {y:.3g}"

    def filled(self) -> None:
        """The first data have come: the axes mean something now."""
        if self._empty is not None:
            self._empty.hide()
            self._empty.deleteLater()
            self._empty = None
            for side in SIDES:
                self.item.getAxis(side).setStyle(showValues=True)

    def entitle(self, words: str) -> None:
        """Write above the plot; what stands there already is not laid out anew."""
        if words != self.item.titleLabel.text:
            self.item.setTitle(words, color=theme.current().text)

    def say_empty(self, words: str) -> None:
        """Say why there is nothing yet."""
        if self._empty is not None:
            self._empty.setText(words)

    @property
    def shows(self) -> bool:
        """Whether there is anything to see."""
        return self._empty is None

    def add_bar(self, bar: pg.ColorBarItem) -> None:
        """A colour bar that takes on the theme with the plot."""
        self._bars.append(bar)
        cached(bar.axis)
        # Room for five digits: numbers that do not fit are left out.
        bar.axis.setWidth(round(self.fontMetrics().horizontalAdvance("00000") + BAR_ROOM_PX))
        self.dress()

    def _click(self, event: MouseClickEvent) -> None:
        at = event.scenePos()
        if event.button() == Qt.MouseButton.RightButton:
            menu = QMenu(self)
            menu.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
            self.fill_menu(menu)
            menu.popup(event.screenPos().toPoint())
        elif event.button() == Qt.MouseButton.LeftButton and self.item.vb.sceneBoundingRect().contains(at):
            place = self.item.vb.mapSceneToView(at)
            self.clicked.emit((place.x(), place.y()))

    def _mouse(self, event: tuple[QPointF]) -> None:
        at = event[0]
        inside = self.item.vb.sceneBoundingRect().contains(at)
        place = self.item.vb.mapSceneToView(at) if inside else None
        self.pointed.emit(None if place is None else (place.x(), place.y()))


def _demo() -> QWidget:
    plot = Plot("range", "m", "level", "dB")
    plot.item.plot([0.0, 2.0, 4.0, 6.0, 8.0], [-60.0, -58.0, -20.0, -55.0, -61.0], pen=theme.current().curves[0])
    plot.filled()
    plot.show_cursor((4.0, -20.0))
    return plot


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo))
