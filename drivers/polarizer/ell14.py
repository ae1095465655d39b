"""A polarizer in a Thorlabs ELL14 rotation mount (Elliptec), 9600 bit/s 8N1.

A turn is started with ``ma`` and is over when the mount sends its position (``PO``); ``GS09`` (busy) may come before.
The mount finishes a turn once it has begun: its stop command ends only continuous motion, and a full turn takes under
a second.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, TypeVar

from annotated_types import Ge, Gt, Le

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceRefused, DeviceTimeout
from drivers.options import checked
from drivers.polarizer import elliptec
from drivers.records import Identity, PolarizerFix
from drivers.transport import SerialLine

Answer = TypeVar("Answer")

_TRIES = 3
_MAX_LINES = 200
_WORDS_ADVICE = {
    0x01: "check the cable",
    0x02: "look whether the mount is blocked, then home it by opening it again",
    0x04: "check offset_deg in the rig file",
    0x08: "let the mount cool down",
}


class Ell14:
    """Driver ``ell14``. Thread-safe."""

    @dataclass(frozen=True)
    class Options:
        """The table ``[polarizer.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        port: str
        """Serial port, or ``socket://host:port``."""
        address: Literal["0", "1", "2", "3", "4", "5", "6", "7", "8", "9", "A", "B", "C", "D", "E", "F"] = "0"
        """The mount's address on its line."""
        offset_deg: Annotated[float, Ge(-360), Le(360)] = 0.0
        """Angle of the polarizer's transmission axis from horizontal with the mount at home, degrees."""
        sd_deg: Annotated[float, Gt(0), Le(90)] = 0.25
        """Standard deviation of the angle, degrees (the mount's accuracy is 0.4 degrees)."""
        tolerance_deg: Annotated[float, Gt(0), Le(90)] = 0.5
        """How far from its target the mount may stand, degrees."""
        timeout_s: Annotated[float, Gt(0), Le(3)] = 2.0
        """Time for an answer, s."""
        turn_timeout_s: Annotated[float, Gt(0), Le(60)] = 5.0
        """Time for a turn, s."""
        home_at_open: bool = True
        """Seek the reference when opened; needed after the mount's supply was off."""

    def __init__(self, options: Options) -> None:
        self._options = checked(options)
        self._line = SerialLine(options.port, baud=9600, name="ELL14 polarizer", timeout_s=options.timeout_s)
        self._lock = threading.RLock()
        self._pulses_per_turn = 0
        self._target_rad: float | None = None
        self._tries = 0
        self._moving = False
        self._deadline_s = 0.0
        self._angle_rad = self._near_rad = math.radians(options.offset_deg)

    def open(self) -> Identity:
        """Connect, read the pulses per turn, seek the reference (with ``home_at_open``).

        Raises:
            DeviceRefused: not a rotation mount, or the mount reports an error.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: nobody answers, or somebody else.
        """
        with self._lock:
            self._line.open()
            try:
                self._line.drain()
                self._moving = False
                self._target_rad = None
                info = self._ask_information()
                self._pulses_per_turn = info.pulses
                pulses = self._home() if self._options.home_at_open else self._ask_position()
                self._angle_rad = self._angle(pulses)
            except BaseException:
                self._line.close()
                raise
            detail = f"{info.pulses} pulses per turn, release {info.release} of {info.year}"
            return Identity("polarizer", "ell14", f"ELL{info.type_number} {info.serial_number}", detail)

    def start_turn(self, angle_rad: float) -> None:
        """Begin to turn to ``angle_rad`` (any number of turns; the mount takes the angle within one turn).

        Raises:
            DeviceRefused: the angle is no number, or the mount is still turning.
            DeviceLost, DeviceTimeout: the mount cannot be reached.
        """
        if not math.isfinite(angle_rad):
            raise self._refused(f"{angle_rad} is no angle", "ask for a finite angle")
        with self._lock:
            if self._pulses_per_turn == 0:
                raise self._refused("the mount has not been opened", "open it first")
            if self._moving:
                raise self._refused("the mount is still turning", "wait until it stands (poll)")
            self._hear()
            self._target_rad = self._near_rad = angle_rad
            self._tries = 0
            self._deadline_s = time.monotonic() + self._options.turn_timeout_s
            self._send_target()

    def poll(self) -> PolarizerFix:
        """Present angle (the last one known while it turns); ``moving`` until it stands at its target.

        Raises:
            DeviceRefused: the mount reports an error, or stands elsewhere after three tries.
            DeviceTimeout: the turn takes too long.
            DeviceLost, DeviceBadAnswer: the mount cannot be talked to.
        """
        with self._lock:
            if self._moving:
                self._hear()
                if self._moving and time.monotonic() > self._deadline_s:
                    self._moving = False
                    self._target_rad = None
                    raise DeviceTimeout(
                        f"no end of the turn within {self._options.turn_timeout_s:g} s",
                        where=self._line.where,
                        advice="look whether the mount turns, check its supply, then open it again",
                    )
            else:
                # A late answer to an earlier question would be taken for the answer to this one, and so on for ever.
                self._hear()
                self._angle_rad = self._angle(self._ask_position())
            return PolarizerFix(self._angle_rad, math.radians(self._options.sd_deg), self._moving, time.monotonic_ns())

    def stop(self) -> None:
        """Ask the mount to stop and forget the target. A turn that has begun is finished by the mount (under 1 s).

        Raises:
            DeviceLost, DeviceTimeout: the mount cannot be reached.
        """
        with self._lock:
            if self._moving:
                self._target_rad = None
                self._line.write(self._message(b"st"))

    def make_safe(self) -> None:
        """Stop. Never raises."""
        try:
            if self._line.is_open:
                self.stop()
        except DeviceError:
            pass  # lost already

    def close(self) -> None:
        """Release the port. Idempotent; never raises."""
        self._line.close()
        with self._lock:
            self._moving = False
            self._target_rad = None

    # How the conversation goes

    def _message(self, command: bytes) -> bytes:
        return self._options.address.encode() + command

    def _send_target(self) -> None:
        assert self._target_rad is not None
        turns = (self._target_rad - math.radians(self._options.offset_deg)) / (2 * math.pi)
        pulses = round((turns - math.floor(turns)) * self._pulses_per_turn) % self._pulses_per_turn
        self._tries += 1
        self._moving = True
        self._line.write(self._message(b"ma" + elliptec.pulses_hex(pulses).encode()))

    def _hear(self) -> None:
        """Take what the mount has said by itself."""
        for _ in range(_MAX_LINES):
            message = self._line.try_line()
            if message is None:
                return
            if not message.startswith(self._options.address):
                continue  # another mount on the same line
            pulses = elliptec.position(message)
            if pulses is not None:
                self._angle_rad = self._angle(pulses)
                self._arrived()
            else:
                self._check_status(message)
        raise self._bad("more and more", "talk without end")

    def _arrived(self) -> None:
        if not self._moving:
            return
        self._moving = False
        if self._target_rad is None:
            return
        off_rad = abs(self._angle_rad - self._target_rad)
        if off_rad <= math.radians(self._options.tolerance_deg):
            self._target_rad = None
        elif self._tries < _TRIES:
            # This was the end of an earlier turn, during which our request was answered with "busy".
            self._send_target()
        else:
            target_rad, self._target_rad = self._target_rad, None
            raise self._refused(
                f"stands at {math.degrees(self._angle_rad):.2f} degrees instead of {math.degrees(target_rad):.2f}",
                "look whether the mount is blocked, then open it again",
            )

    def _check_status(self, message: str) -> None:
        code = elliptec.status(message)
        if code is None:
            raise self._bad(message, "neither a position nor a status")
        if code in (0x00, elliptec.BUSY):
            return
        self._moving = False
        self._target_rad = None
        words = elliptec.STATUS.get(code, "a status that the protocol reserves")
        raise self._refused(
            f"the mount reports {words} (GS{code:02X})", _WORDS_ADVICE.get(code, "switch the mount off and on again")
        )

    def _ask_information(self) -> elliptec.Information:
        info = self._request(b"in", elliptec.information, self._options.timeout_s)
        if info.travel != 360 or not 360 <= info.pulses < 1 << 31:
            raise self._refused(
                f"is no rotation mount (type {info.type_number}, travel {info.travel}, {info.pulses} pulses)",
                "check the port and the address in the rig file",
            )
        return info

    def _ask_position(self) -> int:
        return self._request(b"gp", elliptec.position, self._options.timeout_s)

    def _home(self) -> int:
        return self._request(b"ho0", elliptec.position, min(self._options.turn_timeout_s, 6.0))

    def _request(self, command: bytes, parse: Callable[[str], Answer | None], timeout_s: float) -> Answer:
        """Send a command and wait for the answer that ``parse`` understands; other messages are only checked."""
        with self._line.exchange():
            self._line.write(self._message(command))
            end_s = time.monotonic() + timeout_s
            for _ in range(_MAX_LINES):
                message = self._next(end_s)
                answer = parse(message)
                if answer is not None:
                    return answer
                if elliptec.position(message) is not None:
                    continue  # the end of an earlier turn
                self._check_status(message)
                if elliptec.status(message) == elliptec.BUSY and command != b"ho0":
                    # Busy with an earlier turn, the mount has dropped the question; while homing it is only news.
                    time.sleep(0.05)
                    self._line.write(self._message(command))
        raise self._bad("more and more", "talk without end")

    def _next(self, end_s: float) -> str:
        """Next message of our mount; those of others on the same line are skipped."""
        for _ in range(_MAX_LINES):
            message = self._line.read_line(max(end_s - time.monotonic(), 0.0))
            if message.startswith(self._options.address):
                return message
        raise self._bad("more and more", "talk without end")

    # What the answers mean

    def _angle(self, pulses: int) -> float:
        """Angle for a position; of all that differ by whole turns the one nearest to the angle last asked for."""
        angle_rad = math.radians(self._options.offset_deg) + 2 * math.pi * pulses / self._pulses_per_turn
        return angle_rad - 2 * math.pi * round((angle_rad - self._near_rad) / (2 * math.pi))

    def _refused(self, what: str, advice: str) -> DeviceRefused:
        return DeviceRefused(what, where=self._line.where, advice=advice)

    def _bad(self, message: str, what: str) -> DeviceBadAnswer:
        return DeviceBadAnswer(
            f"sent {message[:40]!r}, which is {what}",
            where=self._line.where,
            advice="check the port and that an Elliptec mount is connected to it",
        )
