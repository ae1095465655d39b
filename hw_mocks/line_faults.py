"""Faults of a serial line: what of a device's answers reaches the client, when, and whether the cable is in.

Works on whole answers (all that a device says at once), which are also what is counted. Clocks cannot jump here: serial
devices report no time.
"""

from __future__ import annotations

import random
from collections import deque

from hw_mocks.faults import FaultKind, FaultScript

LINE_FAULTS = (FaultKind.SILENCE, FaultKind.GARBAGE, FaultKind.PARTIAL_LINE, FaultKind.SLOW, FaultKind.DISCONNECT)
"""The kinds that any serial line can have."""


class LineFaults:
    """Carries out the line faults of a script. Used by one thread.

    ``SILENCE`` swallows answers, ``GARBAGE`` replaces them by as many random bytes, ``PARTIAL_LINE`` sends their first
    half, ``SLOW`` delays them by ``amount`` seconds, ``DISCONNECT`` pulls the cable until it ends.
    """

    def __init__(self, script: FaultScript, seed: int = 0) -> None:
        self._script = script
        self._random = random.Random(seed)
        self._answers = 0
        self._delayed: deque[tuple[int, bytes]] = deque()

    def connected(self, now_ns: int) -> bool:
        """Whether the cable is in."""
        return self._script.active(FaultKind.DISCONNECT, now_ns, self._answers) is None

    def transmit(self, answer: bytes, now_ns: int) -> bytes:
        """Take what the device says (empty: nothing) and return what leaves the line now."""
        if answer:
            self._queue(answer, now_ns)
        ready = b""
        while self._delayed and self._delayed[0][0] <= now_ns:
            ready += self._delayed.popleft()[1]
        return ready

    def due_ns(self, now_ns: int) -> int | None:
        """When a delayed answer is due, or the clock begins or ends a fault; None while neither will happen."""
        due = [t_ns for t_ns, _ in list(self._delayed)[:1]]
        change = self._script.next_change_ns(now_ns)
        return min([*due, change] if change is not None else due, default=None)

    def _queue(self, answer: bytes, now_ns: int) -> None:
        found = {kind: self._script.active(kind, now_ns, self._answers) for kind in LINE_FAULTS}
        self._answers += 1
        if found[FaultKind.SILENCE]:
            return
        if found[FaultKind.GARBAGE]:
            answer = self._random.randbytes(len(answer))
        if found[FaultKind.PARTIAL_LINE]:
            answer = answer[: len(answer) // 2]
        slow = found[FaultKind.SLOW]
        leaves_ns = now_ns + (round(slow.amount * 1e9) if slow else 0)
        # A line keeps the order: nothing overtakes an answer that is late.
        if self._delayed:
            leaves_ns = max(leaves_ns, self._delayed[-1][0])
        self._delayed.append((leaves_ns, answer))
