"""A Dow-Key MS switch matrix with two transfer switches, at the wire.

Commands as in the maker's table for standard matrices: ``*IDN?``, ``*OPC?`` (1 done, 0 under way), ``*RST``,
``ROUTE:SWITCHx y`` or ``:SWITCHx y``, ``:SWITCHx?``, ``SYST:ERR?``; several in one line are separated by ``;``. The
route is unknown (255 on the wire, ``"?"`` in the world) while contacts travel.

Fault of its own: ``STUCK_SWITCH`` (:mod:`hw_mocks.transfer_switch`).
"""

from __future__ import annotations

import re
from collections import deque

from hw_mocks.faults import FaultScript
from hw_mocks.transfer_switch import TransferSwitches
from hw_mocks.wire import Kind, Wire, serve
from hw_mocks.world import World

_SET = re.compile(r":?(?:ROUTE:)?SWITCH(\d+)\s+(\d+)")
_ASK = re.compile(r":?(?:ROUTE:)?SWITCH(\d+)\?")
_POSITIONS = {"H": 1, "V": 2, "?": 255}
_ERROR_QUEUE = 10


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
        self._identity = f"DOW-KEY,MS-2T,{serial_number},1.0"
        self._switches = TransferSwitches(world, actuation_s, self.faults)
        self._errors: deque[str] = deque(maxlen=_ERROR_QUEUE)
        self._line = bytearray()

    def jam(self, switch: int, jammed: bool = True) -> None:
        """Make a switch's contacts stop half-way (or let them arrive again)."""
        self._switches.jam(switch, jammed)

    def handle(self, received: bytes) -> bytes:
        """React to bytes from the line (:class:`hw_mocks.wire.Handler`)."""
        self._switches.advance()
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
        return self._switches.due_s()

    def _obey(self, command: str) -> str:
        if command == "*IDN?":
            return self._identity
        if command == "*OPC?":
            return "0" if self._switches.travelling else "1"
        if command in ("SYST:ERR?", "SYST:ERROR?", ":SYST:ERR?"):
            return self._errors.popleft() if self._errors else "0,NO ERROR"
        if command == "*RST":
            for number in (1, 2):
                self._switches.go(number, "H")
            return ""
        if found := _ASK.fullmatch(command):
            number = int(found[1])
            if number not in self._switches:
                return self._error("-3,SWITCH NUMBER OUT OF RANGE")
            return str(_POSITIONS[self._switches.position(number)])
        if found := _SET.fullmatch(command):
            return self._set(int(found[1]), int(found[2]))
        return self._error("-4,SYNTAX ERROR")

    def _set(self, number: int, position: int) -> str:
        if number not in self._switches:
            return self._error("-3,SWITCH NUMBER OUT OF RANGE")
        if position not in (1, 2):
            return self._error("-5,POSITION OUT OF RANGE")
        self._switches.go(number, "HV"[position - 1])
        return ""

    def _error(self, text: str) -> str:
        self._errors.append(text)
        return ""


def start_switch_box(world: World, *, actuation_s: float = 0.015, kind: Kind | None = None) -> Wire:
    """Put a :class:`SwitchBox` behind a serial line."""
    return serve(SwitchBox(world, actuation_s=actuation_s), kind=kind, name="switch-box")
