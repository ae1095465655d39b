"""Positions along the rail by channels: what is recorded, what is being recorded, what was flagged."""

from __future__ import annotations

import sys

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QHelpEvent, QPainter, QPaintEvent
from PySide6.QtWidgets import QSizePolicy, QToolTip, QWidget

from gui import theme


class ProgressGrid(QWidget):
    """A small cell for each channel at each position."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._channels: tuple[str, ...] = ()
        self._positions = 0
        self._states: dict[tuple[int, str], str] = {}
        self._reached = 0
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setMouseTracking(True)

    def begin(self, positions: int, channels: tuple[str, ...]) -> None:
        """A new collect of so many positions."""
        self._positions, self._channels = positions, channels
        self._states.clear()
        self._reached = 0
        self.updateGeometry()
        self.update()

    def mark(self, position: int, channel: str, state: str) -> None:
        """``state`` is ``"now"``, ``"done"`` or ``"flagged"``; another "now" turns the last one into "done"."""
        if state == "now":
            for place, known in self._states.items():
                if known == "now" and place != (position, channel):
                    self._states[place] = "done"
            # Positions are collected in their order; what went by between two looks is done as well.
            for earlier in range(self._reached, position):
                for other in self._channels:
                    self._states.setdefault((earlier, other), "done")
            self._reached = max(self._reached, position)
        if self._states.get((position, channel)) != state:
            self._states[position, channel] = state
            self.update()

    @property
    def positions(self) -> int:
        """How many positions there are."""
        return self._positions

    def finish(self, whole: bool = False) -> None:
        """Nothing is being recorded any more; ``whole``: nothing is missing."""
        if whole:
            for position in range(self._positions):
                for channel in self._channels:
                    self._states.setdefault((position, channel), "done")
        self._states = {place: "done" if state == "now" else state for place, state in self._states.items()}
        self.update()

    def state(self, position: int, channel: str) -> str:
        """State of a cell, ``"open"`` while nothing was recorded there."""
        return self._states.get((position, channel), "open")

    def sizeHint(self) -> QSize:  # noqa: N802 - Qt's name
        """A line of text for each channel."""
        line = QFontMetricsF(self.font()).height() * 1.25
        return QSize(400, round(line * max(len(self._channels), 1) + 4))

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802 - Qt's name
        """Draw it."""
        if not self._channels or not self._positions:
            return
        shown = theme.current()
        colours = {"open": shown.raised, "now": shown.accent, "done": shown.ok, "flagged": shown.warning}
        painter = QPainter(self)
        left, width, line = self._measures()
        for row, channel in enumerate(self._channels):
            painter.setPen(QColor(shown.text))
            painter.drawText(QRectF(0, row * line, left, line), Qt.AlignmentFlag.AlignVCenter, channel)
            for position in range(self._positions):
                state = self.state(position, channel)
                gap = 1.0 if width > 3 else 0.0
                cell = QRectF(left + position * width, row * line + 2, max(width - gap, 0.5), line - 4)
                painter.fillRect(cell, QColor(colours[state]))
                if state == "flagged":  # a sign besides the colour
                    painter.fillRect(QRectF(cell.x(), cell.bottom() - 3, cell.width(), 3), QColor(shown.bad))
        painter.end()

    def event(self, event: object) -> bool:
        """Tell what is under the mouse."""
        if isinstance(event, QHelpEvent) and event.type() == QHelpEvent.Type.ToolTip and self._channels:
            left, width, line = self._measures()
            position = int((event.pos().x() - left) / width) if width else -1
            row = int(event.pos().y() / line)
            if 0 <= position < self._positions and 0 <= row < len(self._channels):
                channel = self._channels[row]
                words = self.tr("position {0}, {1}: {2}").format(position + 1, channel, self.state(position, channel))
                QToolTip.showText(event.globalPos(), words, self)
            return True
        return super().event(event)  # type: ignore[arg-type]

    def _measures(self) -> tuple[float, float, float]:
        metrics = QFontMetricsF(self.font())
        left = metrics.horizontalAdvance("VV  ")
        return left, (self.width() - left) / max(self._positions, 1), metrics.height() * 1.25


def _demo() -> QWidget:
    grid = ProgressGrid()
    grid.begin(61, ("HH", "HV", "VV", "VH"))
    for position in range(19):
        for channel in ("HH", "HV", "VV", "VH"):
            grid.mark(position, channel, "flagged" if (position, channel) == (7, "VV") else "done")
    grid.mark(19, "HH", "now")
    return grid


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 700, 120))
