"""Questions to the operator: shown by whatever client is attached, answered when the person says so."""

from __future__ import annotations

import itertools
import threading


class Prompts:
    """The engine's :class:`drivers.contracts.Operator`. Thread-safe."""

    def __init__(self) -> None:
        self._tickets = itertools.count(1)
        self._open: dict[int, str] = {}
        self._answered: set[int] = set()
        self._lock = threading.Lock()

    def ask(self, prompt: str) -> int:
        """Show a prompt; return a ticket at once."""
        with self._lock:
            ticket = next(self._tickets)
            self._open[ticket] = prompt
            return ticket

    def answered(self, ticket: int) -> bool:
        """Whether the operator has confirmed."""
        with self._lock:
            return ticket in self._answered

    def withdraw(self, ticket: int) -> None:
        """Take the prompt back. Unknown tickets are ignored."""
        with self._lock:
            self._open.pop(ticket, None)
            self._answered.discard(ticket)

    def answer(self, ticket: int) -> bool:
        """Confirm a prompt; False when it is not open (any more)."""
        with self._lock:
            if self._open.pop(ticket, None) is None:
                return False
            self._answered.add(ticket)
            return True

    def open(self) -> list[tuple[int, str]]:
        """Prompts that wait for an answer, oldest first."""
        with self._lock:
            return list(self._open.items())
