"""Shared by the tests of serial devices: a wire that follows a script, a server for RFC 2217, a patient operator."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import pytest
import serial
from serial.rfc2217 import PortManager

from hw_mocks.wire import HAS_PTY

T = TypeVar("T")

both_kinds = pytest.mark.parametrize(
    "kind", [pytest.param("pty", marks=pytest.mark.skipif(not HAS_PTY, reason="no pseudo-terminals here")), "tcp"]
)


class Script:
    """A device that expects exact bytes, in order, and answers each with fixed bytes."""

    def __init__(self, *turns: tuple[bytes, bytes]) -> None:
        self.turns = list(turns)
        self.heard = b""
        self.mismatch: bytes | None = None

    def handle(self, received: bytes) -> bytes:
        self.heard += received
        answer = b""
        while self.heard and self.turns and self.mismatch is None:
            expected, reply = self.turns[0]
            if not self.heard.startswith(expected):
                if not expected.startswith(self.heard):
                    self.mismatch = self.heard
                break
            self.heard = self.heard[len(expected) :]
            self.turns.pop(0)
            answer += reply
        return answer

    def due_s(self) -> float | None:
        return None

    def check(self) -> None:
        """Everything expected was sent, and nothing else."""
        wait_for(lambda: not self.turns or self.mismatch, "the script's end", timeout_s=1.0, default=None)
        assert self.mismatch is None, f"expected {self.turns[0][0]!r}, got {self.mismatch!r}"
        assert self.turns == []
        assert self.heard == b""


class Talker:
    """A device that sends a fixed text every millisecond, asked or not."""

    def __init__(self, text: bytes) -> None:
        self.text = text

    def handle(self, received: bytes) -> bytes:
        return self.text

    def due_s(self) -> float | None:
        return 0.001


class Silent:
    """A device that says nothing until told to."""

    def __init__(self) -> None:
        self.heard = b""
        self.to_say = b""

    def handle(self, received: bytes) -> bytes:
        self.heard += received
        said, self.to_say = self.to_say, b""
        return said

    def due_s(self) -> float | None:
        return None


class PatientOperator:
    """Confirms only what the test confirms."""

    def __init__(self) -> None:
        self.prompts: dict[int, str] = {}
        self.confirmed: set[int] = set()
        self.withdrawn: set[int] = set()

    def ask(self, prompt: str) -> int:
        ticket = len(self.prompts) + 1
        self.prompts[ticket] = prompt
        return ticket

    def answered(self, ticket: int) -> bool:
        return ticket in self.confirmed

    def withdraw(self, ticket: int) -> None:
        self.withdrawn.add(ticket)


def wait_for(ready: Callable[[], Any], what: str, *, timeout_s: float = 5.0, default: Any = AssertionError) -> None:
    """Wait until ``ready()`` is true; fail (or return, with ``default=None``) when it takes too long."""
    end_s = time.monotonic() + timeout_s
    while not ready():
        if time.monotonic() > end_s:
            if default is None:
                return
            raise AssertionError(f"waited {timeout_s} s in vain for {what}")
        time.sleep(0.005)


def keep_trying(act: Callable[[], Any], *, seconds: float = 2.0, pause_s: float = 0.0) -> None:
    """Repeat ``act`` for a while (until it raises): a peer's end needs a moment to arrive over TCP."""
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        act()
        time.sleep(pause_s)


def until_still(poll: Callable[[], T], timeout_s: float = 5.0) -> T:
    """Poll a mover until it no longer moves; returns its last fix."""
    end_s = time.monotonic() + timeout_s
    while True:
        fix = poll()
        if not fix.moving:  # type: ignore[attr-defined]
            return fix
        assert time.monotonic() < end_s, f"still moving after {timeout_s} s: {fix}"
        time.sleep(0.01)


@contextmanager
def rfc2217_echo() -> Iterator[tuple[str, Callable[[], None]]]:
    """pyserial's own RFC 2217 server around a loop-back port: url, and a function that kills the server."""
    server = socket.create_server(("127.0.0.1", 0))
    over = threading.Event()
    connections: list[socket.socket] = []

    def run() -> None:
        server.settimeout(5)
        try:
            connection, _ = server.accept()
        except OSError:
            return
        connections.append(connection)
        connection.settimeout(0.02)
        loop = serial.serial_for_url("loop://", timeout=0)

        class Writer:
            def write(self, data: bytes) -> None:
                connection.sendall(data)

        try:
            manager = PortManager(loop, Writer())
            while not over.is_set():
                try:
                    received = connection.recv(1024)
                except TimeoutError:
                    received = None
                if received == b"":
                    break
                if received:
                    loop.write(b"".join(manager.filter(received)))
                if loop.in_waiting:
                    connection.sendall(b"".join(manager.escape(loop.read(loop.in_waiting))))
        except OSError:
            pass
        finally:
            loop.close()
            connection.close()

    thread = threading.Thread(target=run, name="rfc2217-server", daemon=True)
    thread.start()

    def kill() -> None:
        over.set()
        thread.join(5)
        server.close()

    try:
        yield f"rfc2217://127.0.0.1:{server.getsockname()[1]}", kill
    finally:
        kill()
