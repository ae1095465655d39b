"""How far a long run is, and how long it will still take."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """How far one step of a run is."""

    what: str
    """What is counted, such as ``"tiles"``."""
    done: int
    total: int
    remaining_s: float | None
    """Time that the rest will take at the pace so far; None before the first is done."""

    def __str__(self) -> str:
        share = f"{self.done} of {self.total} {self.what} ({100 * self.done // max(self.total, 1)} %)"
        return (
            share
            if self.remaining_s is None or self.done == self.total
            else f"{share}, {_words(self.remaining_s)} left"
        )


Listener = Callable[[Progress], None]


class Counter:
    """Counts what is done and tells a listener, not more often than every ``every_s`` (and at the end).

    Args:
        what: what is counted.
        total: how many there are.
        listener: whom to tell; nobody where left out.
        already: how many an earlier run has done; they do not count for the pace.
        every_s: seconds between two tellings.
    """

    def __init__(
        self, what: str, total: int, listener: Listener | None, *, already: int = 0, every_s: float = 1.0
    ) -> None:
        self._what, self._total, self._listener, self._every_s = what, total, listener, every_s
        self._already = self._done = already
        self._begun = time.monotonic()
        self._told = -float("inf")

    def add(self, count: int = 1) -> None:
        """So many more are done."""
        self._done += count
        now = time.monotonic()
        if self._listener is None or (now - self._told < self._every_s and self._done < self._total):
            return
        self._told = now
        fresh = self._done - self._already
        pace = (now - self._begun) / fresh if fresh else None
        remaining = None if pace is None else pace * (self._total - self._done)
        self._listener(Progress(self._what, self._done, self._total, remaining))


def _words(seconds: float) -> str:
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
