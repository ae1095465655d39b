"""A change that can be taken back: from one whole state to another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from PySide6.QtGui import QUndoCommand

State = TypeVar("State")


class Change(QUndoCommand, Generic[State]):
    """For a :class:`QUndoStack`; states must not be changed by those who get them.

    Args:
        words: what the user did.
        put: makes a state the present one.
        before: the state to go back to.
        after: the state that the change leads to.
    """

    def __init__(self, words: str, put: Callable[[State], None], before: State, after: State) -> None:
        super().__init__(words)
        self._put, self._before, self._after = put, before, after

    def undo(self) -> None:
        """Back."""
        self._put(self._before)

    def redo(self) -> None:
        """And forth; pushing a change does this."""
        self._put(self._after)
