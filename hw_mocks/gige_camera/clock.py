"""The camera's own clock: it counts ticks since power-up, not quite as fast as the host's, and may jump."""

from __future__ import annotations

import threading
import time

from hw_mocks.faults import FaultKind, FaultScript


class TickClock:
    """Ticks of a drifting clock. Thread-safe.

    Args:
        tick_hz: nominal ticks per second.
        drift_ppm: how much faster than the host's clock it runs, parts per million.
        faults: with ``CLOCK_JUMP`` the clock is off by ``amount`` seconds.
    """

    def __init__(self, tick_hz: int, drift_ppm: float, faults: FaultScript) -> None:
        self.tick_hz = tick_hz
        self._rate = tick_hz * (1.0 + drift_ppm * 1e-6) * 1e-9
        self._faults = faults
        self._lock = threading.Lock()
        self._latched = 0
        self._origin_ns = time.monotonic_ns()

    def ticks(self, t_ns: int | None = None) -> int:
        """The clock's reading at ``t_ns`` (host's monotonic time, ns; now)."""
        now_ns = time.monotonic_ns()
        t_ns = now_ns if t_ns is None else t_ns
        jump = self._faults.active(FaultKind.CLOCK_JUMP, now_ns)
        offset = round(jump.amount * self.tick_hz) if jump else 0
        # Before power-up, or before a jump back, there is no time: a counter has no sign.
        return max(round((t_ns - self._origin_ns) * self._rate) + offset, 0)

    def latch(self) -> None:
        """Remember the reading of now."""
        with self._lock:
            self._latched = self.ticks()

    @property
    def latched(self) -> int:
        """The reading remembered last."""
        with self._lock:
            return self._latched

    def reset(self) -> None:
        """Start from zero."""
        with self._lock:
            self._origin_ns = time.monotonic_ns()
            self._latched = 0
