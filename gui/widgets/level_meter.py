"""A level meter for one channel of the audio port: root mean square, peak with hold, and a lamp for clipping."""

from __future__ import annotations

import math
import sys
import time

from PySide6.QtCore import QRectF, QSize, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPaintEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from gui import theme

FLOOR_DB, WARN_DB, CLIP_DB = -72.0, -12.0, -0.5
HOLD_S, CLIP_HOLD_S = 1.5, 3.0


class LevelMeter(QWidget):
    """Shows a level relative to full scale.

    Args:
        name: what is measured, such as ``"beat"``.
        loud: it is meant to be near full scale, as a sync signal is: no warning then.
    """

    def __init__(self, name: str, parent: QWidget | None = None, *, loud: bool = False) -> None:
        super().__init__(parent)
        self._loud = loud
        self._name = name
        self._rms_db = self._peak_db = self._held_db = -math.inf
        self._held_at = self._clipped_at = -math.inf
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setToolTip(
            self.tr(
                "Level of the {name} channel in dB below full scale: bar = root mean square, line = peak. "
                "Red at the right = clipped within the last seconds."
            ).format(name=name)
        )

    def show_level(self, peak: float, rms: float) -> None:
        """Show a new level; ``peak`` and ``rms`` are fractions of full scale, 0 to 1."""
        now = time.monotonic()
        self._rms_db, self._peak_db = _db(rms), _db(peak)
        if self._peak_db >= self._held_db or now - self._held_at > HOLD_S:
            self._held_db, self._held_at = self._peak_db, now
        if self._peak_db >= CLIP_DB:
            self._clipped_at = now
        self.setAccessibleDescription(self.text())
        self.update()

    def text(self) -> str:
        """The level in words."""
        return self.tr("nothing") if math.isinf(self._peak_db) else f"{self._peak_db:.1f} dBFS"

    @property
    def clipped(self) -> bool:
        """Whether it clipped within the last seconds."""
        return time.monotonic() - self._clipped_at < CLIP_HOLD_S

    def sizeHint(self) -> QSize:  # noqa: N802 - Qt's name
        """As tall as two lines of text."""
        return QSize(320, round(QFontMetricsF(self.font()).height() * 2.6))

    def paintEvent(self, event: QPaintEvent) -> None:  # noqa: N802 - Qt's name
        """Draw it."""
        shown = theme.current()
        painter = QPainter(self)
        metrics = QFontMetricsF(self.font())
        lamp = metrics.height() * 0.8
        bar = QRectF(0, metrics.height() * 1.15, self.width() - lamp - 6, metrics.height() * 0.8)
        painter.setPen(QColor(shown.text))
        painter.drawText(QRectF(0, 0, self.width(), metrics.height()), Qt.AlignmentFlag.AlignLeft, self._name)
        painter.drawText(QRectF(0, 0, bar.width(), metrics.height()), Qt.AlignmentFlag.AlignRight, self.text())
        painter.fillRect(bar, QColor(shown.raised))
        colour = shown.ok if self._loud or self._rms_db < WARN_DB else shown.warning
        painter.fillRect(QRectF(bar.x(), bar.y(), bar.width() * _part(self._rms_db), bar.height()), QColor(colour))
        for tick_db in range(-60, 0, 12):
            x = bar.x() + bar.width() * _part(tick_db)
            painter.fillRect(QRectF(x, bar.y(), 1, bar.height()), QColor(shown.panel))
        if not math.isinf(self._held_db):
            x = bar.x() + bar.width() * _part(self._held_db)
            painter.fillRect(QRectF(x - 2, bar.y() - 1, 3, bar.height() + 2), QColor(shown.text))
        painter.fillRect(
            QRectF(bar.right() + 6, bar.y(), lamp, bar.height()), QColor(shown.bad if self.clipped else shown.raised)
        )
        painter.end()


def _db(fraction: float) -> float:
    return 20 * math.log10(fraction) if fraction > 0 else -math.inf


def _part(level_db: float) -> float:
    return min(max((level_db - FLOOR_DB) / -FLOOR_DB, 0.0), 1.0)


def _demo() -> QWidget:
    from PySide6.QtWidgets import QVBoxLayout

    widget = QWidget()
    column = QVBoxLayout(widget)
    for name, peak, rms in (("beat", 0.12, 0.03), ("sync", 1.0, 0.8), ("silent", 0.0, 0.0)):
        meter = LevelMeter(name)
        meter.show_level(peak, rms)
        column.addWidget(meter)
    return widget


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 420, 180))
