"""The clock of a replay: the recording's own time, as fast as the user wants or as the records come."""

from __future__ import annotations

import math
import threading
import time

FASTEST = math.inf
"""Speed of a replay that waits for nothing."""


class ReplayClock:
    """Host nanoseconds of the recording. Thread-safe.

    At a finite speed it runs that many times as fast as when it was recorded; at :data:`FASTEST` it stands and is moved
    on by whoever waits for a time. Paused, it stands and no time is reached.
    """

    def __init__(self, start_ns: int, speed: float = FASTEST) -> None:
        if not speed > 0:
            raise ValueError(f"speed: found {speed}, allowed: above 0")
        self._lock = threading.Lock()
        self._speed = speed
        self._paused = False
        self._at_ns = start_ns
        self._since = time.monotonic()

    @property
    def speed(self) -> float:
        """How many times as fast as recorded; may be changed at any time."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        if not speed > 0:
            raise ValueError(f"speed: found {speed}, allowed: above 0")
        with self._lock:
            self._settle()
            self._speed = speed

    @property
    def waits(self) -> bool:
        """Whether time is something to wait for at present."""
        return self._paused or math.isfinite(self._speed)

    @property
    def paused(self) -> bool:
        """Whether the clock has been made to stand."""
        return self._paused

    def pause(self) -> None:
        """Make the clock stand. Idempotent."""
        with self._lock:
            self._settle()
            self._paused = True

    def resume(self) -> None:
        """Let the clock run again. Idempotent."""
        with self._lock:
            self._settle()
            self._paused = False

    def now_ns(self) -> int:
        """The present time of the recording, ns."""
        with self._lock:
            return self._settle()

    def reached(self, at_ns: int) -> bool:
        """Whether a time has come. At :data:`FASTEST` it comes by being asked for."""
        with self._lock:
            now = self._settle()
            if self._paused:
                return False
            if math.isinf(self._speed):
                self._at_ns = max(now, at_ns)
                return True
            return now >= at_ns

    def skip_to(self, at_ns: int) -> None:
        """Move the clock on to a time, unless that has passed or the clock is paused."""
        with self._lock:
            now = self._settle()
            if not self._paused:
                self._at_ns = max(now, at_ns)

    def _settle(self) -> int:
        now = time.monotonic()
        if not self._paused and math.isfinite(self._speed):
            self._at_ns += round((now - self._since) * self._speed * 1e9)
        self._since = now
        return self._at_ns
