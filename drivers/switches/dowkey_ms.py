"""Transfer switches of a Dow-Key MS matrix (RS-232 or USB).

Commands as in the maker's table for standard matrices: ``:SWITCHx y`` (no answer), ``:SWITCHx?`` (the position;
transfer switches have 1 and 2, 255 is unknown), ``*OPC?`` (1 done, 0 still under way), ``SYST:ERR?``
(``number,text``), ``*IDN?``. The table names no line ending: CR LF is sent, and CR, LF or both are accepted. Speed and
format of the line are the unit's settings; 9600 bit/s 8N1 is assumed unless the rig file says otherwise.
"""

from __future__ import annotations

import re
import threading
import time
from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceRefused, DeviceTimeout
from drivers.options import checked
from drivers.records import Channel, Identity, SwitchState
from drivers.switches.sequence import RfPath, Sequence, SequenceOptions
from drivers.transport import SerialLine

UNKNOWN_POSITION = 255
_MAX_ERRORS = 20


class DowKeyMs:
    """Driver ``dowkey_ms``. Thread-safe."""

    @dataclass(frozen=True, kw_only=True)
    class Options(SequenceOptions):
        """The table ``[switches.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        port: str
        """Serial port, or ``socket://host:port``."""
        baud: Annotated[int, Gt(0)] = 9600
        """Line speed, bit/s."""
        transmit_switch: Annotated[int, Ge(1), Le(99)] = 1
        """Number of the switch in the transmit path."""
        receive_switch: Annotated[int, Ge(1), Le(99)] = 2
        """Number of the switch in the receive path."""
        h_position: Annotated[int, Ge(1), Le(99)] = 1
        """Position that connects the H antenna (0, all contacts open, would leave the transmitter without a load)."""
        v_position: Annotated[int, Ge(1), Le(99)] = 2
        """Position that connects the V antenna."""
        timeout_s: Annotated[float, Gt(0), Le(5)] = 1.0
        """Time for an answer, s."""
        verify: bool = True
        """Ask for the positions before and after switching; off only for units that cannot tell them."""

        def __post_init__(self) -> None:
            super().__post_init__()
            if self.transmit_switch == self.receive_switch:
                raise ValueError(f"transmit_switch and receive_switch are both {self.transmit_switch}, allowed: two")
            if self.h_position == self.v_position:
                raise ValueError(f"h_position and v_position are both {self.h_position}, allowed: two positions")

    def __init__(self, options: Options) -> None:
        self._options = checked(options)
        self._line = SerialLine(options.port, baud=options.baud, name="Dow-Key switches", timeout_s=options.timeout_s)
        self._lock = threading.RLock()
        self._told: dict[int, int] = {}
        self._switches: dict[RfPath, int] = {"transmit": options.transmit_switch, "receive": options.receive_switch}
        self._positions = {"H": options.h_position, "V": options.v_position}
        self._sequence = Sequence(options, {path: str(number) for path, number in self._switches.items()})

    def open(self) -> Identity:
        """Connect, ask who it is and forget errors of earlier sessions.

        Raises:
            DeviceLost, DeviceTimeout, DeviceBadAnswer: nobody answers, or somebody else.
        """
        with self._lock:
            self._line.open()
            try:
                self._told.clear()
                name = self._line.ask(b"*IDN?\r\n")
                self._errors()
                stand = []
                if self._options.verify:
                    stand = [f"switch {n} at {self._position(n)}" for n in self._switches.values()]
            except BaseException:
                self._line.close()
                raise
            return Identity("switches", "dowkey_ms", name, ", ".join([*stand, self._sequence.begin(name)]))

    def select(self, channel: Channel) -> SwitchState:
        """Route both switches, wait until they have settled, and verify (with ``verify``) that they stand there.

        Only a switch that must change is told to, in the order of :mod:`drivers.switches.sequence`.

        Raises:
            DeviceRefused: a switch does not stand where it was sent; the unit's own errors are quoted.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: the unit cannot be talked to.
        """
        options = self._options
        wanted = {
            options.transmit_switch: self._positions[channel.transmit],
            options.receive_switch: self._positions[channel.receive],
        }
        with self._lock, self._line.exchange():
            try:
                present = {n: self._position(n) for n in wanted} if options.verify else self._told
                changes = [path for path, n in self._switches.items() if present.get(n) != wanted[n]]
                self._told = {}
                self._sequence.move(changes, lambda path: self._send(path, wanted))
                if changes and options.verify:
                    self._await_completion()
                if options.verify:
                    self._verify(wanted)
                self._told = wanted
            except DeviceError:
                self._told = {}
                raise
            return SwitchState(channel.transmit, channel.receive, options.verify, time.monotonic_ns())

    def state(self) -> SwitchState:
        """Ask the device for the present route.

        Raises:
            DeviceRefused: a switch is at neither the H nor the V position, or does not know where it is.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: the unit cannot be talked to.
        """
        with self._lock, self._line.exchange():
            route = {path: self._polarization(number) for path, number in self._switches.items()}
            return SwitchState(route["transmit"], route["receive"], True, time.monotonic_ns())

    def make_safe(self) -> None:
        """Return to HH. Never raises."""
        try:
            if self._line.is_open:
                self.select(Channel.HH)
        except DeviceError:
            pass  # lost or jammed: nothing more can be done from here

    def close(self) -> None:
        """Release the port. Idempotent; never raises."""
        self._line.close()
        self._sequence.end()

    @property
    def cycles(self) -> dict[str, int]:
        """Actuations of each switch of this unit, by its number, kept across sessions."""
        return self._sequence.cycles

    def _send(self, path: RfPath, wanted: dict[int, int]) -> None:
        number = self._switches[path]
        self._line.write(f":SWITCH{number} {wanted[number]}\r\n".encode())

    def _position(self, number: int) -> int:
        answer = self._line.ask(f":SWITCH{number}?\r\n".encode())
        if not re.fullmatch(r"\d{1,3}", answer):
            raise self._bad(answer, f"no position of switch {number}")
        return int(answer)

    def _polarization(self, number: int) -> str:
        position = self._position(number)
        for polarization, its_position in self._positions.items():
            if position == its_position:
                return polarization
        raise self._misplaced(number, position)

    def _await_completion(self) -> None:
        deadline_s = time.monotonic() + self._options.timeout_s
        while (answer := self._line.ask(b"*OPC?\r\n")) != "1":
            if answer != "0":
                raise self._bad(answer, "no answer to *OPC?")
            if time.monotonic() > deadline_s:
                raise DeviceTimeout(
                    f"the switches have not finished after {self._options.timeout_s:g} s{self._errors()}",
                    where=self._line.where,
                    advice="check the 24 V supply of the switches, or replace the switch that sticks",
                )
            time.sleep(0.005)

    def _verify(self, wanted: dict[int, int]) -> None:
        for number, position in wanted.items():
            found = self._position(number)
            if found != position:
                raise self._misplaced(number, found, position)

    def _misplaced(self, number: int, found: int, position: int | None = None) -> DeviceRefused:
        stands = "does not know its position (255)" if found == UNKNOWN_POSITION else f"stands at {found}"
        instead = "" if position is None else f" instead of {position}"
        return DeviceRefused(
            f"switch {number} {stands}{instead}{self._errors()}",
            where=self._line.where,
            advice="check the switch's number and positions in the rig file, its cable and its supply",
        )

    def _errors(self) -> str:
        """Empty the unit's error queue; return its errors as `` (…)``, or nothing."""
        errors = []
        for _ in range(_MAX_ERRORS):
            answer = self._line.ask(b"SYST:ERR?\r\n")
            match = re.fullmatch(r"([+-]?\d{1,5})\s*,\s*(.*)", answer)
            if match is None:
                raise self._bad(answer, "no error number")
            if int(match[1]) == 0:
                break
            errors.append(answer)
        return f" (its errors: {'; '.join(errors)})" if errors else ""

    def _bad(self, answer: str, what: str) -> DeviceBadAnswer:
        return DeviceBadAnswer(
            f"answered {answer[:40]!r}, which is {what}",
            where=self._line.where,
            advice="check the port and that a Dow-Key MS unit is connected to it",
        )
