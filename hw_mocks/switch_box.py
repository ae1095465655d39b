"""A Dow-Key MS switch matrix with two transfer switches, at the wire.

Commands as in the maker's table for standard matrices: ``*IDN?``, ``*OPC?`` (1 done, 0 under way), ``*RST``,
``ROUTE:SWITCHx y`` or ``:SWITCHx y``, ``:SWITCHx?``, ``SYST:ERR?``; several in one line are separated by ``;``. The
route is unknown (255 on the wire, ``"?"`` in the world) while contacts travel.

Fault of its own: ``STUCK_SWITCH`` (``amount`` the switch's number, 0 for all; counts are switchings), contacts stop
half-way until it ends.
"""

from __future__ import annotations

import re
import time
from collections import deque

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.wire import Kind, Wire, seconds_until, serve
from hw_mocks.world import Steps, World

_SET = re.compile(r":?(?:ROUTE:)?SWITCH(\d+)\s+(\d+)")
_ASK = re.compile(r":?(?:ROUTE:)?SWITCH(\d+)\?")
_UNKNOWN = 255
_ERROR_QUEUE = 10


class _Switch:
    """One transfer switch: position 1 routes H, position 2 routes V."""

    def __init__(self, route: Steps) -> None:
        self._route = route
        self.position = {"H": 1, "V": 2}.get(route.at(), _UNKNOWN)
        self.arrives_ns: int | None = None
        self.target = self.position
        self.jammed = False

    def go(self, position: int, actuation_s: float) -> None:
        if position == self.position:
            return
        self.target, self.position = position, _UNKNOWN
        self.arrives_ns = time.monotonic_ns() + round(actuation_s * 1e9)
        self._route.set("?")

    def advance(self) -> None:
        if self.arrives_ns is not None and time.monotonic_ns() >= self.arrives_ns:
            self.position = self.target
            self._route.set("HV"[self.target - 1], self.arrives_ns)
            self.arrives_ns = None


class SwitchBox:
    """The matrix. Switch 1 stands in the transmit path, switch 2 in the receive path.

    Args:
        world: where the routes are written.
        actuation_s: time for which the contacts travel, s (real ones: 10 to 30 ms).
        serial_number: reported by ``*IDN?``.
    """

    def __init__(self, world: World, *, actuation_s: float = 0.015, serial_number: str = "SIM0001") -> None:
        self.faults = FaultScript()
        """Faults of the unit and its line."""
        self._switchings = 0
        self._actuation_s = actuation_s
        self._identity = f"DOW-KEY,MS-2T,{serial_number},1.0"
        self._switches = {1: _Switch(world.transmit), 2: _Switch(world.receive)}
        self._errors: deque[str] = deque(maxlen=_ERROR_QUEUE)
        self._line = bytearray()

    def jam(self, switch: int, jammed: bool = True) -> None:
        """Make a switch's contacts stop half-way (or let them arrive again)."""
        self._switches[switch].jammed = jammed

    def handle(self, received: bytes) -> bytes:
        """React to bytes from the line (:class:`hw_mocks.wire.Handler`)."""
        self._advance()
        answer = b""
        for byte in received:
            if byte in b"\r\n":
                line = self._line.decode("ascii", "replace").strip()
                self._line.clear()
                for command in filter(None, (part.strip() for part in line.split(";"))):
                    said = self._obey(command.upper())
                    answer += said.encode() + b"\r\n" if said else b""
            elif len(self._line) < 256:
                self._line.append(byte)
        return answer

    def due_s(self) -> float | None:
        """The world is told when contacts arrive (:class:`hw_mocks.wire.Handler`)."""
        due = [s.arrives_ns for n, s in self._switches.items() if s.arrives_ns is not None and not self._stuck(n)]
        return seconds_until(min(due)) if due else None

    def _advance(self) -> None:
        for number, switch in self._switches.items():
            if not self._stuck(number):
                switch.advance()

    def _stuck(self, number: int) -> bool:
        fault = self.faults.active(FaultKind.STUCK_SWITCH, count=self._switchings)
        return self._switches[number].jammed or (fault is not None and fault.amount in (0, number))

    def _obey(self, command: str) -> str:
        if command == "*IDN?":
            return self._identity
        if command == "*OPC?":
            return "0" if any(s.arrives_ns is not None for s in self._switches.values()) else "1"
        if command in ("SYST:ERR?", "SYST:ERROR?", ":SYST:ERR?"):
            return self._errors.popleft() if self._errors else "0,NO ERROR"
        if command == "*RST":
            for switch in self._switches.values():
                switch.go(1, self._actuation_s)
            return ""
        if found := _ASK.fullmatch(command):
            asked = self._switches.get(int(found[1]))
            return self._error("-3,SWITCH NUMBER OUT OF RANGE") if asked is None else str(asked.position)
        if found := _SET.fullmatch(command):
            return self._set(int(found[1]), int(found[2]))
        return self._error("-4,SYNTAX ERROR")

    def _set(self, number: int, position: int) -> str:
        if number not in self._switches:
            return self._error("-3,SWITCH NUMBER OUT OF RANGE")
        if position not in (1, 2):
            return self._error("-5,POSITION OUT OF RANGE")
        self._switches[number].go(position, self._actuation_s)
        self._switchings += 1
        return ""

    def _error(self, text: str) -> str:
        self._errors.append(text)
        return ""


def start_switch_box(world: World, *, actuation_s: float = 0.015, kind: Kind | None = None) -> Wire:
    """Put a :class:`SwitchBox` behind a serial line."""
    return serve(SwitchBox(world, actuation_s=actuation_s), kind=kind, name="switch-box")
