"""A microcontroller with a quadrature encoder on a hand-pushed trolley, at the wire.

Talks by itself, ``$ENC,<sequence>,<microseconds>,<count>,<index>*<checksum>``, as the drivers' documentation says; its
clock drifts against the host's.

Faults of its own (counts are lines): ``LOST_STEPS`` (the wheel slips by ``amount`` metres, once), ``STALL`` (lines go
on, the count does not), ``CLOCK_JUMP`` (its clock is off by ``amount`` seconds), ``DROP_PACKETS`` (the fraction
``amount`` of its lines never comes).
"""

from __future__ import annotations

import random
import time

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.wire import Kind, Wire, seconds_until, serve
from hw_mocks.world import World

_MAX_LINES = 50


class Encoder:
    """The controller; the trolley is pushed in the world (:meth:`push`).

    Args:
        world: where the trolley is.
        counts_per_m: counts for one metre, negative where they fall towards positive x.
        lines_per_s: how often it talks.
        counter_bits: width of its counter.
        index_x_m: position of the index mark, m; None where there is none.
        drift: relative error of its clock.
        first_micros: its clock when switched on, us (to have it wrap soon).
        first_count: its counter when switched on.
    """

    def __init__(
        self,
        world: World,
        *,
        counts_per_m: float = 10_000.0,
        lines_per_s: float = 100.0,
        counter_bits: int = 32,
        index_x_m: float | None = None,
        drift: float = 0.0,
        first_micros: int = 0,
        first_count: int = 0,
    ) -> None:
        self.faults = FaultScript()
        """Faults of the controller and its line."""
        self._track = world.trolley_x_m
        self._counts_per_m = counts_per_m
        self._period_ns = round(1e9 / lines_per_s)
        self._modulus = 1 << counter_bits
        self._index_x_m = index_x_m
        self._drift = drift
        self._first_micros, self._first_count = first_micros, first_count
        self._random = random.Random(0)
        self._sequence = 0
        self._on_ns = self._next_ns = 0
        self._zero_m = self._x_m = 0.0
        self._slipped = False
        self._index: int | None = None
        self._restart()

    def push(self, x_m: float, speed_m_s: float) -> None:
        """A person pushes the trolley to ``x_m``, evenly."""
        now_ns = time.monotonic_ns()
        start_m = self._track.at(now_ns)
        self._track.move(start_m, x_m, now_ns, now_ns + round(abs(x_m - start_m) / speed_m_s * 1e9) + 1)

    def power_cycle(self) -> None:
        """Restart: its clock and its counter begin anew."""
        self._restart()

    def handle(self, received: bytes) -> bytes:
        """Say what is due (:class:`hw_mocks.wire.Handler`); what it is told does not matter to it."""
        said = b""
        now_ns = time.monotonic_ns()
        self._next_ns = max(self._next_ns, now_ns - _MAX_LINES * self._period_ns)
        while self._next_ns <= now_ns:
            said += self._say(self._next_ns)
            self._next_ns += self._period_ns
        return said

    def due_s(self) -> float | None:
        """Until the next line (:class:`hw_mocks.wire.Handler`)."""
        return seconds_until(self._next_ns)

    def _restart(self) -> None:
        now_ns = time.monotonic_ns()
        self._on_ns = self._next_ns = now_ns
        self._zero_m = self._x_m = self._track.at(now_ns)
        self._slipped = False
        self._index = None

    def _say(self, t_ns: int) -> bytes:
        self._sequence += 1
        count_of_lines = self._sequence
        active = {kind: self.faults.active(kind, t_ns, count_of_lines) for kind in FaultKind}
        x_m = self._track.at(t_ns)
        if slip := active[FaultKind.LOST_STEPS]:
            self._zero_m += 0.0 if self._slipped else slip.amount
            self._slipped = True
        if active[FaultKind.STALL]:
            self._zero_m += x_m - self._x_m
        mark = self._index_x_m
        if mark is not None and x_m != self._x_m and min(self._x_m, x_m) <= mark <= max(self._x_m, x_m):
            self._index = self._count(mark)
        self._x_m = x_m
        jump = active[FaultKind.CLOCK_JUMP]
        seconds = (t_ns - self._on_ns) * 1e-9 * (1 + self._drift) + (jump.amount if jump else 0.0)
        micros = (self._first_micros + round(seconds * 1e6)) % (1 << 32)
        index = "" if self._index is None else str(self._index)
        body = f"ENC,{self._sequence % 256},{micros},{self._count(x_m)},{index}"
        parity = 0
        for character in body.encode():
            parity ^= character
        dropped = active[FaultKind.DROP_PACKETS]
        if dropped and self._random.random() < dropped.amount:
            return b""
        return f"${body}*{parity:02X}\r\n".encode()

    def _count(self, x_m: float) -> int:
        return (self._first_count + round((x_m - self._zero_m) * self._counts_per_m)) % self._modulus


def start_encoder(world: World, *, counts_per_m: float = 10_000.0, kind: Kind | None = None) -> Wire:
    """Put an :class:`Encoder` behind a serial line."""
    return serve(Encoder(world, counts_per_m=counts_per_m), kind=kind, name="encoder")
