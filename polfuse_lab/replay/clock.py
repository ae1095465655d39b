"""The clock of a replay: the recording's own time, as fast as the user wants or as the records come."""

from __future__ import annotations

import math
import threading
import time

FASTEST = math.inf
"""Speed of a replay that waits for nothing."""
HURRY = 50.0
"""How many times as fast as recorded a replay goes to a place that is sought, where it is not faster anyway. Not
:data:`FASTEST`: whoever watches is to be shown all records on the way, since an image is made of all of them."""


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
        self._hurried = False
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
        return math.isfinite(self._pace)

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

    def hurry(self) -> None:
        """Go fast, paused or not, until :meth:`calm`. Idempotent."""
        with self._lock:
            self._settle()
            self._hurried = True

    def calm(self) -> None:
        """Go on at the speed that was chosen, or stand still again where it is paused. Idempotent."""
        with self._lock:
            self._settle()
            self._hurried = False

    def now_ns(self) -> int:
        """The present time of the recording, ns."""
        with self._lock:
            return self._settle()

    def reached(self, at_ns: int) -> bool:
        """Whether a time has come. At :data:`FASTEST` it comes by being asked for."""
        with self._lock:
            now = self._settle()
            if self._pace == 0:
                return False
            if math.isinf(self._pace):
                self._at_ns = max(now, at_ns)
                return True
            return now >= at_ns

    def skip_to(self, at_ns: int) -> None:
        """Move the clock on to a time, unless that has passed or the clock is paused."""
        with self._lock:
            now = self._settle()
            if self._pace > 0:
                self._at_ns = max(now, at_ns)

    @property
    def _pace(self) -> float:
        """How many times as fast as recorded it goes at present."""
        if self._hurried:
            return max(self._speed, HURRY)
        return 0.0 if self._paused else self._speed

    def _settle(self) -> int:
        now = time.monotonic()
        if math.isfinite(self._pace):
            self._at_ns += round((now - self._since) * self._pace * 1e9)
        self._since = now
        return self._at_ns
