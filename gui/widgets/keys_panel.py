"""Which keys do what, over the right side of the pages; everything below goes on working, its keys as well."""

from __future__ import annotations

import html
import sys
from collections.abc import Iterable, Sequence

from PySide6.QtCore import QEvent, QObject, QRect, Qt
from PySide6.QtGui import QKeySequence, QShortcut
from PySide6.QtWidgets import QAbstractButton, QFrame, QHBoxLayout, QLabel, QScrollArea, QVBoxLayout, QWidget

from gui.widgets.layout import button, heading

Group = tuple[str, Sequence[tuple[str, str]]]
"""A heading, and pairs of keys and what they do."""
WIDEST_PX = 420
MARGIN_PX = 12


def keys_of(shortcuts: Iterable[QShortcut]) -> list[tuple[str, str]]:
    """Keys and what they do: as the shortcut itself says ("What's this?"), or the button that it presses."""
    found: dict[str, list[str]] = {}
    for shortcut in shortcuts:
        owner = shortcut.parent()
        what = shortcut.whatsThis() or (owner.text() if isinstance(owner, QAbstractButton) else "")
        found.setdefault(what, []).append(shortcut.key().toString(QKeySequence.SequenceFormat.NativeText))
    return [(", ".join(keys), what) for what, keys in found.items()]


class KeysPanel(QFrame):
    """Hidden until it is asked for. No window of its own: Esc goes on stopping the trolley while it is read.

    Args:
        over: the widget over whose right side it lies.
        parent: an ancestor of that.
    """

    def __init__(self, over: QWidget, parent: QWidget) -> None:
        super().__init__(parent)
        self._over, self._ancestor = over, parent
        self.setProperty("role", "card")
        self.setAutoFillBackground(True)
        self.setAccessibleName(self.tr("keys"))
        self.words = QLabel()
        self.words.setTextFormat(Qt.TextFormat.RichText)
        self.words.setAlignment(Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignLeft)
        self.words.setWordWrap(True)
        scroll = QScrollArea()
        scroll.setWidgetResizable(True)
        scroll.setWidget(self.words)
        scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.close_button = button(self.tr("Close"), self.hide)
        top = QHBoxLayout()
        top.addWidget(heading(self.tr("Keys")), 1)
        top.addWidget(self.close_button)
        column = QVBoxLayout(self)
        column.addLayout(top)
        column.addWidget(scroll, 1)
        over.installEventFilter(self)
        self.hide()

    def show_keys(self, groups: Sequence[Group]) -> None:
        """Show these, group below group."""
        rows = []
        for name, pairs in groups:
            if pairs:
                rows.append(f'<tr><td colspan="2" style="padding: 14px 0 4px 0"><i>{html.escape(name)}</i></td></tr>')
            rows += [
                f'<tr><td style="padding: 3px 18px 3px 0; white-space: nowrap"><b>{html.escape(keys)}</b></td>'
                f'<td style="padding: 3px 0">{html.escape(what)}</td></tr>'
                for keys, what in pairs
            ]
        table = f"<table>{''.join(rows)}</table>"
        self.words.setText(table)
        self._place()
        self.show()
        self.raise_()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:  # noqa: N802 - Qt's name
        """What it lies over has another size or place."""
        if watched is self._over and event.type() in (QEvent.Type.Resize, QEvent.Type.Move):
            self._place()
        return False

    def _place(self) -> None:
        room = QRect(self._over.mapTo(self._ancestor, self._over.rect().topLeft()), self._over.size())
        room.adjust(MARGIN_PX, MARGIN_PX, -MARGIN_PX, -MARGIN_PX)
        room.setLeft(max(room.left(), room.right() - WIDEST_PX))
        self.setGeometry(room)


def _demo() -> QWidget:
    whole = QWidget()
    over = QWidget(whole)
    over.resize(480, 420)
    panel = KeysPanel(over, whole)
    panel.show_keys([("Everywhere", [("Ctrl+1", "Start"), ("F1", "Keys")]), ("Collect", [("F5", "Start the collect")])])
    return whole


if __name__ == "__main__":
    from gui.widgets.demo import run

    sys.exit(run(_demo, 480, 420))
