"""The engine's end of the writer's process: records are queued, never dropped; a full queue is said."""

from __future__ import annotations

import contextlib
import dataclasses
import queue
import subprocess
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

from polfuse_lab.engine.children import start_child
from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import Record
from polfuse_lab.session import wire
from polfuse_lab.session.birth import discard_unborn
from polfuse_lab.session.layout import SessionConfig
from polfuse_lab.session.naming import partial_path

QUEUE_BYTES = 128_000_000
HURRY_BYTES = 16_000_000
"""With so much in the queue the writer is behind, and leaves out compression until it has caught up."""
FLUSH_EVERY_S = 1.0
STALL_S = 30.0


class WriterProcess:
    """A session writer in a process of its own. Methods return at once, except :meth:`open` and :meth:`close`.

    Args:
        path: the session file.
        extra: entries that are added to the configuration's ``extra``.
    """

    def __init__(self, path: Path, extra: Mapping[str, Any] | None = None) -> None:
        self.path = path
        self._extra = dict(extra or {})
        self.free_bytes: int | None = None
        """Free space on the disk as of the last flush."""
        self._failure: PolfuseError | None = None
        self._queue: queue.SimpleQueue[list[wire.Payload] | None] = queue.SimpleQueue()
        self._queued = 0
        self._lock = threading.Lock()
        self._created = threading.Event()
        self._ended = threading.Event()
        self._closed_path: Path | None = None
        self._asked = 0
        self._answered = 0
        self._waiting_since: float | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._threads: list[threading.Thread] = []

    def open(self, config: SessionConfig, *, expected_bytes: int = 0, timeout_s: float = 30.0) -> None:
        """Start the process and declare the session.

        Raises:
            PolfuseError: the file cannot be created, or the process does not start in time.
        """
        self._process = start_child("polfuse_lab.session.writer_process", answers=True)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        for target, stream in ((self._send, self._process.stdin), (self._receive, self._process.stdout)):
            thread = threading.Thread(target=target, args=(stream,), name=f"writer {target.__name__}", daemon=True)
            thread.start()
            self._threads.append(thread)
        fields = wire.config_fields(dataclasses.replace(config, extra={**config.extra, **self._extra}))
        self._put(
            wire.encode({"kind": "create", "path": str(self.path), "config": fields, "expected_bytes": expected_bytes})
        )
        deadline = time.monotonic() + timeout_s
        while not self._created.wait(0.02):
            if self.failure is not None:
                self.kill()
                discard_unborn(self.path)
                raise self.failure
            if time.monotonic() > deadline:
                self.kill()
                discard_unborn(self.path)
                raise PolfuseError("the writer's process did not start", where=str(self.path), advice="try again")

    @property
    def pid(self) -> int:
        """Process id of the writer."""
        assert self._process is not None
        return self._process.pid

    @property
    def failure(self) -> PolfuseError | None:
        """Why nothing more can be written, None while all is well."""
        with self._lock:
            stalled = self._waiting_since is not None and time.monotonic() - self._waiting_since > STALL_S
            if self._failure is None and stalled:
                self._failure = PolfuseError(
                    f"the disk has not answered for {STALL_S:.0f} s", where=str(self.path), advice="check the disk"
                )
            return self._failure

    def offer(self, record: Record) -> bool:
        """Queue a record; False when the queue is full (offer it again). Raises the writer's failure."""
        self._check()
        header, payload = wire.record_message(record)
        pieces = wire.encode({**header, "plain": self._queued > HURRY_BYTES} if payload else header, payload)
        size = sum(map(len, pieces))
        with self._lock:
            if self._queued and self._queued + size > QUEUE_BYTES:
                return False
        self._put(pieces)
        return True

    def flush(self) -> int:
        """Ask for everything queued so far to be brought to the disk; return a ticket. Raises the writer's failure."""
        self._check()
        return self._ask_flush(durable=True)

    def flushed(self, ticket: int) -> bool:
        """Whether a flush is done. Raises the writer's failure."""
        self._check()
        return self._answered >= ticket

    def close(self, state: str, reason: str, timeout_s: float = 60.0) -> Path:
        """Write what is queued, close the session and end the process.

        Returns:
            The finished file.

        Raises:
            PolfuseError: the session could not be closed; says where the data are.
        """
        self._put(wire.encode({"kind": "close", "state": state, "reason": reason}))
        self._queue.put(None)
        self._ended.wait(timeout_s)
        self.kill()
        if self._closed_path is not None:
            return self._closed_path
        raise self._failure or PolfuseError(
            f"the session was not closed within {timeout_s:.0f} s",
            where=str(partial_path(self.path)),
            advice="check the disk, then run 'polfuse recover'",
        )

    def kill(self) -> None:
        """End the process, whatever it does. Idempotent."""
        self._queue.put(None)
        process = self._process
        if process is None:
            return
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(0.5 if self._ended.is_set() else 0)
        if process.poll() is None:
            process.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(5)
        for thread in self._threads:
            thread.join(1)

    def _check(self) -> None:
        failure = self.failure
        if failure is not None:
            raise failure

    def _put(self, pieces: list[wire.Payload]) -> None:
        with self._lock:
            self._queued += sum(map(len, pieces))
        self._queue.put(pieces)

    def _ask_flush(self, *, durable: bool) -> int:
        with self._lock:
            self._asked += 1
            ticket = self._asked
            if self._waiting_since is None:
                self._waiting_since = time.monotonic()
        self._put(wire.encode({"kind": "flush", "durable": durable, "ticket": ticket}))
        return ticket

    def _send(self, stream: IO[bytes]) -> None:
        flushed = time.monotonic()
        try:
            while True:
                try:
                    pieces = self._queue.get(timeout=max(flushed + FLUSH_EVERY_S - time.monotonic(), 0.01))
                except queue.Empty:
                    pieces = []
                if pieces is None:
                    break
                for piece in pieces:
                    stream.write(piece)
                stream.flush()
                with self._lock:
                    self._queued -= sum(map(len, pieces))
                    idle = self._waiting_since is None
                    if not idle:
                        # It goes on, however slowly.
                        self._waiting_since = time.monotonic()
                if self._created.is_set() and idle and time.monotonic() - flushed > FLUSH_EVERY_S:
                    self._ask_flush(durable=False)
                    flushed = time.monotonic()
        except (OSError, ValueError):
            return  # The process has ended; the receiving thread says why.
        finally:
            with contextlib.suppress(OSError):
                stream.close()

    def _receive(self, stream: IO[bytes]) -> None:
        try:
            while (message := wire.read_message(stream.read)) is not None:
                self._take(message[0])
        finally:
            with self._lock:
                if self._closed_path is None and self._failure is None:
                    self._failure = PolfuseError(
                        "the writer's process ended unexpectedly",
                        where=str(partial_path(self.path)),
                        advice=f"rescue the data with 'polfuse recover {partial_path(self.path)} -o NEW.h5'",
                    )
            self._ended.set()
            stream.close()

    def _take(self, header: dict[str, Any]) -> None:
        match header["kind"]:
            case "created":
                self._created.set()
            case "flushed":
                with self._lock:
                    self._answered = header["ticket"]
                    self.free_bytes = header["free_bytes"]
                    self._waiting_since = None if self._answered == self._asked else time.monotonic()
            case "closed":
                self._closed_path = Path(header["path"])
            case "error":
                with self._lock:
                    self._failure = PolfuseError(header["what"], where=header["where"], advice=header["advice"])
