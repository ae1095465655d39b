"""What a person moves when asked: one open request at a time, and a place that is known once it is confirmed."""

from __future__ import annotations

import threading

from drivers.contracts import Operator


class MovedByHand:
    """The request to the operator that drivers of hand-moved devices share. Thread-safe."""

    def __init__(self, operator: Operator) -> None:
        self._operator = operator
        self._lock = threading.RLock()
        self._ticket: int | None = None
        self._target = self._place = 0.0
        self._known = False
        """Whether the device stands where it was last confirmed to be."""

    def _ask(self, target: float, text: str) -> None:
        """Ask for a place; an earlier request is taken back."""
        with self._lock:
            self.stop()
            self._target, self._known = target, False
            self._ticket = self._operator.ask(text)

    def _look(self) -> tuple[float, bool, bool]:
        """The last confirmed place, whether it is known to be there, and whether something is asked for."""
        with self._lock:
            if self._ticket is not None and self._operator.answered(self._ticket):
                self._ticket = None
                self._place, self._known = self._target, True
            return self._place, self._known, self._ticket is not None

    def stop(self) -> None:
        """Take the request back; where the operator left the device is not known."""
        with self._lock:
            if self._ticket is not None:
                self._operator.withdraw(self._ticket)
                self._ticket = None

    def make_safe(self) -> None:
        """Take the request back."""
        self.stop()

    def close(self) -> None:
        """Take the request back. Idempotent."""
        self.stop()
