"""A Numato USB relay module that drives two transfer switches, at the wire.

Characters are echoed as they come; a command ends with CR, an answer with ``\\n\\r>``. The relays drive either
fail-safe switches (relay 0 transmit, relay 1 receive; V with current) or latching ones (0 and 1 as before, 2 and 3 the
coils for H; a pulse shorter than the actuation moves nothing).

Fault of its own: ``STUCK_SWITCH`` (:mod:`hw_mocks.transfer_switch`): the relays obey, the contacts do not, and the
module does not know.
"""

from __future__ import annotations

import time

from hw_mocks.faults import FaultScript
from hw_mocks.transfer_switch import TransferSwitches
from hw_mocks.wire import Kind, Wire, serve
from hw_mocks.world import World

_PROMPT = "\n\r>"
_DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUV"
_COILS = {0: (1, "V"), 1: (2, "V"), 2: (1, "H"), 3: (2, "H")}


class RelayModule:
    """The module with its relays and the switches that they drive.

    Args:
        world: where the routes are written.
        relays: number of relays.
        latching: whether the switches are latching.
        actuation_s: time for which contacts travel, s.
    """

    def __init__(self, world: World, *, relays: int = 8, latching: bool = False, actuation_s: float = 0.015) -> None:
        self.faults = FaultScript()
        """Faults of the module and its line."""
        self.welded: set[int] = set()
        """Relays whose contacts no longer open or close."""
        self.both_coils = 0
        """How often both coils of a switch had current at once: a real switch may burn."""
        self._latching = latching
        self._actuation_ns = round(actuation_s * 1e9)
        self._switches = TransferSwitches(world, actuation_s, self.faults)
        self._closed_ns: list[int | None] = [None] * relays
        self._before = {1: self._switches.position(1), 2: self._switches.position(2)}
        self._line = ""

    def handle(self, received: bytes) -> bytes:
        """React to bytes from the line (:class:`hw_mocks.wire.Handler`)."""
        self._switches.advance()
        answer = ""
        for character in received.decode("latin-1"):
            if character == "\r":
                said = self._obey(self._line.strip())
                answer += (f"\n\r{said}" if said else "") + _PROMPT
                self._line = ""
            elif len(self._line) < 64:
                self._line += character
                answer += character
        return answer.encode("latin-1")

    def due_s(self) -> float | None:
        """The world is told when contacts arrive (:class:`hw_mocks.wire.Handler`)."""
        return self._switches.due_s()

    def _obey(self, line: str) -> str:
        match line.split():
            case ["ver"]:
                return "00000009"
            case ["relay", "readall"]:
                closed = sum(1 << n for n, t_ns in enumerate(self._closed_ns) if t_ns is not None)
                return f"{closed:0{(len(self._closed_ns) + 3) // 4}X}"
            case ["relay", "writeall", digits]:
                try:
                    wanted = int(digits, 16)
                except ValueError:
                    return ""
                for relay in range(len(self._closed_ns)):
                    self._set(relay, bool(wanted >> relay & 1))
            case ["relay", ("on" | "off" | "read") as verb, digit]:
                relay = _DIGITS.find(digit) if len(digit) == 1 else -1
                if not 0 <= relay < len(self._closed_ns):
                    return ""
                if verb == "read":
                    return "off" if self._closed_ns[relay] is None else "on"
                self._set(relay, verb == "on")
        return ""

    def _set(self, relay: int, closed: bool) -> None:
        since_ns = self._closed_ns[relay]
        if relay in self.welded or closed == (since_ns is not None):
            return
        self._closed_ns[relay] = time.monotonic_ns() if closed else None
        if relay not in _COILS or (relay > 1 and not self._latching):
            return
        number, polarization = _COILS[relay]
        if not self._latching:
            self._switches.go(number, polarization if closed else "H")
        elif closed:
            self.both_coils += self._closed_ns[relay ^ 2] is not None
            if not self._switches.travelling:
                self._before[number] = self._switches.position(number)
            self._switches.go(number, polarization)
        elif since_ns is not None and time.monotonic_ns() - since_ns < self._actuation_ns:
            self._switches.go(number, self._before[number])  # too short a pulse: they spring back


def start_relays(world: World, *, latching: bool = False, actuation_s: float = 0.015, kind: Kind | None = None) -> Wire:
    """Put a :class:`RelayModule` behind a serial line."""
    return serve(RelayModule(world, latching=latching, actuation_s=actuation_s), kind=kind, name="relays")
