"""Time that passes only when somebody waits: a whole collect in milliseconds, the same each time.

The scheduler runs as it is. Its control waits on a virtual clock, its modules read that clock instead of the host's,
and each device's calls are made where they are asked for, unless the device hangs: then they wait until the clock has
come to the hang's end, as they would in the device's own thread.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any
from unittest import mock

from drivers.errors import DeviceTimeout
from polfuse_lab.scheduler import Control
from polfuse_lab.scheduler.control import SLICE_S
from polfuse_lab.scheduler.lane import Lane

START_NS = 1_000_000_000_000
CALL_S = 0.0005
"""Time that a call of a device takes, s."""


class VirtualClock:
    """Host nanoseconds that stand still until :meth:`advance`."""

    def __init__(self) -> None:
        self.now_ns = START_NS
        self._waiting: list[Callable[[], None]] = []

    @property
    def now_s(self) -> float:
        """Seconds."""
        return self.now_ns * 1e-9

    def advance(self, seconds: float) -> None:
        """Let time pass; whatever waited for it goes on."""
        self.now_ns += round(seconds * 1e9)
        for wake in list(self._waiting):
            wake()

    def on_advance(self, wake: Callable[[], None]) -> None:
        """Call ``wake`` whenever time has passed."""
        self._waiting.append(wake)


class Hanging(Exception):
    """Raised by a device whose driver hangs, to be called again once the clock has come to ``until_ns``."""

    def __init__(self, until_ns: int) -> None:
        super().__init__(until_ns)
        self.until_ns = until_ns


class VirtualLane(Lane):
    """A lane without a thread: calls are made at once, and in order behind one that hangs."""

    def __init__(self, name: str, clock: VirtualClock) -> None:
        self.name = name
        self._clock = clock
        self._queue: deque[tuple[Future[Any], Callable[[], Any]]] = deque()
        self._stuck_until: int | None = None
        self._working = False
        clock.on_advance(self._work)

    @property
    def busy(self) -> bool:
        """Whether a call hangs or waits behind one that does."""
        return bool(self._queue)

    def submit(self, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Future[Any]:
        """Make a call, or queue it behind one that hangs."""
        future: Future[Any] = Future()
        self._queue.append((future, lambda: function(*args, **kwargs)))
        self._work()
        return future

    def end(self) -> None:
        """There is no thread to end."""

    def join(self, timeout_s: float) -> bool:
        """There is no thread to wait for."""
        return True

    def _work(self) -> None:
        # A device may let time pass in its own call, which comes back here.
        if self._working:
            return
        self._working = True
        try:
            while self._queue and (self._stuck_until is None or self._clock.now_ns >= self._stuck_until):
                future, call = self._queue[0]
                if self._stuck_until is None and not future.set_running_or_notify_cancel():
                    self._queue.popleft()
                    continue
                self._stuck_until = None
                self._make(future, call)
        finally:
            self._working = False

    def _make(self, future: Future[Any], call: Callable[[], Any]) -> None:
        try:
            result = call()
        except Hanging as hang:
            self._stuck_until = hang.until_ns
            return
        except BaseException as error:
            self._queue.popleft()
            future.set_exception(error)
        else:
            self._queue.popleft()
            future.set_result(result)


class VirtualControl(Control):
    """A control that waits on a virtual clock. ``point`` is called wherever others could act meanwhile."""

    def __init__(self, clock: VirtualClock, point: Callable[[str], None]) -> None:
        super().__init__()
        self._clock = clock
        self._point = point

    def now(self) -> float:
        """Seconds on the virtual clock."""
        return self._clock.now_s

    def slice(self, seconds: float = SLICE_S) -> None:
        """Let a slice of time pass. Raises as :meth:`Control.slice`."""
        self._point("slice")
        self._clock.advance(min(max(seconds, 0.0), SLICE_S))
        self.check()
        self.tick()

    def wait_for(self, future: Future[Any], timeout_s: float, what: str, where: str) -> None:
        """Wait for a call. Raises as :meth:`Control.wait_for`."""
        end = self.now() + timeout_s
        self._clock.advance(CALL_S)
        while True:
            self.check()
            self._point(what)
            if future.done():
                return
            self._clock.advance(SLICE_S)
            self.tick()
            if self.now() > end:
                raise DeviceTimeout(
                    f"{what} did not return within {timeout_s:g} s",
                    where=where,
                    advice="check the device and its cable",
                )


class _VirtualTime:
    """Stands where modules have imported ``time``."""

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock

    def monotonic(self) -> float:
        return self._clock.now_s

    def monotonic_ns(self) -> int:
        return self._clock.now_ns

    def sleep(self, seconds: float) -> None:
        self._clock.advance(seconds)

    def __getattr__(self, name: str) -> Any:
        return getattr(time, name)


@contextlib.contextmanager
def virtual_time(clock: VirtualClock) -> Iterator[None]:
    """Let every module of the scheduler read the virtual clock."""
    modules = [
        module
        for name, module in list(sys.modules.items())
        if name.startswith("polfuse_lab.scheduler") and getattr(module, "time", None) is time
    ]
    with contextlib.ExitStack() as patches:
        for module in modules:
            patches.enter_context(mock.patch.object(module, "time", _VirtualTime(clock)))
        yield
