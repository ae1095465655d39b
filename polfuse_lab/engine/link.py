"""The client's end of an engine of any kind: starting its process, attaching, sending, noticing that it has died."""

from __future__ import annotations

import contextlib
import os
import secrets
import subprocess
import sys
import threading
import time
from abc import ABC, abstractmethod
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import msgspec
import zmq

from polfuse_lab.engine import directory as directories
from polfuse_lab.engine import protocol
from polfuse_lab.errors import PolfuseError
from polfuse_lab.live.board import LiveView

START_S = 30.0
DEAF_S = 10.0
"""An engine that has said nothing for so long is taken for dead once its process is gone, s."""


class Link(ABC):
    """One client of one engine. Not thread-safe.

    Args:
        directory: the engine's private directory.
        process: the engine, where this process has started it.
    """

    PING_S = protocol.SILENCE_S / 5
    """How often the engine is told that the client lives, s, where it is polled often enough."""
    LOST_ADVICE = "the writer closes the session by itself: look at it with 'polfuse info'"

    def __init__(self, directory: Path, process: subprocess.Popen[bytes] | None = None) -> None:
        self.directory = directory
        self._process = process
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, 200)
        self._pinged = self._heard = time.monotonic()
        self._ended = False
        """Whether the engine has said its last word."""
        self.pid = 0
        """Process id of the engine."""

    @classmethod
    def _launch(cls, request: protocol.Request) -> Self:
        """Start an engine, detached from this process and its terminal, and attach to it.

        Token and transport of the request are filled in. Raises :class:`PolfuseError` when it does not start.
        """
        private = directories.make()
        token = secrets.token_urlsafe(32)
        request = msgspec.structs.replace(request, token=token, transport=directories.transport(private))
        (private / directories.REQUEST).write_bytes(msgspec.msgpack.encode(request))
        (private / directories.TOKEN).write_text(token, encoding="utf-8")
        with open(private / directories.LOG, "wb") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "polfuse_lab.engine", str(private)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        client = cls(private, process)
        try:
            client._attach(START_S)
        except BaseException:
            client.close()
            process.kill()
            process.wait(5)
            directories.remove(private)
            raise
        return client

    @classmethod
    def attach(cls, directory: Path) -> Self:
        """Attach to a running engine (see :func:`polfuse_lab.engine.engines`). Raises :class:`PolfuseError`."""
        client = cls(directory)
        try:
            client._attach(5.0)
        except BaseException:
            client.close()
            raise
        return client

    def live(self) -> LiveView:
        """The live streams, which begin when somebody asks for them. The view may be used from any thread."""
        self._send(protocol.Watch())
        return LiveView(self.directory)

    @abstractmethod
    def poll(self, timeout_s: float = 0.2) -> Any:
        """Wait for the next word of the engine; None when there was none in time."""

    def close(self) -> None:
        """Leave. Idempotent."""
        if self._socket.closed:
            return
        with contextlib.suppress(zmq.ZMQError):
            self._send(protocol.Detach())
        self._socket.close()
        self._context.term()
        if self._process is not None and self._ended:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(10)
        if self._process is not None and self._process.poll() is None:
            # It goes on without us; whenever it ends, somebody must take note, or it stays a zombie.
            threading.Thread(target=self._process.wait, name="engine reaper", daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _attach(self, timeout_s: float) -> None:
        deadline = time.monotonic() + timeout_s
        while (known := directories.address(self.directory)) is None:
            if self._process is not None and self._process.poll() is not None:
                raise PolfuseError(
                    f"the engine did not start ({self._last_words()})", where="engine", advice="run 'polfuse doctor'"
                )
            if time.monotonic() > deadline:
                raise PolfuseError("no engine answers", where=str(self.directory), advice="start the collect again")
            time.sleep(0.02)
        self.pid = known.pid
        token = (self.directory / directories.TOKEN).read_text(encoding="utf-8")
        self._socket.connect(known.endpoint)
        self._send(protocol.Attach(protocol.PROTOCOL_VERSION, token))
        while self.poll(0.1) is None:
            if time.monotonic() > deadline:
                raise PolfuseError("the engine does not answer", where=str(self.directory), advice="end its process")

    def _ping(self) -> None:
        now = time.monotonic()
        if now - self._pinged > self.PING_S:
            self._send(protocol.Ping())
            self._pinged = now

    def _next(self, wait_ms: int) -> bytes | None:
        """The next message, waiting so long for it; None when there was none."""
        if not self._socket.poll(wait_ms):
            return None
        content = self._socket.recv()
        self._heard = time.monotonic()
        return content

    def _require_engine(self) -> None:
        """After nothing was heard. Raises :class:`PolfuseError` when the engine's process has ended."""
        if self._lost() and not self._socket.poll(300):
            # Its last word would have arrived by now.
            words = self._last_words()
            directories.remove(self.directory)
            raise PolfuseError(
                f"the engine's process ended unexpectedly ({words})", where="engine", advice=self.LOST_ADVICE
            )

    def _send(self, message: msgspec.Struct) -> None:
        with contextlib.suppress(zmq.Again):
            self._socket.send(protocol.encode(message), zmq.NOBLOCK)

    def _lost(self) -> bool:
        if self._process is not None:
            return self._process.poll() is not None
        if time.monotonic() - self._heard < 1.0:
            return False
        if os.name == "posix":
            try:
                os.kill(self.pid, 0)
            except ProcessLookupError:
                return True
            except PermissionError:
                return False
        return time.monotonic() - self._heard > DEAF_S

    def _last_words(self) -> str:
        try:
            text = (self.directory / directories.LOG).read_text(errors="replace")
        except OSError:
            return f"it left no message{self._code()}"
        # What the guard has done since is no reason; of a crash in native code the first line tells what it was.
        lines = [line for line in text.splitlines() if line.strip() and not line.startswith("guard: ")]
        fatal = [line for line in lines if line.startswith("Fatal Python error")]
        return (fatal or lines or [f"it left no message{self._code()}"])[-1]

    def _code(self) -> str:
        code = None if self._process is None else self._process.poll()
        if code is None:
            return ""
        return f", exit code {code}" if code >= 0 else f", ended by signal {-code}"
