"""One device: a light (with a sign, for eyes that do not tell red from green), what is wrong and how to mend it."""

from __future__ import annotations

import sys

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QVBoxLayout, QWidget

from gui import theme

SIGNS = {"ok": "✓", "warning": "!", "bad": "✕", "off": "–", "busy": "…"}


class DeviceCard(QFrame):
    """The state of one device.

    Args:
        kind: such as ``"radar"``; goes with :attr:`retry`.
        title: what the user calls it.
    """

    retry = Signal(str)
    """The user wants it tried again; with its kind."""

    def __init__(self, kind: str, title: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.kind = kind
        self.light = "off"
        """One of ``ok``, ``warning``, ``bad``, ``off``, ``busy``."""
        self.setProperty("role", "card")
        self._lamp = QLabel()
        self._lamp.setFixedWidth(28)
        self._lamp.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._title = QLabel(title)
        self._title.setProperty("role", "heading")
        self._detail = QLabel()
        self._detail.setWordWrap(True)
        self._advice = QLabel()
        self._advice.setWordWrap(True)
        self._advice.setProperty("role", "dim")
        self.retry_button = QPushButton(self.tr("Try again"))
        self.retry_button.clicked.connect(lambda: self.retry.emit(self.kind))
        words = QVBoxLayout()
        words.setSpacing(2)
        for label in (self._title, self._detail, self._advice):
            words.addWidget(label)
        row = QHBoxLayout(self)
        row.addWidget(self._lamp, 0, Qt.AlignmentFlag.AlignTop)
        row.addLayout(words, 1)
        row.addWidget(self.retry_button, 0, Qt.AlignmentFlag.AlignTop)
        self.show_state("off")

    def show_state(self, light: str, detail: str = "", advice: str = "") -> None:
        """Show how the device is: ``detail`` says what it is or what is wrong, ``advice`` how to mend it."""
        shown = theme.current()
        self.light = light
        colours = {"ok": shown.ok, "warning": shown.warning, "bad": shown.bad}
        self._lamp.setText(SIGNS[light])
        self._lamp.setStyleSheet(f"color: {colours.get(light, shown.dim)}; font-weight: 800; font-size: 16pt;")
        self._detail.setText(detail)
        self._detail.setVisible(bool(detail))
        self._advice.setText(advice)
        self._advice.setVisible(bool(advice))
        self.retry_button.setVisible(light == "bad")
        self.setAccessibleName(f"{self._title.text()}: {light}. {detail}")

    @property
    def words(self) -> str:
        """Detail and advice as shown."""
        return f"{self._detail.text()} {self._advice.text()}".strip()


def _demo() -> QWidget:
    widget = QWidget()
    column = QVBoxLayout(widget)
    for kind, light, detail, advice in (
        ("Radar", "ok", "USB Audio, 2 channels at 48 kHz; beat -23 dBFS, sync found every 39.9 ms", ""),
        ("Trolley", "bad", "nobody answers on /dev/ttyUSB1", "check its power and its cable, then try again"),
        ("Camera", "warning", "1.4 % of the pixels are saturated", "shorten the exposure"),
    ):
        card = DeviceCard(kind.lower(), kind)
        card.show_state(light, detail, advice)
        column.addWidget(card)
    column.addStretch(1)
    return widget


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 620, 330))
