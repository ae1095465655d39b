"""Classes as points in the space of Pauli components, turned with the mouse: with |HV| and, beside it, with DOLP."""

from __future__ import annotations

import math
import sys

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPen, QPixmap, QPolygonF, QResizeEvent
from PySide6.QtWidgets import QLabel, QSizePolicy, QVBoxLayout, QWidget

from gui import theme
from gui.models.cursor import LinkedCursor
from gui.widgets.class_view import legend
from gui.widgets.plots import CURSOR
from polfuse_lab.products.fused_colours import colour_of_class, largest_shown
from polfuse_lab.products.pauli_space import ACROSS, AWAY, AXES, UP, PauliSpace

Floats = NDArray[np.float64]

YAW_DEG, PITCH_DEG = -32.0, 24.0
"""From where it is seen at first: from the right and above."""
DEGREES_PER_PX = 0.5
STEP_DEG = 5.0
"""Of one press of an arrow key."""
POINT_PX = 3
ROOM = 0.62
"""Half the side of a plot holds the unit cube times this, whichever way it is turned."""
CORNERS = np.array([[a, b, c] for a in (0, 1) for b in (0, 1) for c in (0, 1)], dtype=np.float64)
EDGES = [(i, k) for i in range(8) for k in range(i) if np.abs(CORNERS[i] - CORNERS[k]).sum() == 1]


class SpaceView(QWidget):
    """Drag to turn, arrow keys likewise; a double click turns back. Follows the cursor of pictures on the ground."""

    pointed = Signal(object)
    """Never sent: a point of this space is no place on the ground."""

    def __init__(self, space: PauliSpace, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._space = space
        self.canvas = _Canvas(space)
        self.canvas.setToolTip(self.tr("Drag to turn it; a double click turns it back"))
        self.canvas.setAccessibleName(self.tr("Classes in Pauli space"))
        self.readout = QLabel(" ")
        self.readout.setProperty("role", "dim")
        # Long words are cut off: they do not push the picture beside it away.
        self.readout.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.setSpacing(2)
        column.addWidget(self.canvas, 1)
        column.addWidget(self.readout)
        column.addWidget(legend(dict(enumerate(space.names))))

    def follow(self, cursor: LinkedCursor) -> None:
        """Mark where the pixel under a cursor on the ground lies."""
        cursor.moved.connect(self.show_cursor)

    def show_cursor(self, place: tuple[float, float] | None) -> None:
        """Mark the point of the pixel at a place on the ground, and tell its components."""
        vector = None if place is None else self._space.at(*place)
        self.canvas.mark(vector)
        if place is None:
            self.readout.setText(" ")
        elif vector is None:
            self.readout.setText(self.tr("undefined there"))
        else:
            self.readout.setText("   ".join(f"{name} {value:.3f}" for name, value in zip(AXES, vector, strict=True)))


class _Canvas(QWidget):
    def __init__(self, space: PauliSpace) -> None:
        super().__init__()
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(160, 120)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        groups = space.groups()
        self._points = {number: groups[name] for number, name in enumerate(space.names) if groups[name].size}
        dolp = [points[3] for points in self._points.values()]
        self._tops = {UP[0]: 1.0, UP[1]: min(1.0, 1.1 * largest_shown(np.concatenate(dolp))) if dolp else 1.0}
        self._marked: Floats | None = None
        self._yaw, self._pitch = YAW_DEG, PITCH_DEG
        self._drawn: QPixmap | None = None
        self._from: QPointF | None = None

    @property
    def turned(self) -> tuple[float, float]:
        """Yaw and pitch, degrees."""
        return self._yaw, self._pitch

    def mark(self, vector: Floats | None) -> None:
        """Mark one point; None: none."""
        self._marked = vector
        self.update()

    def turn(self, yaw_deg: float, pitch_deg: float) -> None:
        """Turn by so much; it never stands on its head."""
        self._yaw = (self._yaw + yaw_deg + 180) % 360 - 180
        self._pitch = min(max(self._pitch + pitch_deg, -90.0), 90.0)
        self._drawn = None
        self.update()

    def places(self, vectors: Floats, up: int) -> Floats:
        """(n, 2) pixels of vectors (4, n) in the plot whose upward axis is component ``up``."""
        scaled = np.stack([vectors[ACROSS], vectors[AWAY], np.clip(vectors[up] / self._tops[up], 0, 1)], axis=-1)
        return self._flat(scaled, UP.index(up))

    def _flat(self, cube: Floats, number: int) -> Floats:
        """Pixels of points (n, 3) of the unit cube, seen from far away."""
        yaw, pitch = math.radians(self._yaw), math.radians(self._pitch)
        x, y, z = (cube - 0.5).T
        across = x * math.cos(yaw) - y * math.sin(yaw)
        away = x * math.sin(yaw) + y * math.cos(yaw)
        up = z * math.cos(pitch) + away * math.sin(pitch)
        box = self._box(number)
        scale = ROOM * min(box.width(), box.height())
        return np.stack([box.center().x() + scale * across, box.center().y() - scale * up], axis=-1)

    def _box(self, number: int) -> QRectF:
        """Beside each other where there is room, else below each other."""
        if self.width() >= self.height():
            return QRectF(number * self.width() / 2, 0, self.width() / 2, self.height())
        return QRectF(0, number * self.height() / 2, self.width(), self.height() / 2)

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802 - Qt's name
        """Points are drawn once for each turn; the mark is drawn over them."""
        if self._drawn is None:
            self._drawn = self._draw()
        painter = QPainter(self)
        painter.drawPixmap(0, 0, self._drawn)
        if self._marked is not None:
            painter.setRenderHint(QPainter.RenderHint.Antialiasing)
            painter.setPen(QPen(QColor(CURSOR), 2))
            for up in UP:
                x, y = self.places(self._marked[:, None], up)[0]
                painter.drawEllipse(QPointF(x, y), 7, 7)
        painter.end()

    def _draw(self) -> QPixmap:
        shown = theme.current()
        ratio = self.devicePixelRatioF()
        pixmap = QPixmap(round(self.width() * ratio), round(self.height() * ratio))
        pixmap.setDevicePixelRatio(ratio)
        pixmap.fill(QColor(shown.panel))
        painter = QPainter(pixmap)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for number, up in enumerate(UP):
            at = self._flat(CORNERS, number)
            for i, k in EDGES:
                axis = not CORNERS[k].any()  # an edge from where all components are zero
                painter.setPen(QPen(QColor(shown.dim if axis else shown.border), 2 if axis else 1))
                painter.drawLine(QPointF(*at[k]), QPointF(*at[i]))
            for vectors_of, vectors in self._points.items():
                painter.setPen(QPen(QColor(colour_of_class(vectors_of)), POINT_PX))
                painter.drawPoints(QPolygonF([QPointF(x, y) for x, y in self.places(vectors, up)]))
            self._label(painter, number, up)
        painter.end()
        return pixmap

    def _label(self, painter: QPainter, number: int, up: int) -> None:
        """Names of the axes at their ends, with the largest value."""
        painter.setPen(QColor(theme.current().text))
        ends = 0.5 + 0.5 * np.array([[1.16, -1.0, -1.0], [-1.0, 1.16, -1.0], [-1.0, -1.0, 1.12]])
        metrics = painter.fontMetrics()
        box = self._box(number)
        for (x, y), component in zip(self._flat(ends, number), (ACROSS, AWAY, up), strict=True):
            text = f"{AXES[component]} → {self._tops.get(component, 1.0):.2g}"
            width = metrics.horizontalAdvance(text)
            left = min(max(x - width / 2, box.left() + 2), box.right() - width - 2)
            painter.drawText(QPointF(left, min(max(y, metrics.ascent()), box.bottom() - metrics.descent())), text)

    def changeEvent(self, event: QEvent) -> None:  # noqa: N802 - Qt's name
        """Another theme was chosen."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange:
            self._drawn = None
            self.update()

    def resizeEvent(self, event: QResizeEvent) -> None:  # noqa: N802 - Qt's name
        """There is more or less room."""
        self._drawn = None

    def mousePressEvent(self, event: QMouseEvent) -> None:  # noqa: N802 - Qt's name
        """Begin to turn."""
        self._from = event.position()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:  # noqa: N802 - Qt's name
        """Turn with the mouse."""
        if self._from is not None:
            way = event.position() - self._from
            self._from = event.position()
            self.turn(DEGREES_PER_PX * way.x(), DEGREES_PER_PX * way.y())

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:  # noqa: N802 - Qt's name
        """Let go."""
        self._from = None

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:  # noqa: N802 - Qt's name
        """Turn back to how it was at first."""
        self.turn(YAW_DEG - self._yaw, PITCH_DEG - self._pitch)

    def keyPressEvent(self, event: QKeyEvent) -> None:  # noqa: N802 - Qt's name
        """Arrow keys turn it too."""
        key = Qt.Key(event.key())
        yaw = STEP_DEG * ((key == Qt.Key.Key_Right) - (key == Qt.Key.Key_Left))
        pitch = STEP_DEG * ((key == Qt.Key.Key_Down) - (key == Qt.Key.Key_Up))
        if yaw or pitch:
            self.turn(yaw, pitch)
        else:
            super().keyPressEvent(event)


def demo_space() -> PauliSpace:
    """Three classes around a plate, a dihedral and a bush."""
    random = np.random.default_rng(0)
    labels = np.repeat(np.arange(3), 300).reshape(30, 30)
    means = np.array([[0.1, 0.05, 0.95, 0.05], [0.95, 0.1, 0.15, 0.4], [0.5, 0.6, 0.6, 0.1]])
    features = np.abs(means[labels] + random.normal(0, 0.06, (30, 30, 4)))
    features[..., :3] /= np.linalg.norm(features[..., :3], axis=-1, keepdims=True)
    return PauliSpace(
        np.moveaxis(features, -1, 0), labels, ("plate", "dihedral", "bush"), np.arange(30.0), np.arange(30.0)
    )


def _demo() -> QWidget:
    view = SpaceView(demo_space())
    view.show_cursor((3.0, 14.0))
    return view


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 900, 480))
