"""No test of serial devices may leave a thread behind, or wait for servers that need no time."""

from __future__ import annotations

import threading
import time
import types
from collections.abc import Iterator

import pytest
import serial.urlhandler.protocol_socket


@pytest.fixture(autouse=True)
def no_thread_leak() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    end_s = time.monotonic() + 2
    while (left := set(threading.enumerate()) - before) and time.monotonic() < end_s:
        time.sleep(0.01)
    assert not left, f"threads left behind: {[thread.name for thread in left]}"


@pytest.fixture(autouse=True)
def no_pause_after_closing_a_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    # pyserial sleeps 0.3 s after it has closed a socket:// port, its module's only use of time.
    no_pause = types.SimpleNamespace(sleep=lambda seconds: None)
    monkeypatch.setattr(serial.urlhandler.protocol_socket, "time", no_pause)
