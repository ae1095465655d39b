"""The way of records from a run into its session: none is lost between a device and the recorder's queue."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import Event, Note, Record
from polfuse_lab.scheduler.seams import Recorder, Viewer

LAST_WORDS_S = 10.0
"""Longest wait for room in the recorder's queue for what tells how the run ended."""


class Keeper:
    """Gives records to a recorder and a viewer, in their order. :meth:`note` may be used from other threads.

    Args:
        recorder: where records go; it notices a disk that makes no progress.
        viewer: who looks at them, if anybody.
        wait: waits a little; raises when the run is to stop.
        output: the session file, for errors.
    """

    def __init__(self, recorder: Recorder, viewer: Viewer | None, wait: Callable[[], None], output: Path) -> None:
        self._recorder = recorder
        self._viewer = viewer
        self._wait = wait
        self._output = output
        self._lock = threading.Lock()
        self._notes: list[Note] = []
        self._ended = False
        self._unkept: deque[Record] = deque()
        """Records that wait for room in the recorder's queue, oldest first."""
        self._flushing: int | None = None
        """Ticket of the flush that the last checkpoint began, until it is confirmed."""

    def note(self, text: str) -> bool:
        """Add a remark; False when it comes too late, after the last record."""
        with self._lock:
            if self._ended:
                return False
            self._notes.append(Note(text, time.monotonic_ns()))
        return True

    def keep(self, record: Record) -> None:
        """Give a record to the viewer and to the session, waiting while its queue is full.

        Raises:
            PolfuseError: the recorder failed.
            Aborted: the run is to stop; the record is kept all the same, when there is room again.
        """
        if self._viewer is not None:
            self._viewer.offer(record)
        self._unkept.append(record)
        # One that an abort or a lost device keeps from the queue is first in line when there is room again.
        while self._unkept:
            if self._recorder.offer(self._unkept[0]):
                self._unkept.popleft()
            else:
                self._wait()

    def event(self, kind: str, text: str) -> None:
        """Keep what happened. Raises as :meth:`keep`."""
        self.keep(Event(kind, text, time.monotonic_ns()))

    def drain_notes(self) -> None:
        """Give remarks to the session as far as there is room; does not wait."""
        with self._lock:
            notes, self._notes = self._notes, []
        for number, note in enumerate(notes):
            if not self._recorder.offer(note):
                with self._lock:
                    self._notes[:0] = notes[number:]
                return

    def begin_flush(self) -> None:
        """At a checkpoint: bring everything to the disk while the next position is approached.

        The flush of the checkpoint before is confirmed first, so that at most one position is not on the disk.
        """
        self.confirm()
        self.drain_notes()
        self._flushing = self._recorder.flush()

    def flush(self) -> None:
        """Bring everything to the disk and wait until it is there."""
        self.begin_flush()
        self.confirm()

    def confirm(self) -> None:
        """Wait until what the last flush brings to the disk is there. Raises as :meth:`keep`."""
        if self._flushing is None:
            return
        while not self._recorder.flushed(self._flushing):
            self._wait()
        self._flushing = None

    def finish(self, state: str, reason: str, troubles: list[str]) -> None:
        """Keep the last notes and how the run ended, waiting for room in the recorder's queue; notes come too late now.

        Raises:
            PolfuseError: the recorder failed, or made no room.
        """
        with self._lock:
            last: list[Record] = [*self._unkept, *self._notes]
            self._notes = []
            self._ended = True
        last += [Event("unsafe", text, time.monotonic_ns()) for text in troubles]
        last.append(Event(state, reason, time.monotonic_ns()))
        end = time.monotonic() + LAST_WORDS_S
        for record in last:
            while not self._recorder.offer(record):
                if time.monotonic() > end:
                    raise PolfuseError(
                        f"the disk took nothing for {LAST_WORDS_S:.0f} s at the end",
                        where=str(self._output),
                        advice="check the disk; everything before that is in the file",
                    )
                time.sleep(0.01)
