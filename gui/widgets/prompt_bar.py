"""What the operator is asked to do: large, and confirmed by a click, the keyboard or a presenter's clicker."""

from __future__ import annotations

import sys

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QFrame, QHBoxLayout, QLabel, QPushButton, QWidget

from gui import theme

KEYS = (Qt.Key.Key_Return, Qt.Key.Key_Enter, Qt.Key.Key_PageDown)
"""A presenter's clicker sends Page Down for its forward button."""


class PromptBar(QFrame):
    """The oldest open prompt; hidden while there is none."""

    confirmed = Signal(int)
    """The operator has done it; with the prompt's ticket."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._ticket: int | None = None
        self.setProperty("role", "card")
        self._words = QLabel()
        self._words.setWordWrap(True)
        self._words.setProperty("role", "big")
        self._more = QLabel()
        self._more.setProperty("role", "dim")
        self.confirm_button = QPushButton(self.tr("Done  (Enter or clicker)"))
        self.confirm_button.setProperty("role", "primary")
        self.confirm_button.clicked.connect(self._confirm)
        row = QHBoxLayout(self)
        row.addWidget(self._words, 1)
        row.addWidget(self._more)
        row.addWidget(self.confirm_button)
        self._shortcuts = []
        for key in KEYS:
            shortcut = QShortcut(QKeySequence(key), self)
            shortcut.setContext(Qt.ShortcutContext.WindowShortcut)
            shortcut.setAutoRepeat(False)
            shortcut.activated.connect(self._confirm)
            shortcut.setWhatsThis(self.tr("What was asked is done"))
            self._shortcuts.append(shortcut)
        self.show_prompts([])

    def show_prompts(self, prompts: list[tuple[int, str]]) -> None:
        """Show the oldest of the open ``(ticket, text)``."""
        ticket, text = prompts[0] if prompts else (None, "")
        if ticket != self._ticket:
            self._ticket = ticket
            self._words.setText(text)
            self.confirm_button.setEnabled(True)
            self.setStyleSheet(f'QFrame[role="card"] {{ border: 3px solid {theme.current().accent}; }}')
        more = len(prompts) - 1
        self._more.setText(self.tr("and {n} more").format(n=more) if more > 0 else "")
        self.setVisible(ticket is not None)
        # While nothing is asked the keys belong to the rest of the window.
        for shortcut in self._shortcuts:
            shortcut.setEnabled(ticket is not None)

    @property
    def text(self) -> str:
        """What is asked."""
        return self._words.text() if self._ticket is not None else ""

    def _confirm(self) -> None:
        if self._ticket is None or not self.confirm_button.isEnabled():
            return
        # Once: the answer is on its way until the engine takes the prompt back.
        self.confirm_button.setEnabled(False)
        self.confirmed.emit(self._ticket)


def _demo() -> QWidget:
    bar = PromptBar()
    bar.show_prompts([(1, "Push the trolley to x = +0.508 m, then confirm."), (2, "")])
    return bar


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 860, 100))
