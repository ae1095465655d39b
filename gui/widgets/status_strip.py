"""What must always be seen while a collect runs: its state, losses, disk and sync."""

from __future__ import annotations

import sys

from PySide6.QtWidgets import QHBoxLayout, QLabel, QWidget

from gui import theme
from gui.models.words import duration, size
from polfuse_lab.engine.protocol import StatusEvent

LOW_DISK_BYTES = 2e9


class StatusStrip(QWidget):
    """One line at the lower edge of the window."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._labels = {name: QLabel() for name in ("state", "position", "time", "loss", "disk", "sync")}
        row = QHBoxLayout(self)
        row.setContentsMargins(10, 4, 10, 4)
        row.setSpacing(24)
        for label in self._labels.values():
            row.addWidget(label)
        row.addStretch(1)
        self.show_idle()

    def text(self, name: str) -> str:
        """What one of its labels says."""
        return self._labels[name].text()

    def show_idle(self, words: str = "") -> None:
        """No collect runs."""
        for label in self._labels.values():
            label.setText("")
            label.setStyleSheet("")
            label.hide()
        self._say("state", words or self.tr("No collect is running"))

    def show_status(self, status: StatusEvent) -> None:
        """Show a collect's state."""
        shown = theme.current()
        colour = {"running": shown.ok, "paused": shown.warning, "preparing": shown.accent}.get(status.state, shown.dim)
        self._say("state", f"● {status.state}", colour)
        self._say("position", self.tr("position {0} of {1}").format(max(status.position + 1, 0), status.positions))
        self._say("time", f"{duration(status.elapsed_s)}  + {duration(status.eta_s)}")
        lost = status.samples_lost + status.frames_lost
        words = self.tr("nothing lost") if lost == 0 else self.tr("lost: {0} samples, {1} frames").format(
            status.samples_lost, status.frames_lost
        )  # fmt: skip
        self._say("loss", words, shown.ok if lost == 0 else shown.bad)
        free = status.disk_free_bytes
        low = free is not None and free < LOW_DISK_BYTES
        words = "" if free is None else self.tr("{0} free").format(size(free))
        self._say("disk", words, shown.bad if low else None)

    def show_sync(self, words: str, good: bool) -> None:
        """Show whether the sweeps are found."""
        shown = theme.current()
        self._say("sync", words, shown.ok if good else shown.bad)

    def _say(self, name: str, words: str, colour: str | None = None) -> None:
        label = self._labels[name]
        if label.text() != words:
            label.setText(words)
        label.setVisible(bool(words))
        style = f"color: {colour}; font-weight: 600;" if colour else ""
        if label.styleSheet() != style:
            label.setStyleSheet(style)


def demo_status(**changes: object) -> StatusEvent:
    """A collect in its middle."""
    fields: dict[str, object] = {
        "state": "running", "reason": "recording 4 sweeps of HV", "step": 190, "steps": 600, "position": 18,
        "positions": 61, "x_m": -0.61, "channel": "HV", "eta_s": 410.0, "elapsed_s": 181.0, "sweeps": 74, "frames": 0,
        "samples_lost": 0, "frames_lost": 0, "disk_free_bytes": 81_200_000_000, "warnings": [], "prompts": [],
    }  # fmt: skip
    return StatusEvent(**(fields | changes))  # type: ignore[arg-type]


def _demo() -> QWidget:
    strip = StatusStrip()
    strip.show_status(demo_status())
    strip.show_sync("sync every 40.0 ms", True)
    return strip


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 900, 40))
