"""The conversation with a GRBL 1.1 controller: commands and their ``ok``, status reports, resets, the unasked."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator

from drivers.errors import DeviceBadAnswer, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.transport import SerialLine
from drivers.trolley.grbl_protocol import Report, explain, parse_report, parse_setting

BANNER = "Grbl "
RESET = b"\x18"
UNLOCK_ADVICE = "look why, check the trolley's position, then home it ($H) or unlock it ($X) in a terminal"

STANDING = ("Idle", "Check", "Sleep")
"""States in which the trolley stands and may be sent somewhere."""
MOVING = ("Run", "Jog")
"""States in which the trolley is driven."""

_MAX_LINES = 200
_WAKE_S = 2.5
_SILENT_S = 1.0
"""A controller that has said nothing for so long may wait for a reset (after ``ALARM:1``), or home."""


class GrblLine:
    """A serial line to a GRBL controller. Thread-safe where :class:`~drivers.transport.SerialLine` is.

    Args:
        port: serial port.
        baud: line speed, bit/s.
        timeout_s: time for an answer, s.
        on_upset: called when the controller reports an alarm (with its words) or has restarted (with None), before
            that is raised.
    """

    def __init__(self, port: str, baud: int, timeout_s: float, on_upset: Callable[[str | None], None]) -> None:
        self._line = SerialLine(port, baud=baud, name="GRBL trolley", timeout_s=timeout_s)
        self._timeout_s = timeout_s
        self._on_upset = on_upset
        self._work_offset_mm: tuple[float, ...] | None = None
        self.where = self._line.where
        """The device, for messages."""

    @property
    def is_open(self) -> bool:
        """Whether the port is open and has not been lost."""
        return self._line.is_open

    def open(self) -> None:
        """Open the port. Raises DeviceLost."""
        self._line.open()
        self._work_offset_mm = None

    def close(self) -> None:
        """Release the port. Idempotent; never raises."""
        self._line.close()

    def write(self, data: bytes) -> None:
        """Send bytes without waiting for other threads' exchanges. Raises DeviceLost, DeviceTimeout."""
        self._line.write(data)

    @contextlib.contextmanager
    def exchange(self) -> Iterator[None]:
        """Hold the line for several exchanges (re-entrant)."""
        with self._line.exchange():
            yield

    def wake(self) -> None:
        """Wait until a controller answers; one that restarts with its port needs some 2 s.

        A controller that keeps silent is reset once: one that waits for it after ``ALARM:1`` answers again, one that is
        homing stops.
        """
        self._line.drain()
        started_s = time.monotonic()
        reset = False
        while True:
            self._line.write(b"?")
            slice_end_s = time.monotonic() + 0.25
            while (left_s := slice_end_s - time.monotonic()) > 0:
                try:
                    said = self._line.read_line(left_s)
                except DeviceTimeout:
                    break
                if said.startswith((BANNER, "<")):
                    # Answers to earlier questions may still be on their way; taken for later ones, they would be stale.
                    time.sleep(0.1)
                    self._line.drain()
                    return
            silent_s = time.monotonic() - started_s
            if silent_s > self._timeout_s + _WAKE_S:
                raise DeviceTimeout(
                    "no GRBL controller answers",
                    where=self.where,
                    advice="check power, port and baud rate (GRBL 1.1 uses 115200)",
                )
            if silent_s > _SILENT_S and not reset:
                reset = True
                self._line.write(RESET)

    def reset(self) -> str:
        """Soft reset; returns the banner. In motion this raises an alarm."""
        with self._line.exchange():
            self._line.write(RESET)
            said = next(said for said in self._answers() if said.startswith(BANNER))
            # What the banner brings along ([MSG:...]) is skipped by whoever reads next.
            return said.split(" [")[0]

    def come_to_a_stand(self, deadline_s: float) -> str:
        """Wait until a held trolley stands, then discard what is left of its move by a reset; returns the banner.

        Raises:
            DeviceTimeout: it still moves at ``deadline_s`` (monotonic).
            DeviceRefused, DeviceLost, DeviceBadAnswer: as :meth:`report`.
        """
        with self._line.exchange():
            while True:
                report, _, _ = self.report()
                if report.name == "Hold:0" or report.state in (*STANDING, "Alarm", "Door"):
                    return self.reset()
                if report.state in MOVING:
                    self._line.write(b"!")
                if time.monotonic() > deadline_s:
                    raise DeviceTimeout(
                        f"the trolley does not come to a stand (state {report.name})",
                        where=self.where,
                        advice="switch the motor's power off and look at the controller",
                    )
                time.sleep(0.02)

    def forget(self) -> None:
        """Forget all that has been said and not been heard."""
        self._line.drain()

    def command(self, command: str) -> list[str]:
        """Send one line, wait for its ``ok``, return what came before it.

        Raises:
            DeviceRefused: the controller answered with an error, or raised an alarm.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: it cannot be talked to.
        """
        with self._line.exchange():
            self.send(command)
            said: list[str] = []
            for answer in self._answers():
                if answer == "ok":
                    break
                if answer.startswith("error:"):
                    raise self.refused_command(command, answer)
                self._unasked(answer)
                if not answer.startswith("<"):
                    said.append(answer)
            return said

    def send(self, command: str) -> None:
        """Send one line and do not wait for its ``ok`` (homing answers when it is over). Raises as :meth:`command`."""
        self._hear_stale()
        self._line.write(command.encode() + b"\n")

    def heard(self) -> str | None:
        """Next line that has come by itself; alarms and restarts are raised. None when there is none."""
        said = self._line.try_line()
        if said is not None:
            self._unasked(said)
        return said

    def report(self) -> tuple[Report, int, float]:
        """Ask for a status report: the report, the host's time at mid-exchange (ns), and the round trip, s.

        Raises:
            DeviceRefused: the controller raised an alarm.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: it cannot be talked to.
        """
        with self._line.exchange():
            self._hear_stale()
            asked_ns = time.monotonic_ns()
            self._line.write(b"?")
            for answer in self._answers():
                if answer.startswith("<"):
                    break
                self._unasked(answer)
            answered_ns = time.monotonic_ns()
            report = parse_report(answer, self._work_offset_mm, self.where)
            self._work_offset_mm = report.work_offset_mm
        return report, (asked_ns + answered_ns) // 2, (answered_ns - asked_ns) * 1e-9

    def settings(self) -> dict[int, float]:
        """All settings (``$$``) by number. Raises as :meth:`command`."""
        return dict(filter(None, map(parse_setting, self.command("$$"))))

    def refused(self, what: str, advice: str) -> DeviceRefused:
        """An error of this controller."""
        return DeviceRefused(what, where=self.where, advice=advice)

    def refused_command(self, command: str, answer: str) -> DeviceRefused:
        """The error for a line that was answered with ``error:N``."""
        advice = UNLOCK_ADVICE if answer == "error:9" else "check the rig file's [trolley.options]"
        return self.refused(f"{command!r} was refused: {explain(answer)}", advice)

    def _answers(self) -> Iterator[str]:
        """Lines as they come, a bounded number of them; raises DeviceTimeout when the time for an answer is over."""
        end_s = time.monotonic() + self._timeout_s
        for _ in range(_MAX_LINES):
            yield self._line.read_line(max(end_s - time.monotonic(), 0.0))
        raise self._babble()

    def _hear_stale(self) -> None:
        """Take what was said since the last exchange, so that it is not mistaken for the next answer."""
        for _ in range(_MAX_LINES):
            stale = self._line.try_line()
            if stale is None:
                return
            self._unasked(stale)
        raise self._babble()

    def _unasked(self, answer: str) -> None:
        """What the controller says by itself: alarms and restarts are errors, messages and echoes are not."""
        if answer.startswith("ALARM:"):
            self._on_upset(explain(answer))
            raise self.refused(explain(answer), UNLOCK_ADVICE)
        if answer.startswith(BANNER):
            self._work_offset_mm = None
            self._on_upset(None)
            raise DeviceLost(
                "the controller restarted by itself, its position is no longer known",
                where=self.where,
                advice="check its supply, set the position right and open the trolley again",
            )

    def _babble(self) -> DeviceBadAnswer:
        return DeviceBadAnswer(
            "talks without end", where=self.where, advice="check the port and that it is a GRBL controller"
        )
