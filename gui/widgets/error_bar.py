"""What went wrong, in words, in the page itself: never a box that must be clicked away."""

from __future__ import annotations

import sys

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QWidget

from gui import theme


class ErrorBar(QFrame):
    """One sentence with "copy details"; hidden while there is nothing to say."""

    dismissed = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._details = ""
        self.setProperty("role", "card")
        self._sign = QLabel()
        self._words = QLabel()
        self._words.setWordWrap(True)
        self._words.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.copy_button = QPushButton(self.tr("Copy details"))
        self.copy_button.setToolTip(self.tr("Copy everything that is known about this error, for a report"))
        self.copy_button.clicked.connect(self._copy)
        self.close_button = QPushButton(self.tr("Close"))
        self.close_button.clicked.connect(self.clear)
        row = QHBoxLayout(self)
        row.addWidget(self._sign)
        row.addWidget(self._words, 1)
        row.addWidget(self.copy_button)
        row.addWidget(self.close_button)
        self.hide()

    @property
    def text(self) -> str:
        """What it says."""
        return self._words.text()

    def tell(self, sentence: str, details: str = "", *, warning: bool = False) -> None:
        """Say it, with ``details`` for whoever mends it."""
        shown = theme.current()
        colour = shown.warning if warning else shown.bad
        self._sign.setText("!" if warning else "✕")
        self._sign.setStyleSheet(f"color: {colour}; font-weight: 700;")
        self.setStyleSheet(f'QFrame[role="card"] {{ border: 2px solid {colour}; }}')
        self._words.setText(sentence)
        self._details = details or sentence
        self.show()

    def clear(self) -> None:
        """Nothing to say any more."""
        self.hide()
        self._words.setText("")
        self.dismissed.emit()

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
