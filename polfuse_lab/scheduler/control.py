"""How a run is steered from outside: abort, pause, resume; and how the scheduler waits so that it notices."""

from __future__ import annotations

import concurrent.futures
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from drivers.errors import DeviceTimeout

SLICE_S = 0.02
"""Longest wait without looking whether the run was aborted, s."""


class Aborted(Exception):
    """The run was told to stop; ``str()`` says by whom or why."""


class Control:
    """Flags that any thread may set, and the waits of the scheduler that obey them."""

    def __init__(self) -> None:
        self._abort = threading.Event()
        self._pause = threading.Event()
        self._reason = ""
        self._lock = threading.Lock()
        self.tick: Callable[[], None] = lambda: None
        """Called in every slice of every wait, for what must go on meanwhile (clock fixes, health)."""

    def abort(self, reason: str = "aborted by the user") -> None:
        """Stop the run; the first reason given is kept."""
        with self._lock:
            if not self._abort.is_set():
                self._reason = reason
                self._abort.set()

    def pause(self) -> None:
        """Pause after the present step."""
        self._pause.set()

    def resume(self) -> None:
        """Go on after a pause."""
        self._pause.clear()

    @property
    def aborting(self) -> bool:
        """Whether the run has been told to stop."""
        return self._abort.is_set()

    @property
    def pausing(self) -> bool:
        """Whether the run is, or is about to be, paused."""
        return self._pause.is_set()

    @property
    def reason(self) -> str:
        """Why the run was told to stop."""
        return self._reason

    def check(self) -> None:
        """Raise :class:`Aborted` once the run has been told to stop."""
        if self._abort.is_set():
            raise Aborted(self._reason)

    def now(self) -> float:
        """Seconds on the clock that the run goes by: the host's monotonic one, in a replay the recording's."""
        return time.monotonic()

    def slice(self, seconds: float = SLICE_S) -> None:
        """Wait for one slice. Raises :class:`Aborted`, and whatever :attr:`tick` raises."""
        self._abort.wait(min(seconds, SLICE_S))
        self.check()
        self.tick()

    def sleep(self, seconds: float) -> None:
        """Wait. Raises as :meth:`slice`."""
        end = self.now() + seconds
        self.check()
        while (left := end - self.now()) > 0:
            self.slice(left)

    def wait_for(self, future: Future[Any], timeout_s: float, what: str, where: str) -> None:
        """Wait until a call made elsewhere is done.

        Raises:
            Aborted: the run was told to stop.
            DeviceTimeout: the call did not return within ``timeout_s``.
        """
        end = time.monotonic() + timeout_s
        while True:
            self.check()
            if concurrent.futures.wait([future], timeout=SLICE_S).done:
                return
            self.tick()
            if time.monotonic() > end:
                raise DeviceTimeout(
                    f"{what} did not return within {timeout_s:g} s",
                    where=where,
                    advice="check the device and its cable",
                )
