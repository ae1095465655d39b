"""Transfer switches driven by the relays of a Numato USB module (a serial port; its baud rate does not matter).

Commands end with CR, are echoed, and answers end ``\\n\\r>``: ``relay on N``, ``relay off N``, ``relay read N`` (``on``
or ``off``), ``ver``. Relays are numbered 0 to 9, then A to V.

Two kinds of switches are wired to relays:

- *fail-safe* switches stand at H without current and at V with it: one relay each. A loss of power returns them to H.
- *latching* switches have a coil for each position, which gets a short pulse: two relays each. The relay of one coil
  opens, and is read back as open, before the other one closes: both coils never have current at once.

The module knows how its relays stand, not the RF contacts behind them: states are ``verified=False``. Of latching
switches only what they were last told is known; before that, their route is unknown.
"""

from __future__ import annotations

import contextlib
import re
import threading
import time
from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge, Gt, Le

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceRefused
from drivers.options import checked
from drivers.records import Channel, Identity, SwitchState
from drivers.switches.sequence import RfPath, Sequence, SequenceOptions
from drivers.transport import SerialLine

_DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUV"
_LONGEST_S = 0.5

Relay = Annotated[int, Ge(0), Le(31)]


class NumatoRelay:
    """Driver ``numato_relay``. Thread-safe."""

    @dataclass(frozen=True, kw_only=True)
    class Options(SequenceOptions):
        """The table ``[switches.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        port: str
        """Serial port, or ``socket://host:port``."""
        transmit_v_relay: Relay = 0
        """Relay whose closing moves the transmit switch to V."""
        receive_v_relay: Relay = 1
        """Relay whose closing moves the receive switch to V."""
        transmit_h_relay: Relay | None = None
        """Latching switches: relay whose closing moves the transmit switch to H; left out: fail-safe switches."""
        receive_h_relay: Relay | None = None
        """Latching switches: relay whose closing moves the receive switch to H; left out: fail-safe switches."""
        pulse_s: Annotated[float, Gt(0), Le(0.2)] = 0.05
        """Latching switches: length of the pulse in a coil, s (longer than an actuation)."""
        timeout_s: Annotated[float, Gt(0), Le(5)] = 1.0
        """Time for an answer, s."""

        def __post_init__(self) -> None:
            super().__post_init__()
            if (self.transmit_h_relay is None) != (self.receive_h_relay is None):
                raise ValueError("transmit_h_relay and receive_h_relay: found one, allowed: both or neither")
            relays = [self.transmit_v_relay, self.receive_v_relay, self.transmit_h_relay, self.receive_h_relay]
            given = [relay for relay in relays if relay is not None]
            if len(set(given)) < len(given):
                raise ValueError(f"relays: found {', '.join(map(str, given))}, allowed: each number once")
            total_s = self.stagger_s + self.settle_s + 2 * self.pulse_s
            if self.transmit_h_relay is not None and total_s > _LONGEST_S:
                raise ValueError(
                    f"stagger_s + settle_s + 2 pulse_s: found {total_s:g}, allowed: at most {_LONGEST_S:g}"
                )

    def __init__(self, options: Options) -> None:
        self._options = checked(options)
        self._line = SerialLine(options.port, baud=19_200, name="Numato relays", timeout_s=options.timeout_s)
        self._lock = threading.RLock()
        self._coils: dict[RfPath, dict[str, int | None]] = {
            "transmit": {"H": options.transmit_h_relay, "V": options.transmit_v_relay},
            "receive": {"H": options.receive_h_relay, "V": options.receive_v_relay},
        }
        self._latching = options.transmit_h_relay is not None
        self._told: dict[RfPath, str] = {}
        self._sequence = Sequence(options, {"transmit": "transmit", "receive": "receive"})

    def open(self) -> Identity:
        """Connect and ask for the firmware's version.

        Raises:
            DeviceLost, DeviceTimeout, DeviceBadAnswer: nobody answers, or somebody else.
        """
        with self._lock:
            self._line.open()
            try:
                self._told.clear()
                # Ends what somebody else began to type.
                self._line.write(b"\r")
                self._line.read_until(b">")
                version = self._ask("ver")
                for relay in (relay for coils in self._coils.values() for relay in coils.values()):
                    if relay is not None:
                        self._closed(relay)
            except BaseException:
                self._line.close()
                raise
            kind = "latching" if self._latching else "fail-safe"
            cycles = self._sequence.begin(f"Numato relays on {self._options.port}")
            return Identity("switches", "numato_relay", f"Numato relay module {version}", f"{kind} switches, {cycles}")

    def select(self, channel: Channel) -> SwitchState:
        """Route both switches and wait until they have settled; only a switch that must change is told to.

        Raises:
            DeviceRefused: a relay does not do as it was told.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: the module cannot be talked to.
        """
        wanted: dict[RfPath, str] = {"transmit": channel.transmit, "receive": channel.receive}
        with self._lock, self._line.exchange():
            present = self._told if self._latching else {path: self._route(path) for path in wanted}
            changes = [path for path, polarization in wanted.items() if present.get(path) != polarization]
            self._sequence.move(changes, lambda path: self._send(path, wanted[path]))
            return SwitchState(channel.transmit, channel.receive, False, time.monotonic_ns())

    def state(self) -> SwitchState:
        """The route as the relays stand (fail-safe switches) or as it was last told (latching switches).

        Raises:
            DeviceRefused: latching switches that have not been told yet.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: the module cannot be talked to.
        """
        with self._lock, self._line.exchange():
            if self._latching:
                self._ask("ver")  # still there?
            return SwitchState(self._route("transmit"), self._route("receive"), False, time.monotonic_ns())

    def make_safe(self) -> None:
        """Return to HH: fail-safe switches without current, latching ones by a pulse. Never raises."""
        try:
            if self._line.is_open:
                self.select(Channel.HH)
        except DeviceError:
            pass  # lost: nothing more can be done from here

    def close(self) -> None:
        """Release the port. Idempotent; never raises."""
        self._line.close()
        self._sequence.end()

    @property
    def cycles(self) -> dict[str, int]:
        """Actuations of the ``transmit`` and the ``receive`` switch, kept across sessions."""
        return self._sequence.cycles

    def _route(self, path: RfPath) -> str:
        if not self._latching:
            return "V" if self._closed(self._coils[path]["V"]) else "H"
        if path not in self._told:
            raise DeviceRefused(
                f"the route of the {path} switch is not known: latching switches cannot be asked",
                where=self._line.where,
                advice="select a channel first",
            )
        return self._told[path]

    def _send(self, path: RfPath, polarization: str) -> None:
        if not self._latching:
            self._switch(self._coils[path]["V"], closed=polarization == "V")
            return
        self._told.pop(path, None)
        coil, other = self._coils[path][polarization], self._coils[path]["VH"["HV".index(polarization)]]
        self._switch(other, closed=False)
        try:
            self._switch(coil, closed=True)
            time.sleep(self._options.pulse_s)
        except BaseException:
            # A coil is not made for lasting current, whatever went wrong.
            with contextlib.suppress(DeviceError):
                self._command(f"relay off {self._digit(coil)}")
            raise
        self._switch(coil, closed=False)
        self._told[path] = polarization

    def _switch(self, relay: int | None, *, closed: bool) -> None:
        """Close or open a relay and read back that it did."""
        self._command(f"relay {'on' if closed else 'off'} {self._digit(relay)}")
        if self._closed(relay) != closed:
            raise DeviceRefused(
                f"relay {relay} is {'open' if closed else 'closed'} although it was told otherwise",
                where=self._line.where,
                advice="check the relay's number in the rig file and the module's supply",
            )

    def _closed(self, relay: int | None) -> bool:
        answer = self._ask(f"relay read {self._digit(relay)}")
        if answer not in ("on", "off"):
            raise self._bad(answer, "neither 'on' nor 'off'")
        return answer == "on"

    @staticmethod
    def _digit(relay: int | None) -> str:
        assert relay is not None
        return _DIGITS[relay]

    def _command(self, command: str) -> None:
        """Send a command, hear its echo, wait for the prompt."""
        with self._line.exchange():
            self._echo(command)
            self._prompt()

    def _ask(self, question: str) -> str:
        """Send a question, hear its echo, return the answer, wait for the prompt."""
        with self._line.exchange():
            self._echo(question)
            answer = self._line.read_line()
            if not re.fullmatch(r"[0-9A-Za-z._ -]{1,40}", answer):
                raise self._bad(answer, f"no answer to {question!r}")
            self._prompt()
            return answer

    def _echo(self, command: str) -> None:
        self._line.drain()
        self._line.write(command.encode() + b"\r")
        # The prompt that followed an earlier answer may still stand before the echo.
        echo = self._line.read_line().lstrip(">")
        if echo != command:
            raise self._bad(echo, f"not the echo of {command!r}")

    def _prompt(self) -> None:
        said = self._line.read_until(b">")
        if said:
            raise self._bad(said, "more than was asked for")

    def _bad(self, answer: str, what: str) -> DeviceBadAnswer:
        return DeviceBadAnswer(
            f"answered {answer[:40]!r}, which is {what}",
            where=self._line.where,
            advice="check the port and that a Numato relay module is connected to it",
        )
