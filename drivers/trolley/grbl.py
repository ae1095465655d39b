"""A trolley moved by a GRBL 1.1 controller.

Moves are ``G1`` in machine coordinates (``G53``): work offsets that someone else left behind do not matter. ``ok`` only
says that a line was accepted; a move is over when the controller is idle at its target. To stop, a feed hold (``!``)
lets the trolley slow down along its ramp, and once it stands (``Hold:0``) a soft reset discards the rest of the move:
the position survives, no alarm is raised, and the next move starts afresh. A reset while still in motion would lose
steps.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.options import checked
from drivers.records import Identity, TrolleyFix
from drivers.transport import SerialLine
from drivers.trolley.grbl_protocol import AXES, Report, explain, parse_report, parse_setting

_BANNER = "Grbl "
_RESET = b"\x18"
_STANDING = ("Idle", "Check", "Sleep")
_MOVING = ("Run", "Jog")
_START_GRACE_S = 0.5
_MAX_LINES = 200
_UNLOCK_ADVICE = "look why, check the trolley's position, then home it ($H) or unlock it ($X) in a terminal"


class GrblTrolley:
    """Driver ``grbl``. Thread-safe; :meth:`stop` does not wait for another thread's exchange."""

    @dataclass(frozen=True)
    class Options:
        """The table ``[trolley.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        port: str
        """Serial port, or ``socket://host:port``."""
        length_m: Annotated[float, Gt(0)]
        """Usable length of the rail, m; x runs from -length_m/2 to +length_m/2."""
        baud: Annotated[int, Gt(0)] = 115_200
        """Line speed, bit/s."""
        axis: Literal["X", "Y", "Z"] = "X"
        """The controller's axis that moves the trolley."""
        direction: Literal[1, -1] = 1
        """1 where x grows with the machine position, -1 where it falls."""
        origin_m: float | None = None
        """x at machine position 0, m; left out: the end of the rail (-direction * length_m/2)."""
        feed_m_s: Annotated[float, Ge(1e-4), Le(10)] = 0.1
        """Speed of moves, m/s; the controller's own limit applies too."""
        tolerance_m: Annotated[float, Gt(0), Le(0.1)] = 0.0005
        """How far from its target the trolley may stand, m."""
        timeout_s: Annotated[float, Gt(0), Le(5)] = 2.0
        """Time for an answer, s (an Arduino that restarts when its port is opened takes about 2 s more)."""
        move_margin_s: Annotated[float, Gt(0), Le(600)] = 10.0
        """Time that a move may take beyond length over speed, s."""
        stall_s: Annotated[float, Gt(0), Le(60)] = 1.5
        """Time without any advance after which a move counts as blocked, s."""
        poll_interval_s: Annotated[float, Gt(0), Le(1)] = 0.05
        """Shortest time between two status questions, s (GRBL wants at most some 10 to 20 a second)."""
        unlock_at_open: bool = False
        """Unlock a controller that is in alarm ($X) when opened; only where its position is known to be right."""

    def __init__(self, options: Options) -> None:
        self._options = checked(options)
        half = options.length_m / 2
        self._origin_m = -options.direction * half if options.origin_m is None else options.origin_m
        self._line = SerialLine(options.port, baud=options.baud, name="GRBL trolley", timeout_s=options.timeout_s)
        self._state_lock = threading.RLock()
        self._work_offset_mm: tuple[float, ...] | None = None
        self._step_m = 0.0
        self._feed_m_s = options.feed_m_s
        self._fix: TrolleyFix | None = None
        self._target_m: float | None = None
        self._started_s = self._deadline_s = 0.0
        self._advanced_s, self._advanced_to_m = 0.0, math.nan
        self._stopping = False

    @property
    def limits_m(self) -> tuple[float, float]:
        """Smallest and largest x that may be asked for, m."""
        return -self._options.length_m / 2, self._options.length_m / 2

    def open(self) -> Identity:
        """Connect, bring a moving trolley to a stand, reset the controller and read its settings.

        Raises:
            DeviceRefused: the controller is in alarm (and ``unlock_at_open`` is off), or set to report inches.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: nobody answers, or somebody else.
        """
        with self._state_lock:
            self._line.open()
            try:
                return self._open()
            except BaseException:
                self._line.close()
                raise

    def start_move(self, x_m: float) -> None:
        """Begin to move to ``x_m``.

        Raises:
            DeviceRefused: outside the limits, in alarm, or the controller refused the line.
        """
        low, high = self.limits_m
        if not low <= x_m <= high:
            raise self._refused(
                f"x = {x_m:g} m is outside the rail ({low:g} to {high:g} m)", "ask for a position on the rail"
            )
        with self._state_lock, self._line.exchange():
            if self._stopping:
                self._finish_stop(time.monotonic() + self._options.timeout_s)
            machine_mm = self._options.direction * (x_m - self._origin_m) * 1e3
            self._command(f"G21 G90 G53 G1 {self._options.axis}{machine_mm:z.3f} F{self._feed_m_s * 6e4:.1f}")
            self._target_m = x_m
            self._started_s = self._advanced_s = time.monotonic()
            self._advanced_to_m = math.nan
            self._deadline_s = self._started_s + self._options.length_m / self._feed_m_s + self._options.move_margin_s
            self._fix = None

    def poll(self) -> TrolleyFix:
        """Present position; ``moving`` until the controller is idle at the target, or has come to a stand after a stop.

        Raises:
            DeviceRefused: alarm, open door, or standing elsewhere than at the target.
            DeviceTimeout: the move takes longer than it can.
            DeviceLost: the controller restarted; its position is no longer known.
        """
        with self._state_lock:
            if (
                self._fix is not None
                and time.monotonic_ns() - self._fix.t_host_ns < self._options.poll_interval_s * 1e9
            ):
                return self._fix
            report, t_host_ns, round_trip_s = self._report()
            if self._stopping and report.state in _MOVING:
                self._line.write(b"!")  # a hold between 'ok' and the first step is ignored
            if self._stopping and report.name in ("Hold:0", *_STANDING):
                self._finish_stop(time.monotonic() + self._options.timeout_s)
                report, t_host_ns, round_trip_s = self._report()
            x_m = self._x_m(report)
            moving = self._judge(report, x_m)
            self._fix = TrolleyFix(x_m, self._sd_m(moving, round_trip_s), moving, t_host_ns, report.name)
            return self._fix

    def stop(self) -> None:
        """Feed hold at once; :meth:`poll` then shows when the trolley stands. The position stays known.

        Raises:
            DeviceLost, DeviceTimeout: the controller cannot be reached.
        """
        # Written before any lock is taken: another thread may be waiting for an answer.
        self._line.write(b"!")
        with self._state_lock:
            self._stopping = True
            self._target_m = None
            self._fix = None
            # A hold that overtook another thread's G1 was ignored; a second one in a hold is.
            self._line.write(b"!")

    def make_safe(self) -> None:
        """Stop the trolley. Never raises."""
        try:
            if self._line.is_open:
                self.stop()
        except DeviceError:
            pass  # lost already: there is nobody left to stop it

    def close(self) -> None:
        """Release the port. Idempotent; never raises."""
        self._line.close()
        with self._state_lock:
            self._target_m = self._fix = self._work_offset_mm = None
            self._stopping = False

    # How the conversation goes

    def _open(self) -> Identity:
        line, options = self._line, self._options
        with line.exchange():
            line.drain()
            self._wake()
            self._stopping = True
            line.write(b"!")
            version = self._finish_stop(time.monotonic() + 2 * options.timeout_s)
            report, _, _ = self._report()
            if report.state == "Alarm":
                if not options.unlock_at_open:
                    raise self._refused("the controller is in alarm", _UNLOCK_ADVICE)
                self._command("$X")
            build = self._command("$I")
            self._read_settings()
            # Reports with work positions say only now and then how these relate to machine positions.
            for _ in range(40):
                report, _, _ = self._report()
                if report.machine_mm is not None:
                    break
            x_m = self._x_m(report)
        detail = f"{' '.join(build)} at x = {x_m:+.4f} m"
        return Identity("trolley", "grbl", version, detail.strip())

    def _wake(self) -> None:
        """Wait until a controller answers; one that restarts with its port needs some 2 s."""
        give_up_s = time.monotonic() + self._options.timeout_s + 2.5
        while True:
            self._line.write(b"?")
            slice_end_s = time.monotonic() + 0.25
            while (left_s := slice_end_s - time.monotonic()) > 0:
                try:
                    said = self._line.read_line(left_s)
                except DeviceTimeout:
                    break
                if said.startswith((_BANNER, "<")):
                    # Answers to earlier questions may still be on their way; taken for later ones, they would be stale.
                    time.sleep(0.1)
                    self._line.drain()
                    return
            if time.monotonic() > give_up_s:
                raise DeviceTimeout(
                    "no GRBL controller answers",
                    where=self._line.where,
                    advice="check power, port and baud rate (GRBL 1.1 uses 115200)",
                )

    def _finish_stop(self, deadline_s: float) -> str:
        """Wait until the trolley stands, then discard the held move; return the banner. Called with the line held."""
        with self._line.exchange():
            while True:
                report, _, _ = self._report()
                if report.name == "Hold:0" or report.state in (*_STANDING, "Alarm", "Door"):
                    break
                if report.state in _MOVING:
                    self._line.write(b"!")
                if time.monotonic() > deadline_s:
                    raise DeviceTimeout(
                        f"the trolley does not come to a stand (state {report.name})",
                        where=self._line.where,
                        advice="switch the motor's power off and look at the controller",
                    )
                time.sleep(0.02)
            self._line.write(_RESET)
            said = next(said for said in self._answers() if said.startswith(_BANNER))
            self._stopping = False
            self._target_m = None
            # What the banner brings along ([MSG:...]) is skipped by whoever reads next.
            return said.split(" [")[0]

    def _command(self, command: str) -> list[str]:
        """Send one line, wait for its ``ok``, return what came before it."""
        self._hear_stale()
        self._line.write(command.encode() + b"\n")
        said: list[str] = []
        for answer in self._answers():
            if answer == "ok":
                break
            if answer.startswith("error:"):
                advice = _UNLOCK_ADVICE if answer == "error:9" else "check the rig file's [trolley.options]"
                raise self._refused(f"{command!r} was refused: {explain(answer)}", advice)
            self._unasked(answer)
            if not answer.startswith("<"):
                said.append(answer)
        return said

    def _report(self) -> tuple[Report, int, float]:
        """Ask for a status report: the report, the host's time at mid-exchange, and the round trip, s."""
        with self._line.exchange():
            self._hear_stale()
            asked_ns = time.monotonic_ns()
            self._line.write(b"?")
            for answer in self._answers():
                if answer.startswith("<"):
                    break
                self._unasked(answer)
            answered_ns = time.monotonic_ns()
        report = parse_report(answer, self._work_offset_mm, self._line.where)
        self._work_offset_mm = report.work_offset_mm
        return report, (asked_ns + answered_ns) // 2, (answered_ns - asked_ns) * 1e-9

    def _answers(self) -> Iterator[str]:
        """Lines as they come, a bounded number of them; raises DeviceTimeout when the time for an answer is over."""
        end_s = time.monotonic() + self._options.timeout_s
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
            self._target_m = None
            raise self._refused(explain(answer), _UNLOCK_ADVICE)
        if answer.startswith(_BANNER):
            self._target_m = self._work_offset_mm = None
            raise DeviceLost(
                "the controller restarted by itself, its position is no longer known",
                where=self._line.where,
                advice="check its supply, set the position right and open the trolley again",
            )

    def _read_settings(self) -> None:
        settings = dict(filter(None, map(parse_setting, self._command("$$"))))
        axis = AXES.index(self._options.axis)
        if settings.get(13):
            raise self._refused("the controller reports inches ($13=1)", "send $13=0 in a terminal")
        if steps_per_mm := settings.get(100 + axis):
            self._step_m = 1e-3 / abs(steps_per_mm)
        limit_m_s = settings.get(110 + axis, math.inf) / 6e4
        self._feed_m_s = min(self._options.feed_m_s, limit_m_s) if limit_m_s > 0 else self._options.feed_m_s

    # What the answers mean

    def _x_m(self, report: Report) -> float:
        axis = AXES.index(self._options.axis)
        if report.machine_mm is None or axis >= len(report.machine_mm):
            raise DeviceBadAnswer(
                f"the status report has no machine position of axis {self._options.axis}",
                where=self._line.where,
                advice="send $10=1 in a terminal and check the option 'axis'",
            )
        return self._origin_m + self._options.direction * report.machine_mm[axis] * 1e-3

    def _sd_m(self, moving: bool, round_trip_s: float) -> float:
        """Uniform over the tolerance and one step; under way also over the distance covered in one round trip."""
        blur_m = self._feed_m_s * round_trip_s if moving else 0.0
        return math.sqrt(self._options.tolerance_m**2 / 3 + (self._step_m**2 + blur_m**2) / 12)

    def _judge(self, report: Report, x_m: float) -> bool:
        """Whether the trolley still moves."""
        if report.state == "Alarm":
            self._target_m = None
            raise self._refused("the controller is in alarm", _UNLOCK_ADVICE)
        if report.state == "Door":
            raise self._refused("the safety door is open", "close it, reset the controller and move again")
        if self._target_m is None:
            return self._stopping or report.state not in _STANDING
        now_s = time.monotonic()
        if report.state in _STANDING:
            if abs(x_m - self._target_m) <= self._options.tolerance_m + self._step_m:
                self._target_m = None
                return False
            # Between 'ok' and the first step the controller still reports Idle where it was.
            if now_s - self._started_s > _START_GRACE_S:
                target_m, self._target_m = self._target_m, None
                raise self._refused(
                    f"the trolley stands at x = {x_m:.4f} m instead of {target_m:.4f} m",
                    "look for an obstacle or lost power, then move again",
                )
        # A hold is somebody's wish; it may last.
        if x_m != self._advanced_to_m or report.state not in _MOVING:
            self._advanced_to_m, self._advanced_s = x_m, now_s
        elif now_s - self._advanced_s > self._options.stall_s:
            raise DeviceTimeout(
                f"the trolley has not advanced from x = {x_m:.4f} m for {self._options.stall_s:g} s"
                f" (state {report.name})",
                where=self._line.where,
                advice="look whether it is held, or blocked, and whether the controller waits for something",
            )
        if now_s > self._deadline_s:
            raise DeviceTimeout(
                f"the trolley has not arrived at x = {self._target_m:.4f} m (state {report.name})",
                where=self._line.where,
                advice="look whether it is held or blocked, or raise move_margin_s",
            )
        return True

    def _refused(self, what: str, advice: str) -> DeviceRefused:
        return DeviceRefused(what, where=self._line.where, advice=advice)

    def _babble(self) -> DeviceBadAnswer:
        return DeviceBadAnswer(
            "talks without end", where=self._line.where, advice="check the port and that it is a GRBL controller"
        )
