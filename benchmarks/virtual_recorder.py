"""A recorder in virtual time: records cross the writer's messages, and the writer itself writes them when time comes.

It is as slow as it is told to be: a queue that is full for a while, flushes that take long, a disk that fails.
"""

from __future__ import annotations

import io
from collections import deque
from pathlib import Path

from benchmarks.virtual_time import VirtualClock
from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import Record
from polfuse_lab.session import wire
from polfuse_lab.session.layout import SessionConfig
from polfuse_lab.session.naming import partial_path
from polfuse_lab.session.writer import SessionWriter

WRITE_S = 0.002
"""From a record's offer until the writer has it, s."""


class VirtualRecorder:
    """Implements the scheduler's ``Recorder``."""

    def __init__(self, path: Path, clock: VirtualClock) -> None:
        self.free_bytes: int | None = None
        self.failure: PolfuseError | None = None
        self.full_until_ns = 0
        """Until then the queue is full."""
        self.flush_s = 0.004
        """Time that a flush takes, s."""
        self.confirmed = 0
        """Ticket of the newest flush that is done."""
        self.lost = 0
        """Records given to a writer that had failed."""
        self._path = path
        self._clock = clock
        self._writer: SessionWriter | None = None
        self._queue: deque[tuple[int, bytes]] = deque()
        self._flushes: deque[tuple[int, int]] = deque()
        self._asked = 0
        clock.on_advance(self._work)

    def open(self, config: SessionConfig, *, expected_bytes: int = 0) -> None:
        """Declare the session."""
        plain = wire.config_from(wire.config_fields(config))
        self._writer = SessionWriter.create(self._path, plain, ballast_bytes=1000)

    @property
    def begun(self) -> bool:
        """Whether a session has been declared."""
        return self._writer is not None

    def offer(self, record: Record) -> bool:
        """Queue a record, unless the queue is full. Raises the writer's failure."""
        self._check()
        if self._clock.now_ns < self.full_until_ns:
            return False
        pieces = wire.encode(*wire.record_message(record))
        self._queue.append((self._clock.now_ns, b"".join(map(bytes, pieces))))
        return True

    def flush(self) -> int:
        """Begin a flush. Raises the writer's failure."""
        self._check()
        self._asked += 1
        self._flushes.append((self._asked, self._clock.now_ns + round(self.flush_s * 1e9)))
        return self._asked

    def flushed(self, ticket: int) -> bool:
        """Whether a flush is done. Raises the writer's failure."""
        self._check()
        return self.confirmed >= ticket

    def fail(self) -> None:
        """Fault: the disk is full. The writer closes the file with what it has, as it does on a real one."""
        if self._writer is None or self.failure is not None:
            return
        self.lost = len(self._queue)
        self._queue.clear()
        saved = self._writer.close("failed", "the disk is full")
        self.failure = PolfuseError(
            f"the disk is full; everything before that is kept in {saved.name}", where=str(saved), advice="free some"
        )

    def close(self, state: str, reason: str) -> Path:
        """Write what is queued and finish the session. Raises the writer's failure."""
        self._check()
        assert self._writer is not None
        self._write(self._clock.now_ns)
        self._flushes.clear()
        return self._writer.close(state, reason)

    def kill(self) -> None:
        """Give up what is queued."""
        self._queue.clear()

    @property
    def path(self) -> Path:
        """Where the session is at present."""
        partial = partial_path(self._path)
        return partial if partial.exists() else self._path

    def _check(self) -> None:
        if self.failure is not None:
            raise self.failure

    def _work(self) -> None:
        now = self._clock.now_ns
        self._write(now - round(WRITE_S * 1e9))
        while self._flushes and self._flushes[0][1] <= now and self.failure is None and self._writer is not None:
            ticket, _ = self._flushes.popleft()
            self._write(now)
            self._writer.flush()
            self.confirmed = ticket

    def _write(self, until_ns: int) -> None:
        while self._queue and self._queue[0][0] <= until_ns and self.failure is None and self._writer is not None:
            _, message = self._queue.popleft()
            read = wire.read_message(io.BytesIO(message).read)
            assert read is not None
            self._writer.write(wire.record_from(*read))
