"""What went wrong, or has been done, in words, in the page itself: never a box that must be clicked away."""

from __future__ import annotations

import sys
from pathlib import Path

from PySide6.QtCore import Qt, QTimer, QUrl, Signal
from PySide6.QtGui import QDesktopServices, QGuiApplication
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QWidget

from gui import theme

STAYS_MS = 15_000
"""So long is it told what has been done; an error stays until it is put away."""


class ErrorBar(QFrame):
    """One sentence with "Copy details" or "Open"; hidden while there is nothing to say."""

    dismissed = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._details = ""
        self._made: Path | None = None
        self.setProperty("role", "card")
        self._sign = QLabel()
        self._words = QLabel()
        self._words.setWordWrap(True)
        self._words.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.copy_button = QPushButton(self.tr("Copy details"))
        self.copy_button.setToolTip(self.tr("Copy everything that is known about this error, for a report"))
        self.copy_button.clicked.connect(self._copy)
        self.open_button = QPushButton(self.tr("Open"))
        self.open_button.clicked.connect(self._open)
        self._going = QTimer(self)
        self._going.setSingleShot(True)
        self._going.setInterval(STAYS_MS)
        self._going.timeout.connect(self.clear)
        self.close_button = QPushButton(self.tr("Close"))
        self.close_button.clicked.connect(self.clear)
        row = QHBoxLayout(self)
        row.addWidget(self._sign)
        row.addWidget(self._words, 1)
        row.addWidget(self.copy_button)
        row.addWidget(self.open_button)
        row.addWidget(self.close_button)
        self.hide()

    @property
    def text(self) -> str:
        """What it says."""
        return self._words.text()

    def tell(self, sentence: str, details: str = "", *, warning: bool = False) -> None:
        """Say it, with ``details`` for whoever mends it."""
        shown = theme.current()
        self._say(sentence, "!" if warning else "✕", shown.warning if warning else shown.bad)
        self._details = details or sentence
        self.copy_button.setText(self.tr("Copy details"))
        self.copy_button.show()
        self.open_button.hide()

    def tell_done(self, sentence: str, made: Path | None = None) -> None:
        """Say for a while that something has been done, unless an error stands here.

        Args:
            sentence: what has been done.
            made: can be opened with the program that the computer has for it.
        """
        if self.isVisible() and not self._going.isActive():
            return
        self._say(sentence, "✓", theme.current().ok)
        self._going.start()
        self._made = made
        self.copy_button.hide()
        self.open_button.setVisible(made is not None)

    def _say(self, sentence: str, sign: str, colour: str) -> None:
        self._sign.setText(sign)
        self._sign.setStyleSheet(f"color: {colour}; font-weight: 700;")
        self.setStyleSheet(f'QFrame[role="card"] {{ border: 2px solid {colour}; }}')
        self._words.setText(sentence)
        self._going.stop()
        self.show()

    def clear(self) -> None:
        """Nothing to say any more."""
        self.hide()
        self._words.setText("")
        self.dismissed.emit()

    def _open(self) -> None:
        if self._made is not None:
            QDesktopServices.openUrl(QUrl.fromLocalFile(str(self._made)))

    def _copy(self) -> None:
        QGuiApplication.clipboard().setText(self._details)
        self.copy_button.setText(self.tr("Copied"))


def _demo() -> QWidget:
    bar = ErrorBar()
    bar.tell(
        "trolley (grbl): nobody answers on /dev/ttyUSB1; check its power and its cable, then press 'Try again'",
        "Traceback …",
    )
    return bar


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 760, 70))
