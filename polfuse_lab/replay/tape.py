"""A session as a tape: for each device the next record that it reported, moved on when that record is kept again."""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.records import ClockFix, PolarizerFix, SwitchState, TrolleyFix
from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import Event, Exposure, Note, Observed, Record, SourceFix, Sweeps
from polfuse_lab.replay.incidents import ENDINGS, Incident, LookTaken, Loss, Pause, incidents, looks
from polfuse_lab.replay.records import event, exposure, plain_record, sweeps
from polfuse_lab.scheduler import Aborted
from polfuse_lab.session import Session
from polfuse_lab.session.layout import UNASKED

DEVICES = ("radar", "switches", "trolley", "camera", "polarizer", "source_polarizer")
TABLES = {
    "radar": "sweeps",
    "camera": "frames",
    "switches": "switches",
    "trolley": "trolley",
    "polarizer": "polarizer",
    "source_polarizer": "source_polarizer",
    "clocks": "clocks",
    "notes": "notes",
    "events": "events",
}
"""Table of the session that holds the records of each track of the tape."""
ANSWERED_IN_VAIN = 200
"""A record that is reported so often and never kept is not what the scheduler waits for."""
TAIL_NS = 2_000_000_000
"""Tables of a session whose writer was stopped may end at different records within so long (it flushes each second)."""


class RecordingEnds(DeviceError):
    """The recording ends here, since the original run failed; ``str()`` is its reason."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason, where="recording", advice="")

    def __str__(self) -> str:
        return self.what


class Diverged(DeviceError):
    """The scheduler asks for something else than was recorded."""


class Interrupted(DeviceError):
    """A device was lost before the record that was asked for; the control raises that device's own error instead."""


class Tape:
    """Where a replay stands in a session. Thread-safe.

    Raises:
        PolfuseError: the session cannot be read, or is of a kind that cannot be replayed.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.recovering = False
        """Whether a device has been lost and is not back yet; what it says meanwhile is in no table."""
        self.rolling = False
        """Whether records are taken from the tape; before that devices are only listened to."""
        self.pause_due = False
        """Whether the user paused here, in the middle of a step."""
        self.at_end = False
        """Whether a device has been asked for what the recording no longer holds."""
        self.finished = session.state == "finished"
        self._looks = looks(session.events)
        self._incidents = incidents(session.events, str(session.path))
        self._times: dict[str, NDArray[np.int64]] = {
            track: np.asarray(getattr(session, table)["t_host_ns"]) for track, table in TABLES.items()
        }
        self._times["looks"] = np.array([look.t_host_ns for look in self._looks], np.int64)
        self._next: Counter[str] = Counter()
        self._answers: Counter[str] = Counter()
        self._due: Loss | None = None
        self._lost: Loss | None = None
        self._lock = threading.RLock()

    @property
    def start_ns(self) -> int:
        """Host time of the first record."""
        return min((int(times[0]) for times in self._times.values() if len(times)), default=0)

    @property
    def end_ns(self) -> int:
        """Host time of the last record."""
        return max((int(times.max()) for times in self._times.values() if len(times)), default=0)

    @property
    def played_out(self) -> bool:
        """Whether every record of every device has been kept."""
        return all(self.left(track) == 0 for track in (*DEVICES, "looks"))

    @property
    def incident(self) -> Incident | None:
        """The next pause or loss."""
        with self._lock:
            return self._incidents[0] if self._incidents else None

    def left(self, track: str) -> int:
        """Records of a track that have not been kept yet."""
        return len(self._times[track]) - self._next[track]

    def next_ns(self, track: str) -> int | None:
        """Host time of a track's next record; None at its end."""
        with self._lock:
            return int(self._times[track][self._next[track]]) if self.left(track) else None

    def ask(self, track: str) -> int:
        """Number of a device's next record.

        Raises:
            Interrupted: a device was lost before; it is due.
            Aborted: the recording was aborted here.
            RecordingEnds: the recording failed here.
            Diverged: the recording is whole and holds no more records.
        """
        with self._lock:
            at = self.next_ns(track)
            incident = self.incident
            if isinstance(incident, Loss) and (at is None or at > incident.t_host_ns):
                self._due = incident
                raise Interrupted("interrupted", where=track, advice="")
            if at is None:
                raise self.end(track)
            return self._next[track]

    def observed(self, track: str, record: int) -> list[Observed]:
        """What a device was seen to do while a record was taken: the rows that follow and belong to it."""
        with self._lock:
            rows = getattr(self.session, TABLES[track])["record"]
            found: list[Observed] = []
            for number in range(self._next[track], len(rows)):
                seen = self._plain(track, number) if rows[number] == record else None
                if not isinstance(seen, Observed):
                    break
                found.append(seen)
            return found

    def lost_next(self, track: str) -> bool:
        """Whether a device was lost before its next record, in a recording that looked at it during records."""
        with self._lock:
            incident, at = self.incident, self.next_ns(track)
            lost = isinstance(incident, Loss) and incident.kind == track
            before = lost and incident is not None and (at is None or at > incident.t_host_ns)
            return before and bool((getattr(self.session, TABLES[track])["record"] != UNASKED).any())

    def pauses(self, track: str) -> bool:
        """Whether the user paused, in the middle of a step, before a device's next record; it is due then."""
        with self._lock:
            incident, at = self.incident, self.next_ns(track)
            if isinstance(incident, Pause) and incident.inside and (at is None or at > incident.t_host_ns):
                self.pause_due = True
            return self.pause_due

    def answered(self, track: str) -> None:
        """A device has reported its next record. Raises :class:`Diverged` when that is never what is waited for."""
        with self._lock:
            self._answers[track] += 1
            if self._answers[track] > ANSWERED_IN_VAIN:
                raise Diverged("waits for something else than was recorded", where=track, advice=_ADVICE)

    def end(self, track: str) -> Exception:
        """What a device says when it is asked beyond the end of the recording."""
        self.at_end = True
        if self.finished:
            return Diverged("is asked for more than was recorded", where=track, advice=_ADVICE)
        if self.session.state == "aborted":
            return Aborted(self.session.reason)
        return RecordingEnds(self.session.reason)

    def look(self) -> LookTaken:
        """The next frame of a search for an exposure. Raises as :meth:`ask`."""
        return self._looks[self.ask("looks")]

    def take_incident(self) -> None:
        """The next pause or loss has happened."""
        with self._lock:
            incident = self._incidents.popleft()
            self._due = None
            self.pause_due = False
            if isinstance(incident, Loss):
                self._lost = incident
                self.recovering = True

    @property
    def due(self) -> Loss | None:
        """The loss that a device has run into."""
        return self._due

    @property
    def lost(self) -> Loss | None:
        """The loss that happened last."""
        return self._lost

    def kept(self, record: Record) -> None:
        """A record of the tape is in the copy: move on."""
        with self._lock:
            self._move_on(_track(record))

    def looked(self) -> None:
        """A frame of a search for an exposure has been looked at: move on."""
        with self._lock:
            self._move_on("looks")

    def event(self) -> Event | None:
        """The recording's next event."""
        with self._lock:
            return event(self.session, self._next["events"]) if self.left("events") else None

    def unasked(self, until_ns: int | None) -> Iterator[Record]:
        """Clock fixes and notes up to a time (None: all), which no step asks for; kept when passed on."""
        for track in ("clocks", "notes"):
            while (at := self.next_ns(track)) is not None and (until_ns is None or at <= until_ns):
                yield self._plain(track, self._next[track])
                self._next[track] += 1

    def tail(self) -> Iterator[Record]:
        """What is left at the end of a recording that broke off: its tables need not end at the same record."""
        since = self.end_ns - TAIL_NS
        for track in DEVICES:
            while (at := self.next_ns(track)) is not None:
                record = self._record(track, self._next[track])
                # What was seen during a record is kept at its end, and is as old as its beginning.
                if at < since and not isinstance(record, Observed):
                    break
                yield record
                self._next[track] += 1

    def _move_on(self, track: str) -> None:
        if self.left(track):
            self._next[track] += 1
            self._answers[track] = 0

    def _record(self, track: str, number: int) -> Record:
        if track == "radar":
            return sweeps(self.session, number)
        return exposure(self.session, number) if track == "camera" else self._plain(track, number)

    def _plain(self, track: str, number: int) -> Record:
        return plain_record(self.session, TABLES[track], number)


_ADVICE = "the session was recorded by another version, or its file was changed: compare the two files"


def _track(record: Record) -> str:
    match record:
        case Sweeps():
            return "radar"
        case Exposure():
            return "camera"
        case SwitchState():
            return "switches"
        case TrolleyFix():
            return "trolley"
        case PolarizerFix():
            return "polarizer"
        case SourceFix():
            return "source_polarizer"
        case Observed(state):
            return _track(state)
        case ClockFix():
            return "clocks"
        case Note():
            return "notes"
        case Event():
            return "events"


def ending(kind: str) -> bool:
    """Whether an event of this kind tells how the session ended."""
    return kind in ENDINGS


def require_replayable(session: Session) -> None:
    """Check that a session can be replayed. Raises :class:`PolfuseError` with the reason where it cannot."""
    where = str(session.path)
    source: Any = session.config["source"]
    if session.state == "recording":
        raise PolfuseError(
            "was never closed", where=where, advice=f"run 'polfuse recover {where} -o NEW.h5' and replay that"
        )
    if session.plan is None or session.rig is None:
        raise PolfuseError(
            f"holds no plan to carry out (its source is '{source}')",
            where=where,
            advice="only sessions of 'polfuse collect' can be replayed; read this one with 'polfuse range'",
        )
