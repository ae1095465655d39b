"""One thread for each device: its calls are made one after another, and the caller is never stuck in one."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import ParamSpec, TypeVar

Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")


class Lane:
    """The thread in which everything is asked of one device."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._pending = 0
        self._lock = threading.Lock()
        # A daemon: a driver that hangs for good must not keep the process from ending.
        self._thread = threading.Thread(target=self._work, name=f"device {name}", daemon=True)
        self._thread.start()

    @property
    def busy(self) -> bool:
        """Whether a call is under way or waits."""
        with self._lock:
            return self._pending > 0

    def submit(
        self, function: Callable[Parameters, Result], *args: Parameters.args, **kwargs: Parameters.kwargs
    ) -> Future[Result]:
        """Queue a call; its result or exception is in the future."""
        future: Future[Result] = Future()

        def call() -> None:
            try:
                if future.set_running_or_notify_cancel():
                    result = function(*args, **kwargs)
                    self._done()
                    future.set_result(result)
                else:
                    self._done()
            except BaseException as error:
                self._done()
                future.set_exception(error)

        with self._lock:
            self._pending += 1
        self._calls.put(call)
        return future

    def end(self) -> None:
        """End the thread once the calls queued so far are done. Idempotent; does not wait."""
        self._calls.put(None)

    def join(self, timeout_s: float) -> bool:
        """Wait for the thread's end; False when it has not ended in time."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _done(self) -> None:
        with self._lock:
            self._pending -= 1

    def _work(self) -> None:
        while (call := self._calls.get()) is not None:
            call()
