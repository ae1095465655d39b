"""Transfer switches of a Mini-Circuits RC box (mechanical switches on Ethernet), over HTTP or Telnet.

``SETA=0|1`` moves one switch (1 done, 0 refused), ``SWPORT?`` tells all positions as a decimal number (bit 0 is switch
A), ``MN?``, ``SN?``, ``FIRMWARE?`` say who it is, ``TEMP1?`` and ``HEATALARM?`` how warm it is. ``SETP=n``, which sets
all switches at once, is not used: the box may have switches that serve somebody else. Its USB port is a HID device.
"""

from __future__ import annotations

import math
import re
import threading
import time
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceRefused
from drivers.options import checked
from drivers.records import Channel, Identity, SwitchState
from drivers.switches.minicircuits_link import HttpLink, Link, TelnetLink
from drivers.switches.sequence import RfPath, Sequence, SequenceOptions

_LETTERS = "ABCDEFGH"
_VERIFY_S = 0.1

Letter = Literal["A", "B", "C", "D", "E", "F", "G", "H"]


class MiniCircuitsRc:
    """Driver ``minicircuits_rc``. Thread-safe."""

    @dataclass(frozen=True, kw_only=True)
    class Options(SequenceOptions):
        """The table ``[switches.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        host: str
        """Address of the box, such as ``192.168.9.61``."""
        connection: Literal["http", "telnet"] = "http"
        """How to talk to it."""
        port: Annotated[int, Ge(0), Le(65_535)] = 0
        """TCP port; 0: 80 for HTTP, 23 for Telnet."""
        transmit_switch: Letter = "A"
        """Letter of the switch in the transmit path."""
        receive_switch: Letter = "B"
        """Letter of the switch in the receive path."""
        h_state: Literal[0, 1] = 0
        """State that connects the H antenna; the other one connects V. Without power the switches keep or take 0."""
        timeout_s: Annotated[float, Gt(0), Le(2)] = 1.0
        """Time for an answer, s."""

        def __post_init__(self) -> None:
            super().__post_init__()
            if self.transmit_switch == self.receive_switch:
                raise ValueError(f"transmit_switch and receive_switch are both {self.transmit_switch}, allowed: two")
            if not re.fullmatch(r"[A-Za-z0-9.:_-]+", self.host):
                raise ValueError(f"host: found {self.host!r}, allowed: a host name or an address")

    def __init__(self, options: Options) -> None:
        self._options = checked(options)
        made = HttpLink if options.connection == "http" else TelnetLink
        port = options.port or (80 if options.connection == "http" else 23)
        self._link: Link = made(options.host, port, options.timeout_s)
        self._lock = threading.RLock()
        self._switches: dict[RfPath, str] = {"transmit": options.transmit_switch, "receive": options.receive_switch}
        self._sequence = Sequence(options, dict(self._switches))

    def open(self) -> Identity:
        """Connect, ask who it is, how its switches stand and whether it is too warm.

        Raises:
            DeviceRefused: heat alarm.
            DeviceLost, DeviceTimeout, DeviceBadAnswer: nobody answers, or somebody else.
        """
        with self._lock:
            self._link.open()
            try:
                model, serial, firmware = (self._word(question) for question in ("MN?", "SN?", "FIRMWARE?"))
                self._check_heat()
                positions = self._positions()
                celsius = self._temperature()
            except BaseException:
                self._link.close()
                raise
            unit = f"{model} {serial}"
            stand = ", ".join(f"switch {letter} at {positions[letter]}" for letter in self._switches.values())
            detail = f"firmware {firmware}, {celsius:.1f} degrees C, {stand}, {self._sequence.begin(unit)}"
            return Identity("switches", "minicircuits_rc", unit, detail)

    def select(self, channel: Channel) -> SwitchState:
        """Route both switches, wait until they have settled, and verify that they stand there.

        Raises:
            DeviceRefused: heat alarm, the box refused a command, or a switch does not stand where it was sent.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: the box cannot be talked to.
        """
        wanted: dict[RfPath, int] = {
            "transmit": self._state_of(channel.transmit),
            "receive": self._state_of(channel.receive),
        }
        with self._lock:
            present = self._positions()
            changes = [path for path, letter in self._switches.items() if present[letter] != wanted[path]]
            if changes:
                self._check_heat()
                self._sequence.move(changes, lambda path: self._send(path, wanted[path]))
                self._verify(wanted)
            return SwitchState(channel.transmit, channel.receive, True, time.monotonic_ns())

    def state(self) -> SwitchState:
        """Ask the box for the present route.

        Raises:
            DeviceTimeout, DeviceLost, DeviceBadAnswer: the box cannot be talked to.
        """
        with self._lock:
            positions = self._positions()
            route = {path: self._polarization(positions[letter]) for path, letter in self._switches.items()}
            return SwitchState(route["transmit"], route["receive"], True, time.monotonic_ns())

    def temperature_c(self) -> float:
        """The box's own temperature, degrees Celsius. Raises as :meth:`state`."""
        with self._lock:
            return self._temperature()

    def make_safe(self) -> None:
        """Return to HH. Never raises."""
        try:
            if self._link.is_open:
                self.select(Channel.HH)
        except DeviceError:
            pass  # lost, or too warm to move: the transmitter stays on an antenna in both positions

    def close(self) -> None:
        """Hang up. Idempotent; never raises."""
        self._link.close()
        self._sequence.end()

    @property
    def cycles(self) -> dict[str, int]:
        """Actuations of each switch by its letter, kept across sessions."""
        return self._sequence.cycles

    def _state_of(self, polarization: str) -> int:
        return self._options.h_state if polarization == "H" else 1 - self._options.h_state

    def _polarization(self, state: int) -> str:
        return "H" if state == self._options.h_state else "V"

    def _send(self, path: RfPath, state: int) -> None:
        command = f"SET{self._switches[path]}={state}"
        answer = self._link.ask(command)
        if answer == "0":
            raise self._refused(f"refused {command!r}", "check the switch's letter in the rig file and the 24 V supply")
        if answer != "1":
            raise self._bad(command, answer)

    def _verify(self, wanted: dict[RfPath, int]) -> None:
        end_s = time.monotonic() + _VERIFY_S
        while True:
            positions = self._positions()
            wrong = [path for path, letter in self._switches.items() if positions[letter] != wanted[path]]
            if not wrong:
                return
            if time.monotonic() > end_s:
                letter = self._switches[wrong[0]]
                raise self._refused(
                    f"switch {letter} stands at {positions[letter]} instead of {wanted[wrong[0]]}",
                    "check the supply of the box, or have the switch that sticks replaced",
                )
            time.sleep(0.01)

    def _check_heat(self) -> None:
        alarm = self._word("HEATALARM?")
        if alarm not in ("0", "1"):
            raise self._bad("HEATALARM?", alarm)
        if alarm == "1":
            raise self._refused(
                f"heat alarm at {self._temperature():.1f} degrees C, switches are not moved",
                "shade the box, look at its fan, and let it cool down",
            )

    def _positions(self) -> dict[str, int]:
        answer = self._word("SWPORT?")
        if not re.fullmatch(r"\d{1,3}", answer) or int(answer) >= 1 << len(_LETTERS):
            raise self._bad("SWPORT?", answer)
        return {letter: int(answer) >> bit & 1 for bit, letter in enumerate(_LETTERS)}

    def _temperature(self) -> float:
        answer = self._word("TEMP1?")
        try:
            celsius = float(answer)
        except ValueError:
            celsius = math.nan
        if not -100 < celsius < 200:
            raise self._bad("TEMP1?", answer)
        return celsius

    def _word(self, question: str) -> str:
        """An answer; models that repeat the question's name (``MN=RC-2MTS-18``) are understood as well."""
        answer = self._link.ask(question)
        return re.sub(r"^[A-Z0-9]{1,10}=", "", answer)

    def _refused(self, what: str, advice: str) -> DeviceRefused:
        return DeviceRefused(what, where=self._link.where, advice=advice)

    def _bad(self, question: str, answer: str) -> DeviceBadAnswer:
        return DeviceBadAnswer(
            f"answered {question!r} with {answer[:40]!r}",
            where=self._link.where,
            advice="check the address and that it is a Mini-Circuits RC box with that switch",
        )
