"""What happened in a recording besides its plan: pauses, lost devices, looks for an exposure. Read from its events."""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceLost
from polfuse_lab.errors import PolfuseError

ENDINGS = ("finished", "aborted", "failed")
"""Kinds of the event with which the scheduler ends a session."""

_PAUSED = re.compile(r".* (before|in) step (\d+)$")
_LOST = re.compile(r"(\w+) in step (\d+): (.*)$", re.DOTALL)
_RESUMED = re.compile(r"repeating from step (\d+)")
_LOOK = re.compile(r"exposure (\S+) s of (\S+) to (\S+) s, brightest pixel (\d+) counts$")


@dataclass(frozen=True)
class Pause:
    """The user paused before a step (index from 0)."""

    step: int
    t_host_ns: int
    inside: bool = False
    """In the middle of the step: a pass that was stopped, to be repeated."""


@dataclass(frozen=True)
class Loss:
    """A device was lost in a step (index from 0)."""

    kind: str
    step: int
    text: str
    """The device's error, one sentence."""
    came_back: bool
    t_host_ns: int

    @property
    def error(self) -> DeviceLost:
        """The error as the driver raised it."""
        where, found, rest = self.text.partition(": ")
        if not found:
            where, rest = self.kind, self.text
        what, found, advice = rest.rpartition("; ")
        return DeviceLost(what, where=where, advice=advice) if found else DeviceLost(rest, where=where, advice="")


@dataclass(frozen=True)
class LookTaken:
    """A frame taken in the search for an exposure, of which only this is known."""

    exposure_s: float
    limits_s: tuple[float, float]
    peak_counts: int
    t_host_ns: int


Incident = Pause | Loss


def incidents(events: NDArray[np.void], where: str) -> deque[Incident]:
    """Pauses and losses in the order in which they happened.

    Args:
        events: a session's table of events.
        where: the session's name, for errors.

    Raises:
        PolfuseError: an event does not say in which step it happened.
    """
    found: deque[Incident] = deque()
    for number, row in enumerate(events):
        kind, text, t_host_ns = _kind(row), _text(row), int(row["t_host_ns"])
        if kind == "paused":
            match = _PAUSED.match(text)
            if match is None:
                raise _unplaced(kind, where)
            found.append(Pause(int(match[2]) - 1, t_host_ns, match[1] == "in"))
        elif kind == "lost":
            match = _LOST.match(text)
            if match is None:
                raise _unplaced(kind, where)
            came_back = number + 1 < len(events) and _kind(events[number + 1]) == "back"
            found.append(Loss(match[1], int(match[2]) - 1, match[3], came_back, t_host_ns))
    return found


def looks(events: NDArray[np.void]) -> list[LookTaken]:
    """Frames taken in searches for an exposure, in order."""
    found = []
    for row in events:
        match = _LOOK.match(_text(row)) if _kind(row) == "look" else None
        if match is not None:
            limits = (float(match[2]), float(match[3]))
            found.append(LookTaken(float(match[1]), limits, int(match[4]), int(row["t_host_ns"])))
    return found


def rewound_to(text: str) -> int | None:
    """Step (index from 0) that an event of kind "resumed" begins again from."""
    match = _RESUMED.match(text)
    return int(match[1]) - 1 if match is not None else None


def _unplaced(kind: str, where: str) -> PolfuseError:
    return PolfuseError(
        f"does not say in which step it was {kind}: it was recorded by an earlier version",
        where=where,
        advice="replay a session of this version; its records can be read as before",
    )


def _kind(row: np.void) -> str:
    return bytes(row["kind"]).decode()


def _text(row: np.void) -> str:
    return bytes(row["text"]).decode()
