"""A cursor that several pictures share: move it in one, and all show it."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, Signal

Place = tuple[float, float]
Way = Callable[[float, float], Place | None]


class LinkedCursor(QObject):
    """A place in a plane that several views show, such as (x, y) on the ground or (range, time)."""

    moved = Signal(object)
    """``(x, y)`` in the plane's units, None when it has left."""

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.place: Place | None = None

    def move(self, place: Place | None) -> None:
        """Put it somewhere, or take it away."""
        if place != self.place:
            self.place = place
            self.moved.emit(place)


class JoinedCursors(QObject):
    """Cursors of two planes, such as the ground and the camera's picture: where one moves, the other goes with it.

    Args:
        first, second: of each plane.
        there: place in the second plane of one in the first; None: it has none there.
        back: the other way.
    """

    def __init__(
        self, first: LinkedCursor, second: LinkedCursor, there: Way, back: Way, parent: QObject | None = None
    ) -> None:
        super().__init__(parent)
        self._leading = False
        first.moved.connect(lambda place: self._lead(second, there, place))
        second.moved.connect(lambda place: self._lead(first, back, place))

    def _lead(self, other: LinkedCursor, way: Way, place: Place | None) -> None:
        if self._leading:
            return  # it is led itself: what it leads back to would not be quite the same place
        self._leading = True
        other.move(None if place is None else way(*place))
        self._leading = False
