"""A Mini-Circuits RC switch box with two transfer switches, at its Telnet or its HTTP port on loopback.

``SETA=0|1``, ``SETP=n``, ``SWPORT?``, ``MN?``, ``SN?``, ``FIRMWARE?``, ``TEMP1?``, ``HEATALARM?``; bit 0 is switch A,
state 0 routes H. Positions are those of the contacts: while they travel, the one that they left.

Faults of its own: ``HEAT_ALARM`` (counts are switchings; ``amount`` the temperature, 0 for 75 degrees) and
``STUCK_SWITCH`` (:mod:`hw_mocks.transfer_switch`).
"""

from __future__ import annotations

import re
from typing import Literal

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.transfer_switch import TransferSwitches
from hw_mocks.wire import Wire, serve
from hw_mocks.world import World

_LETTERS = "AB"
_UNKNOWN = "-99 Unrecognized Command"

Protocol = Literal["http", "telnet"]


class RcBox:
    """The box. Switch A (1) stands in the transmit path, switch B (2) in the receive path.

    Args:
        world: where the routes are written.
        protocol: what is spoken at its port.
        actuation_s: time for which the contacts travel, s.
    """

    def __init__(self, world: World, *, protocol: Protocol = "http", actuation_s: float = 0.015) -> None:
        self.faults = FaultScript()
        """Faults of the box and its line."""
        self._protocol = protocol
        self._switchings = 0
        self._switches = TransferSwitches(world, actuation_s, self.faults)
        self._stood = ["H", "H"]
        self._received = b""

    def handle(self, received: bytes) -> bytes:
        """React to bytes from the line (:class:`hw_mocks.wire.Handler`)."""
        self._switches.advance()
        self._received = (self._received + received)[-4096:]
        return self._answer_http() if self._protocol == "http" else self._answer_lines()

    def due_s(self) -> float | None:
        """The world is told when contacts arrive (:class:`hw_mocks.wire.Handler`)."""
        return self._switches.due_s()

    def _answer_lines(self) -> bytes:
        answer = b""
        while match := re.match(rb"([^\r\n]*)\r?\n", self._received):
            self._received = self._received[match.end() :]
            if command := match[1].strip():
                answer += self._obey(command.decode("latin-1").upper()).encode() + b"\r\n"
        return answer

    def _answer_http(self) -> bytes:
        head, end, self._received = self._received.rpartition(b"\r\n\r\n")
        if not end:
            return b""
        asked = re.search(rb"GET /(\S*) HTTP/1\.[01]", head[max(head.rfind(b"GET "), 0) :])
        if asked is None:
            return b"HTTP/1.0 400 Bad Request\r\nContent-Length: 0\r\n\r\n"
        body = self._obey(asked[1].decode("latin-1").upper()).encode()
        return b"HTTP/1.0 200 OK\r\nContent-Type: text/html\r\nContent-Length: %d\r\n\r\n%s" % (len(body), body)

    def _obey(self, command: str) -> str:
        hot = self.faults.active(FaultKind.HEAT_ALARM, count=self._switchings)
        match command:
            case "MN?":
                return "MN=RC-2MTS-18"
            case "SN?":
                return "SN=11600000001"
            case "FIRMWARE?":
                return "C8"
            case "TEMP1?":
                return f"{(hot.amount or 75.0) if hot else 31.5:+.2f}"
            case "HEATALARM?":
                return "1" if hot else "0"
            case "SWPORT?":
                return str(sum(self._state(number) << number - 1 for number in (1, 2)))
        if match_one := re.fullmatch(r"SET([A-Z])=(\d+)", command):
            if match_one[1] == "P":
                return self._set_all(int(match_one[2]))
            number = _LETTERS.find(match_one[1]) + 1
            return self._set(number, int(match_one[2])) if number and int(match_one[2]) in (0, 1) else "0"
        return _UNKNOWN

    def _state(self, number: int) -> int:
        position = self._switches.position(number)
        if position != "?":
            self._stood[number - 1] = position
        return "HV".index(self._stood[number - 1])

    def _set(self, number: int, state: int) -> str:
        self._state(number)  # remember where it stood
        self._switchings += 1
        self._switches.go(number, "HV"[state])
        return "1"

    def _set_all(self, states: int) -> str:
        if states >> len(_LETTERS):
            return "0"
        for number in (1, 2):
            self._set(number, states >> number - 1 & 1)
        return "1"


def start_rc_box(world: World, *, protocol: Protocol = "http", actuation_s: float = 0.015) -> Wire:
    """Put an :class:`RcBox` behind a loopback port (:func:`host_and_port` tells which)."""
    return serve(RcBox(world, protocol=protocol, actuation_s=actuation_s), kind="tcp", name="rc-box")


def host_and_port(wire: Wire) -> tuple[str, int]:
    """Host and port of a box, for a driver's options."""
    host, port = wire.url.removeprefix("socket://").rsplit(":", 1)
    return host, int(port)
