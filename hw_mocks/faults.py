"""Faults on demand for simulated devices, scripted by time or by count, or switched by hand.

A device asks its :class:`FaultScript` whether a kind of fault is active now (:meth:`FaultScript.active`) and misbehaves
accordingly; what each kind means to a device, and what its ``amount`` is, the device documents. A count is whatever the
device counts: bytes sent, lines, moves, packets, frames.
"""

from __future__ import annotations

import enum
import math
import re
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass


class FaultKind(enum.Enum):
    """What can go wrong."""

    SILENCE = "silence"
    """The device hears but does not answer."""
    GARBAGE = "garbage"
    """The device answers random bytes."""
    PARTIAL_LINE = "partial_line"
    """Answers break off in the middle."""
    SLOW = "slow"
    """Answers come late, by ``amount`` seconds."""
    DISCONNECT = "disconnect"
    """The cable is out; it is put back when the fault ends."""
    STUCK_SWITCH = "stuck_switch"
    """A switch does not follow; ``amount`` is its number (0: all)."""
    LOST_STEPS = "lost_steps"
    """The motor loses steps; ``amount`` is the distance or angle that is lost (m, rad)."""
    STALL = "stall"
    """What moves or streams stands still."""
    OVERFLOW = "overflow"
    """The host's buffer overflows; ``amount`` is the number of samples lost each time."""
    DROP_PACKETS = "drop_packets"
    """A fraction ``amount`` of the packets is lost."""
    DROP_FRAMES = "drop_frames"
    """A fraction ``amount`` of the frames is lost (0: all of them)."""
    WRONG_FORMAT = "wrong_format"
    """Data come in another format than agreed."""
    CLOCK_JUMP = "clock_jump"
    """The device's clock is off by ``amount`` seconds."""
    HEAT_ALARM = "heat_alarm"
    """The device is too hot and refuses to work."""


@dataclass(frozen=True)
class Fault:
    """One fault: when it begins, how long it lasts, how strong it is.

    It begins once ``after_s`` seconds have passed since the script began *and* the device's count has reached
    ``after_count`` (each only where given; neither: at once), and ends ``for_s`` seconds or ``for_count`` counts later,
    whichever comes first (neither: never).

    Raises:
        ValueError: a time or count is negative or not finite.
    """

    kind: FaultKind
    after_s: float | None = None
    after_count: int | None = None
    for_s: float | None = None
    for_count: int | None = None
    amount: float = 0.0

    def __post_init__(self) -> None:
        for name in ("after_s", "after_count", "for_s", "for_count"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{name}: found {value}, allowed: a finite number of at least 0")
        if not math.isfinite(self.amount):
            raise ValueError(f"amount: found {self.amount}, allowed: a finite number")


class _Course:
    """What has become of one fault of a script."""

    def __init__(self, fault: Fault, origin_ns: int) -> None:
        self.fault = fault
        self._earliest_ns = origin_ns + round((fault.after_s or 0.0) * 1e9)
        self._start_ns: int | None = None
        self._start_count: int | None = None
        self.over = False

    def active(self, now_ns: int, count: int | None) -> bool:
        if self.over:
            return False
        fault = self.fault
        if self._start_ns is None:
            if now_ns < self._earliest_ns or (
                fault.after_count is not None and (count is None or count < fault.after_count)
            ):
                return False
            # A fault that waits for the clock alone began on time, even if nobody looked.
            self._start_ns = self._earliest_ns if fault.after_count is None else now_ns
        if self._start_count is None and count is not None:
            by_count_alone = fault.after_s is None and fault.after_count is not None
            self._start_count = fault.after_count if by_count_alone else count
        timed_out = fault.for_s is not None and now_ns >= self._start_ns + round(fault.for_s * 1e9)
        counted_out = (
            fault.for_count is not None
            and count is not None
            and self._start_count is not None
            and count >= self._start_count + fault.for_count
        )
        self.over = timed_out or counted_out
        return not self.over

    def next_change_ns(self) -> int | None:
        """When the clock alone begins or ends this fault next."""
        if self.over:
            return None
        if self._start_ns is None:
            return self._earliest_ns if self.fault.after_count is None else None
        return None if self.fault.for_s is None else self._start_ns + round(self.fault.for_s * 1e9)


class FaultScript:
    """The faults of one device. Thread-safe; time runs from its construction or the last :meth:`restart`."""

    def __init__(self, faults: Iterable[Fault] = ()) -> None:
        self._lock = threading.Lock()
        self._faults = tuple(faults)
        self._courses: list[_Course] = []
        self.restart()

    def restart(self) -> None:
        """Begin the script anew: time is 0 now; faults started by hand are forgotten."""
        now_ns = time.monotonic_ns()
        with self._lock:
            self._courses = [_Course(fault, now_ns) for fault in self._faults]

    def active(self, kind: FaultKind, now_ns: int | None = None, count: int | None = None) -> Fault | None:
        """The fault of that kind that is active, or None.

        Args:
            kind: which.
            now_ns: host's monotonic clock; now if left out.
            count: what the device has counted so far; a fault that waits for a count stays inactive without it.
        """
        now_ns = time.monotonic_ns() if now_ns is None else now_ns
        with self._lock:
            # Every course is looked at, so that each sees the clock and the count.
            courses = [course for course in self._courses if course.fault.kind is kind]
            found = [course.fault for course in courses if course.active(now_ns, count)]
        return found[0] if found else None

    def start(
        self,
        kind: FaultKind,
        *,
        after_s: float | None = None,
        after_count: int | None = None,
        for_s: float | None = None,
        for_count: int | None = None,
        amount: float = 0.0,
    ) -> Fault:
        """Add a fault; its ``after_s`` runs from now, its counts are the device's."""
        fault = Fault(kind, after_s, after_count, for_s, for_count, amount)
        self.add(fault)
        return fault

    def add(self, fault: Fault) -> None:
        """Add a fault; its ``after_s`` runs from now."""
        with self._lock:
            self._courses.append(_Course(fault, time.monotonic_ns()))

    def stop(self, kind: FaultKind) -> None:
        """End all faults of a kind, those to come included."""
        with self._lock:
            self._courses = [course for course in self._courses if course.fault.kind is not kind]

    def next_change_ns(self, after_ns: int = 0) -> int | None:
        """When, later than ``after_ns``, the clock alone begins or ends a fault (monotonic ns), or None."""
        with self._lock:
            changes = [course.next_change_ns() for course in self._courses]
        return min((change for change in changes if change is not None and change > after_ns), default=None)


_FORM = "DEVICE:KIND[:after=5s|after=20][:for=2s|for=3][:amount=X]"


def parse_fault(text: str) -> tuple[str, Fault]:
    """Read ``trolley:silence:after=5s:for=2s``: the device and its fault.

    Times carry an ``s``; without it ``after`` and ``for`` are counts.

    Raises:
        ValueError: another form, an unknown kind, or a bad number; the message says what is allowed.
    """
    device, *rest = (part.strip() for part in text.split(":"))
    if not device or not rest:
        raise ValueError(f"found {text!r}, allowed: {_FORM}")
    try:
        kind = FaultKind(rest[0].lower())
    except ValueError:
        allowed = ", ".join(kind.value for kind in FaultKind)
        raise ValueError(f"found fault {rest[0]!r}, allowed: {allowed}") from None
    values: dict[str, float | int] = {}
    for part in rest[1:]:
        match = re.fullmatch(r"(after|for|amount)=([-+0-9.eE]+?)(s?)", part)
        if match is None:
            raise ValueError(f"found {part!r} in {text!r}, allowed: {_FORM}")
        name, number, second = match.groups()
        if name != "amount":
            name += "_s" if second else "_count"
        if name in values:
            raise ValueError(f"found {name.removesuffix('_s').removesuffix('_count')!r} twice in {text!r}")
        try:
            values[name] = int(number) if name.endswith("_count") else float(number)
            # A count that no float holds would overflow where it is compared with one.
            float(values[name])
        except (ValueError, OverflowError):
            raise ValueError(f"found {part!r} in {text!r}, allowed: a number ({_FORM})") from None
    return device, Fault(kind, **values)  # type: ignore[arg-type]
