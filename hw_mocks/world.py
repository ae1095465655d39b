"""The simulated world's state over time: where the trolley was, how the switches stood, how the polarizer was turned.

Serial mocks write into it, the sound card and the camera read from it. Histories are kept so that a reader that works
in blocks (a sound card) can ask for any recent instant. All times are the host's monotonic nanoseconds.
"""

from __future__ import annotations

import bisect
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


class Track:
    """A quantity that moves piecewise linearly in time. Thread-safe."""

    def __init__(self, value: float) -> None:
        self._lock = threading.Lock()
        self._times: list[int] = [0]
        self._values: list[float] = [value]

    def hold(self, value: float, t_ns: int | None = None) -> None:
        """Stand at ``value`` from ``t_ns`` (now) on; whatever was planned for later is dropped."""
        t_ns = time.monotonic_ns() if t_ns is None else t_ns
        with self._lock:
            self._cut(t_ns)
            self._append(t_ns, value)

    def move(self, start: float, stop: float, t0_ns: int, t1_ns: int) -> None:
        """Move linearly from ``start`` at ``t0_ns`` to ``stop`` at ``t1_ns``, then stand."""
        with self._lock:
            self._cut(t0_ns)
            self._append(t0_ns, start)
            self._append(max(t1_ns, t0_ns + 1), stop)

    def follow(self, times_ns: Sequence[int], values: Sequence[float]) -> None:
        """Move through ``values`` at ``times_ns`` (rising), linearly in between, then stand."""
        with self._lock:
            self._cut(times_ns[0])
            for t_ns, value in zip(times_ns, values, strict=True):
                self._append(max(t_ns, self._times[-1] + 1), value)

    def at(self, t_ns: int | None = None) -> float:
        """Value at ``t_ns`` (now)."""
        t_ns = time.monotonic_ns() if t_ns is None else t_ns
        return float(self.at_many(np.array([t_ns], dtype=np.int64))[0])

    def at_many(self, t_ns: NDArray[np.int64]) -> NDArray[np.float64]:
        """Values at many instants, shape of ``t_ns``."""
        with self._lock:
            times = np.array(self._times, dtype=np.int64)
            values = np.array(self._values)
        # Seconds since the first asked instant: int64 nanoseconds do not fit a float64 exactly.
        origin = int(t_ns.flat[0])
        values_at: NDArray[np.float64] = np.interp((t_ns - origin) * 1e-9, (times - origin) * 1e-9, values)
        return values_at

    def _cut(self, t_ns: int) -> None:
        index = bisect.bisect_left(self._times, t_ns)
        if 0 < index < len(self._times):
            t0, t1 = self._times[index - 1], self._times[index]
            v0, v1 = self._values[index - 1], self._values[index]
            value = v0 + (v1 - v0) * (t_ns - t0) / (t1 - t0)
        else:
            value = self._values[index - 1] if index else self._values[0]
        del self._times[index:], self._values[index:]
        self._append(t_ns - 1, value)

    def _append(self, t_ns: int, value: float) -> None:
        self._times.append(t_ns)
        self._values.append(value)
        if len(self._times) > 4096:
            del self._times[:2048], self._values[:2048]


class Steps:
    """A quantity that jumps between discrete values in time. Thread-safe."""

    def __init__(self, value: str) -> None:
        self._lock = threading.Lock()
        self._times: list[int] = [0]
        self._values: list[str] = [value]

    def set(self, value: str, t_ns: int | None = None) -> None:
        """Take ``value`` from ``t_ns`` (now) on."""
        with self._lock:
            self._times.append(max(time.monotonic_ns() if t_ns is None else t_ns, self._times[-1]))
            self._values.append(value)
            if len(self._times) > 4096:
                del self._times[:2048], self._values[:2048]

    def at(self, t_ns: int | None = None) -> str:
        """Value at ``t_ns`` (now)."""
        t_ns = time.monotonic_ns() if t_ns is None else t_ns
        with self._lock:
            return self._values[max(bisect.bisect_right(self._times, t_ns) - 1, 0)]

    def changes(self, t0_ns: int, t1_ns: int) -> list[tuple[int, str]]:
        """The value at ``t0_ns`` and every later value up to ``t1_ns``, each with the instant from which it holds."""
        with self._lock:
            first = max(bisect.bisect_right(self._times, t0_ns) - 1, 0)
            last = max(bisect.bisect_right(self._times, t1_ns), first + 1)
            return list(zip(self._times[first:last], self._values[first:last], strict=True))


@dataclass
class World:
    """State of a simulated rig. Switch routes are ``"H"``, ``"V"`` or ``"?"`` while the contacts travel."""

    trolley_x_m: Track = field(default_factory=lambda: Track(0.0))
    transmit: Steps = field(default_factory=lambda: Steps("H"))
    receive: Steps = field(default_factory=lambda: Steps("H"))
    polarizer_rad: Track = field(default_factory=lambda: Track(0.0))
