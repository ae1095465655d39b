"""A Thorlabs ELL14 rotation mount (Elliptec protocol), at the wire.

As on real mounts, a turn that has begun runs to its end (``st`` does not cut it short), every command meanwhile is
answered with ``GS09`` (busy) and dropped, and the position is sent when the turn is over.

Faults of its own (counts are turns): ``HEAT_ALARM`` (motion is refused with ``GS08``), ``STALL`` (it does not move and
says ``GS02`` after a second), ``LOST_STEPS`` (it stops ``amount`` radians short of its target; its encoder knows).
"""

from __future__ import annotations

import math
import re
import time

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.wire import Kind, Wire, seconds_until, serve
from hw_mocks.world import World

_COMMAND = re.compile(rb"[\r\n]*([0-9A-F])(?:(ma|mr)([0-9A-Fa-f]{8})|(ho)([01])|(in|gs|gp|st))")
_OK, _BLOCKED, _UNSUPPORTED, _RANGE, _HOT, _BUSY = 0x00, 0x02, 0x03, 0x04, 0x08, 0x09
_BLOCKED_NS = 1_000_000_000


class Rotator:
    """The mount with the polarizer in it.

    Args:
        world: where the angle is written (radians; home is angle 0).
        address: its address on the line, one hexadecimal digit.
        pulses_per_turn: encoder pulses of a whole turn (ELL14: 143360).
        speed_rad_s: angular speed (ELL14: about 430 degrees/s).
        says_busy: send ``GS09`` when a turn begins, as some releases do.
    """

    def __init__(
        self,
        world: World,
        *,
        address: str = "0",
        pulses_per_turn: int = 143_360,
        speed_rad_s: float = math.radians(430),
        says_busy: bool = False,
    ) -> None:
        self.faults = FaultScript()
        """Faults of the mount and its line."""
        self._turns = 0
        self._stalled = False
        self._world = world
        self._address = address.encode()
        self._per_turn = pulses_per_turn
        self._speed_rad_s = speed_rad_s
        self._says_busy = says_busy
        self._pulses = round(world.polarizer_rad.at() / (2 * math.pi) * pulses_per_turn)
        self._arrives_ns: int | None = None
        self._next_failure: int | None = None
        self._received = b""

    def fail_next(self, status: int) -> None:
        """Answer the next motion command with an error status (``GSxx``) and do not move."""
        self._next_failure = status

    def handle(self, received: bytes) -> bytes:
        """React to bytes from the line (:class:`hw_mocks.wire.Handler`)."""
        answer = self._advance()
        self._received += received
        # A command has no ending; its length follows from its letters.
        while self._received:
            match = _COMMAND.match(self._received)
            if match is None:
                if len(self._received.lstrip(b"\r\n")) < 11:
                    break
                self._received = b""
                return answer + self._status(_UNSUPPORTED)
            self._received = self._received[match.end() :]
            if match[1] == self._address:
                answer += self._obey(match[2] or match[4] or match[6], match[3])
        return answer

    def due_s(self) -> float | None:
        """The end of the turn (:class:`hw_mocks.wire.Handler`)."""
        return None if self._arrives_ns is None else seconds_until(self._arrives_ns)

    def _advance(self) -> bytes:
        if self._arrives_ns is None or time.monotonic_ns() < self._arrives_ns:
            return b""
        self._arrives_ns = None
        if self._stalled:
            self._stalled = False
            return self._status(_BLOCKED)
        return self._position()

    def _obey(self, command: bytes, digits: bytes | None) -> bytes:
        if self._arrives_ns is not None:
            return self._status(_BUSY)
        match command:
            case b"in":
                return self._address + f"IN0E1140SIM120230101{360:04X}{self._per_turn:08X}\r\n".encode()
            case b"gs" | b"st":
                return self._status(_OK)
            case b"gp":
                return self._position()
            case b"ho":
                return self._turn(0)
        assert digits is not None
        pulses = int(digits, 16)
        pulses -= (1 << 32) if pulses >> 31 else 0
        return self._turn(pulses + (self._pulses if command == b"mr" else 0))

    def _turn(self, pulses: int) -> bytes:
        if self._next_failure is not None:
            failure, self._next_failure = self._next_failure, None
            return self._status(failure)
        if abs(pulses) > self._per_turn:
            return self._status(_RANGE)
        turn, self._turns = self._turns, self._turns + 1
        if self.faults.active(FaultKind.HEAT_ALARM, count=turn):
            return self._status(_HOT)
        if self.faults.active(FaultKind.STALL, count=turn):
            self._stalled = True
            self._arrives_ns = time.monotonic_ns() + _BLOCKED_NS
            return b""
        if lost := self.faults.active(FaultKind.LOST_STEPS, count=turn):
            short = math.copysign(lost.amount / (2 * math.pi) * self._per_turn, pulses - self._pulses)
            pulses -= round(short)
        start_rad, end_rad = (2 * math.pi * p / self._per_turn for p in (self._pulses, pulses))
        now_ns = time.monotonic_ns()
        self._arrives_ns = now_ns + round(abs(end_rad - start_rad) / self._speed_rad_s * 1e9) + 1
        self._pulses = pulses
        self._world.polarizer_rad.move(start_rad, end_rad, now_ns, self._arrives_ns)
        return self._status(_BUSY) if self._says_busy else b""

    def _status(self, code: int) -> bytes:
        return self._address + f"GS{code:02X}\r\n".encode()

    def _position(self) -> bytes:
        return self._address + f"PO{self._pulses & 0xFFFFFFFF:08X}\r\n".encode()


def start_rotator(world: World, *, kind: Kind | None = None) -> Wire:
    """Put a :class:`Rotator` behind a serial line."""
    return serve(Rotator(world), kind=kind, name="rotator")
