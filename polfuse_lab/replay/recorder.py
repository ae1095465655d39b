"""Where a replay's records go: into the copy, with what no step asks for put back in its place."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterable
from pathlib import Path

from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import Event, Record, Sweeps
from polfuse_lab.replay.tape import Tape, ending
from polfuse_lab.scheduler import Recorder
from polfuse_lab.session.layout import STORAGE, SessionConfig

ORIGIN = ("host", "versions", "started", "start_unix_s", "start_host_ns")
"""What the copy's configuration takes over: the records' times are the recording's, so its clocks must be too."""
FULL_S = 0.01
"""Wait before a full queue is tried again."""


class ReplayRecorder:
    """Stands between the scheduler and a recorder, and moves the tape on. Implements the scheduler's ``Recorder``.

    Args:
        tape: what is replayed.
        inner: where records go in the end.
        on_event: told of each event before it is kept.
        before_flush: called before each flush; may raise what went wrong there in the recording.
    """

    def __init__(
        self, tape: Tape, inner: Recorder, *, on_event: Callable[[Event], None], before_flush: Callable[[], None]
    ) -> None:
        self._tape = tape
        self._inner = inner
        self._on_event = on_event
        self._before_flush = before_flush

    @property
    def free_bytes(self) -> int | None:
        """Free space on the disk."""
        return self._inner.free_bytes

    @property
    def failure(self) -> PolfuseError | None:
        """Why nothing more can be written."""
        return self._inner.failure

    def open(self, config: SessionConfig, *, expected_bytes: int = 0) -> None:
        """Declare the copy, with the recording's origin."""
        recorded = self._tape.session.config
        changed = dataclasses.replace(
            config,
            source="replay",
            extra=recorded["extra"],
            storage=recorded.get(STORAGE, config.storage),
            origin={name: recorded[name] for name in ORIGIN if name in recorded},
        )
        self._inner.open(changed, expected_bytes=expected_bytes)
        self._tape.rolling = True

    def offer(self, record: Record) -> bool:
        """Take a record, after the clock fixes and notes that were recorded before it."""
        if isinstance(record, Event):
            return self._offer_event(record)
        at = record.block.t_host_ns if isinstance(record, Sweeps) else getattr(record, "t_host_ns", None)
        if at is not None and not self._put_back(self._tape.unasked(at)):
            return False
        if not self._inner.offer(record):
            return False
        self._tape.kept(record)
        return True

    def flush(self) -> int:
        """Begin to bring everything to the disk."""
        self._before_flush()
        return self._inner.flush()

    def flushed(self, ticket: int) -> bool:
        """Whether that is done."""
        return self._inner.flushed(ticket)

    def close(self, state: str, reason: str) -> Path:
        """Finish the copy, as the recording ended if all of it has been played."""
        session = self._tape.session
        if self._over():
            state, reason = session.state, session.reason
        return self._inner.close(state, reason)

    def kill(self) -> None:
        """Give up."""
        self._inner.kill()

    def _over(self) -> bool:
        return self._tape.played_out and not self._tape.finished

    def _offer_event(self, event: Event) -> bool:
        if ending(event.kind):
            return self._offer_ending(event)
        self._on_event(event)
        recorded = self._tape.event()
        # What the scheduler does again it does at the recorded time.
        same = recorded is not None and (recorded.kind, recorded.text) == (event.kind, event.text)
        if not self._inner.offer(recorded if same and recorded is not None else event):
            return False
        if same:
            self._tape.kept(event)
        if event.kind == "look":
            self._tape.looked()
        return True

    def _offer_ending(self, event: Event) -> bool:
        """The last event, after all that only the end of the recording explains."""
        tape = self._tape
        if not tape.finished and tape.at_end:
            self._insist(tape.tail())
        if not tape.played_out:
            return self._inner.offer(event)
        self._insist(tape.unasked(None))
        while (recorded := tape.event()) is not None:
            self._insist([recorded])
            tape.kept(recorded)
        return self._over() or event.kind == tape.session.state or self._inner.offer(event)

    def _put_back(self, records: Iterable[Record]) -> bool:
        return all(self._inner.offer(record) for record in records)

    def _insist(self, records: Iterable[Record]) -> None:
        """Give records to the writer when nobody offers them again: wait while its queue is full."""
        for record in records:
            while not self._inner.offer(record):
                time.sleep(FULL_S)


class NoCopy:
    """A recorder for replays that are only watched: everything is accepted, nothing is written."""

    free_bytes: int | None = None
    failure: PolfuseError | None = None

    def __init__(self, path: Path) -> None:
        self._path = path

    def open(self, config: SessionConfig, *, expected_bytes: int = 0) -> None:
        """Nothing to declare."""

    def offer(self, record: Record) -> bool:
        """Take a record."""
        return True

    def flush(self) -> int:
        """Nothing to flush."""
        return 0

    def flushed(self, ticket: int) -> bool:
        """Always."""
        return True

    def close(self, state: str, reason: str) -> Path:
        """The name that the copy would have had."""
        return self._path

    def kill(self) -> None:
        """Nothing to end."""
