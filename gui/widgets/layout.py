"""Pieces that pages are put together from."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtGui import QKeySequence, QShortcut, QUndoStack
from PySide6.QtWidgets import QFrame, QLabel, QLayout, QPushButton, QVBoxLayout, QWidget

from gui.models.words import place


def title(text: str) -> QLabel:
    """Title of a page."""
    return _label(text, "title")


def heading(text: str) -> QLabel:
    """Heading of a part."""
    return _label(text, "heading")


def dim(text: str) -> QLabel:
    """Words that explain."""
    label = _label(text, "dim")
    label.setWordWrap(True)
    return label


def show_place(label: QLabel, path: Path | str) -> None:
    """Say where a file is, in short; the tool tip has all of it."""
    label.setText(place(path))
    label.setToolTip(str(path))


def card(*parts: QWidget | QLayout, stretch: int | None = None) -> QFrame:
    """Parts below each other in a frame; ``stretch`` is the number of the one that takes what room is left."""
    frame = QFrame()
    frame.setProperty("role", "card")
    column = QVBoxLayout(frame)
    for number, part in enumerate(parts):
        share = int(number == stretch)
        if isinstance(part, QWidget):
            column.addWidget(part, share)
        else:
            column.addLayout(part, share)
    return frame


def button(text: str, clicked: Callable[[], object], tip: str = "", role: str = "", key: str = "") -> QPushButton:
    """A push button; ``role`` is ``"primary"``, ``"danger"`` or nothing, ``key`` its shortcut."""
    made = QPushButton(text)
    made.clicked.connect(lambda: clicked())
    if role:
        made.setProperty("role", role)
    if key:
        # Not the button's own shortcut: that is cleared whenever its text changes.
        QShortcut(QKeySequence(key), made).activated.connect(made.click)
        tip = f"{tip} ({key})" if tip else key
    if tip:
        made.setToolTip(tip)
    made.setCursor(Qt.CursorShape.PointingHandCursor)
    return made


def undo_buttons(stack: QUndoStack, undo: str, redo: str) -> tuple[QPushButton, QPushButton]:
    """Undo and redo of a stack of changes, with the usual keys; ``undo`` and ``redo`` are their texts."""
    standard = QKeySequence.StandardKey
    back = button(undo, stack.undo, key=QKeySequence(standard.Undo).toString())
    forth = button(redo, stack.redo, key=QKeySequence(standard.Redo).toString())
    stack.canUndoChanged.connect(back.setEnabled)
    stack.canRedoChanged.connect(forth.setEnabled)
    back.setEnabled(stack.canUndo())
    forth.setEnabled(stack.canRedo())
    return back, forth


def _label(text: str, role: str) -> QLabel:
    label = QLabel(text)
    label.setProperty("role", role)
    return label


def _demo() -> QWidget:
    undo = QUndoStack()
    page = QWidget()
    page.setWindowTitle("pieces of pages")
    column = QVBoxLayout(page)
    undo.setParent(page)
    column.addWidget(title("Title of a page"))
    column.addWidget(
        card(
            heading("Heading of a part"),
            dim("Words that explain, on as many lines as they need."),
            button("Main thing to do", lambda: None, "What it does", "primary"),
            button("Something else", lambda: None),
            button("What cannot be taken back", lambda: None, role="danger"),
            *undo_buttons(undo, "Undo", "Redo"),
        )
    )
    return page


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 420, 380))
