"""The campaign's end of the tap: what the engine and its devices told, line by line, and what follows from it."""

from __future__ import annotations

import fcntl
import json
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PIPE_BYTES = 1 << 20
BEGUN = "beginning the session file"


@dataclass(frozen=True)
class Line:
    """Something told: when (host's monotonic ns), what, and its details."""

    t_ns: int
    kind: str
    words: tuple[Any, ...]


@dataclass(frozen=True)
class Told:
    """A record given to the writer: ``audio`` (by its first frame), ``frame`` (by its number) or a table's row."""

    kind: str
    number: int
    frames: int
    position: int


class TapLog:
    """Reads the pipe in a thread of its own until :meth:`close`."""

    def __init__(self, path: Path) -> None:
        os.mkfifo(path)
        # Open for both: the pipe stays when those who write into it are killed.
        self._pipe = os.open(path, os.O_RDWR | os.O_NONBLOCK)
        fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, PIPE_BYTES)
        os.set_blocking(self._pipe, True)
        self._lines: list[Line] = []
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._read, name="tap", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Take in what is left, and end."""
        os.write(self._pipe, b"\n")
        self._thread.join(5)
        os.close(self._pipe)

    def wait_for(self, wanted: Callable[[Line], bool], count: int, timeout_s: float) -> bool:
        """Wait for the ``count``-th line of a kind; False when it has not come in time."""
        end = time.monotonic() + timeout_s
        seen = taken = 0
        with self._changed:
            while True:
                for line in self._lines[seen:]:
                    taken += wanted(line)
                if taken >= count:
                    return True
                seen = len(self._lines)
                if not self._changed.wait(max(end - time.monotonic(), 0.0)) and time.monotonic() > end:
                    return False

    def lines(self, kind: str | None = None) -> list[Line]:
        """All lines so far, or those of a kind."""
        with self._changed:
            return [line for line in self._lines if kind is None or line.kind == kind]

    @property
    def queued(self) -> list[Told]:
        """What the writer's queue took, in order."""
        return [Told(*line.words[1:]) for line in self.lines("queued")]

    @property
    def confirmed(self) -> int:
        """How many of :attr:`queued` the writer has confirmed to be flushed (of a session that it closed: all)."""
        before = {line.words[0]: line.words[1] for line in self.lines("asked")}
        answers = self.lines("answer")
        if any(line.words[0] == "closed" for line in answers):
            return len(self.queued)
        return max((before.get(line.words[1], 0) for line in answers if line.words[0] == "flushed"), default=0)

    def delivered(self) -> list[tuple[int, str, int]]:
        """(when, kind, number) of all audio blocks and frames that devices delivered once the session had begun."""
        lines = self.lines()
        begun = next((n for n, line in enumerate(lines) if line.kind == "phase" and line.words[1] == BEGUN), len(lines))
        return [(line.t_ns, line.kind, line.words[0]) for line in lines[begun:] if line.kind in ("audio", "frame")]

    def phase_at(self, t_ns: int) -> str:
        """What the engine was at: starting, preparing, moving, recording, optics, flushing, between or closing."""
        flushing = False
        phase = "starting"
        for line in self.lines():
            if line.t_ns > t_ns:
                break
            if line.kind == "phase":
                phase = phase_of(*line.words)
            elif line.kind == "asking" and line.words[0]:
                flushing = True
            elif line.kind == "answer" and line.words[0] == "flushed":
                flushing = False
        return "flushing" if flushing and phase not in ("starting", "preparing", "closing") else phase

    def moves_before(self, t_ns: int) -> int:
        """How many moves had begun."""
        return sum(line.t_ns <= t_ns and phase_of(*line.words) == "moving" for line in self.lines("phase"))

    def _read(self) -> None:
        rest = b""
        while True:
            rest += os.read(self._pipe, 65_536)
            *whole, rest = rest.split(b"\n")
            made = [Line(t_ns, kind, tuple(words)) for t_ns, kind, *words in map(json.loads, filter(None, whole))]
            with self._changed:
                self._lines += made
                self._changed.notify_all()
            if b"" in whole:
                return


def phase_of(state: str, reason: str) -> str:
    """A phase by the scheduler's state and the step in words."""
    if state in ("stopping", "finished"):
        return "closing"
    if state in ("idle", "preparing"):
        return "preparing"
    if state == "paused":
        return "recovering"
    for phase, beginnings in _STEPS.items():
        if reason.startswith(beginnings):
            return phase
    return "between"


_STEPS = {
    "moving": ("moving",),
    "recording": ("recording",),
    "optics": ("turning", "taking", "finding", "beginning to turn"),
    "flushing": ("saving",),
}
