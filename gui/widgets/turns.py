"""Costly changes of many widgets one after another, with the window alive in between."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

import shiboken6
from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QWidget

NEXT_MS = 1
"""Not 0: what is due at once comes before the window is painted, all of it in one block."""


class Turns:
    """Each widget's change gets a turn of the event loop of its own; the first is made at once.

    A page of many plots that is shown or resized would hold the window up until the last of them is drawn. So a widget
    that had to wait is painted in its turn too, not with all the others when the window is painted next.
    """

    def __init__(self) -> None:
        self._waiting: deque[tuple[QObject, Callable[[], None]]] = deque()
        self._resting = False

    @property
    def busy(self) -> bool:
        """Whether any change waits for its turn."""
        return bool(self._waiting)

    def ask(self, owner: QObject, change: Callable[[], None]) -> None:
        """Make a change soon; of changes of one owner that wait one is made, and none if the owner goes."""
        if not self._resting:
            self._rest()
            change()
        elif not any(other is owner for other, _ in self._waiting):
            self._waiting.append((owner, change))

    def _rest(self) -> None:
        self._resting = True
        QTimer.singleShot(NEXT_MS, self._next)

    def _next(self) -> None:
        self._resting = False
        while self._waiting:
            owner, change = self._waiting.popleft()
            if shiboken6.isValid(owner):
                self._rest()
                change()
                if isinstance(owner, QWidget):
                    owner.repaint()
                return


TURNS = Turns()
"""Of all plots: they share one event loop."""
