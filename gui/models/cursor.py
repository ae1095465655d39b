"""A cursor that several pictures share: move it in one, and all show it."""

from __future__ import annotations

from PySide6.QtCore import QObject, Signal


class LinkedCursor(QObject):
    """A place in a plane that several views show, such as (x, y) on the ground or (range, time)."""

    moved = Signal(object)
    """``(x, y)`` in the plane's units, None when it has left."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.place: tuple[float, float] | None = None

    def move(self, place: tuple[float, float] | None) -> None:
        """Put it somewhere, or take it away."""
        if place != self.place:
            self.place = place
            self.moved.emit(place)
