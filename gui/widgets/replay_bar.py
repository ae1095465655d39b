"""A recorded session that is played: where it is, how fast, pause and stop."""

from __future__ import annotations

import sys

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QDoubleSpinBox, QFrame, QHBoxLayout, QLabel, QSlider, QWidget

from gui.models.words import duration
from gui.widgets.layout import button
from polfuse_lab.engine.protocol import StatusEvent

SLOWEST, FASTEST = 0.1, 100.0


class ReplayBar(QFrame):
    """Hidden while nothing is played."""

    speed_wanted = Signal(float)
    pause_wanted = Signal(bool)
    """True: stand still; False: go on."""
    stop_wanted = Signal()
    seek_wanted = Signal(int, int)
    """The step that is wanted, and the one that is shown."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setProperty("role", "card")
        self.pause_button = button(self.tr("Pause"), self._pause, key="Space")
        self.pause_button.setCheckable(True)
        self._shown = 0
        self.line = QSlider(Qt.Orientation.Horizontal)
        self.line.setAccessibleName(self.tr("time line"))
        self.line.setToolTip(self.tr("Drag it, or click beside it, to see another moment"))
        self.line.setTracking(False)  # a moment is gone to when it is let go
        self.line.valueChanged.connect(self._sought)
        self.words = QLabel()
        self.speed = QDoubleSpinBox()
        self.speed.setRange(SLOWEST, FASTEST)
        self.speed.setStepType(QDoubleSpinBox.StepType.AdaptiveDecimalStepType)
        self.speed.setDecimals(1)
        self.speed.setSuffix(" ×")
        self.speed.setToolTip(self.tr("How many times as fast as it was recorded"))
        self.speed.valueChanged.connect(self.speed_wanted)
        row = QHBoxLayout(self)
        row.addWidget(self.pause_button)
        row.addWidget(self.line, 1)
        row.addWidget(self.words)
        row.addWidget(self.speed)
        row.addWidget(button(self.tr("Stop"), self.stop_wanted.emit))
        self.hide()

    def begin(self, speed: float) -> None:
        """A replay has begun, so many times as fast as recorded."""
        self.speed.blockSignals(True)
        self.speed.setValue(speed)
        self.speed.blockSignals(False)
        self.pause_button.setChecked(False)
        self.pause_button.setText(self.tr("Pause"))
        self._follow(0)
        self.words.setText("")
        self.show()

    def show_status(self, status: StatusEvent) -> None:
        """How far it is."""
        self.line.blockSignals(True)
        self.line.setMaximum(max(status.steps, 1))
        self.line.setPageStep(max(status.steps // 20, 1))
        self.line.blockSignals(False)
        if not self.line.isSliderDown():
            self._follow(status.step)
        where = self.tr("position {0} of {1}").format(max(status.position + 1, 0), status.positions)
        self.words.setText(f"{where}   {duration(status.elapsed_s)}")

    def _follow(self, step: int) -> None:
        self._shown = step
        self.line.blockSignals(True)
        self.line.setValue(step)
        self.line.blockSignals(False)

    def _sought(self, step: int) -> None:
        self.seek_wanted.emit(step, self._shown)

    def _pause(self) -> None:
        paused = self.pause_button.isChecked()
        self.pause_button.setText(self.tr("Go on") if paused else self.tr("Pause"))
        self.pause_wanted.emit(paused)


def _demo() -> QWidget:
    from gui.widgets.status_strip import demo_status

    bar = ReplayBar()
    bar.begin(4.0)
    bar.show_status(demo_status())
    return bar


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 760, 80))
