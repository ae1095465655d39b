"""A trolley moved by a GRBL 1.1 controller.

Moves are ``G1`` in machine coordinates (``G53``): work offsets that someone else left behind do not matter. ``ok`` only
says that a line was accepted; a move is over when the controller is idle at its target. To stop, a feed hold (``!``)
lets the trolley slow down along its ramp, and once it stands (``Hold:0``) a soft reset discards the rest of the move:
the position survives, no alarm is raised, and the next move starts afresh. A reset while still in motion would lose
steps. Jogs (``$J=``) end in Idle by the same feed hold.

Homing (``$H``, where ``$22=1``) is started like a move and then polled. Meanwhile the firmware answers nothing, not
even status questions, until it says ``ok``; only a soft reset stops it, and its position is lost then. Where soft
limits are on (``$20=1``), targets beyond the controller's travel (``$130``) are refused before it raises an alarm.
"""

from __future__ import annotations

import math
import threading
import time
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceTimeout
from drivers.options import checked
from drivers.records import Identity, TrolleyFix
from drivers.trolley.grbl_line import MOVING, RESET, STANDING, UNLOCK_ADVICE, GrblLine
from drivers.trolley.grbl_protocol import AXES, Report
from drivers.trolley.move_watch import MoveWatch


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
        home_first: bool = False
        """Seek the limit switch ($H) before the first move after opening; needs $22=1 and a switch on the rail."""
        homing_timeout_s: Annotated[float, Gt(0), Le(600)] = 90.0
        """Time that homing may take, s."""

    def __init__(self, options: Options) -> None:
        self._options = checked(options)
        half = options.length_m / 2
        self._origin_m = -options.direction * half if options.origin_m is None else options.origin_m
        self._line = GrblLine(options.port, options.baud, options.timeout_s, self._upset)
        self._state_lock = threading.RLock()
        self._limits_m = (-half, half)
        self._step_m = 0.0
        self._feed_m_s = self._speed_m_s = options.feed_m_s
        self._limit_m_s = math.inf
        self._can_home = False
        self._fix: TrolleyFix | None = None
        self._move = MoveWatch(self._line.where, options.stall_s)
        self._stopping = False
        self._alarm: str | None = None
        self._homed = True
        self._homing = False
        self._homing_deadline_s = 0.0
        self._after_homing_m: float | None = None

    @property
    def limits_m(self) -> tuple[float, float]:
        """Smallest and largest x that may be asked for, m: the rail's, or the controller's soft limits within it."""
        return self._limits_m

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

    def start_move(self, x_m: float, speed_m_s: float | None = None) -> None:
        """Begin to move to ``x_m`` (with ``home_first``, begin to home where that is still to be done, then move).

        ``speed_m_s`` is the constant speed between the ramps; ``feed_m_s`` if left out.

        Raises:
            DeviceRefused: outside the limits (also of speed), in alarm, or the controller refused the line.
        """
        self._check_limits(x_m, speed_m_s)
        with self._state_lock, self._line.exchange():
            if self._homing:
                self._after_homing_m = x_m
            elif not self._homed and self._options.home_first:
                self.start_homing()
                self._after_homing_m = x_m
            else:
                self._go(f"G21 G90 G53 G1 {self._options.axis}", x_m, speed_m_s or self._feed_m_s)

    def start_jog(self, x_m: float, speed_m_s: float | None = None) -> None:
        """Begin to move by hand control: as :meth:`start_move`, to ``x_m`` unless :meth:`stop` ends it (for a jog key:
        the rail's end).

        Raises:
            DeviceRefused: outside the limits, in alarm, homing, or the controller refused the line.
        """
        self._check_limits(x_m)
        with self._state_lock, self._line.exchange():
            if self._homing:
                raise self._line.refused("the trolley is homing", "wait until it has its reference")
            self._go(f"$J=G21 G90 G53 {self._options.axis}", x_m, speed_m_s or self._feed_m_s)

    def start_homing(self) -> None:
        """Begin to seek the limit switch ($H); :meth:`poll` shows ``moving`` until it has been found.

        Raises:
            DeviceRefused: homing is not enabled, or the trolley moves.
        """
        with self._state_lock, self._line.exchange():
            if not self._can_home:
                raise self._line.refused(
                    "homing is not enabled ($22=0)", "send $22=1 in a terminal where the rail has a limit switch"
                )
            self._end_alarm()
            if self._stopping:
                self._finish_stop(time.monotonic() + self._options.timeout_s)
            self._line.send("$H")
            self._move.end()
            self._homing, self._homed, self._fix = True, False, None
            self._homing_deadline_s = time.monotonic() + self._options.homing_timeout_s

    def unlock(self) -> None:
        """End an alarm without homing ($X); only where the position is known to be right.

        Raises:
            DeviceRefused: the controller stays locked.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: it cannot be talked to.
        """
        with self._state_lock, self._line.exchange():
            self._end_alarm()
            self._line.command("$X")
            self._homed, self._fix = True, None

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
            if self._homing:
                return self._poll_homing()
            self._check_alarm()
            report, t_host_ns, round_trip_s = self._line.report()
            if self._stopping and report.state in MOVING:
                self._line.write(b"!")  # a hold between 'ok' and the first step is ignored
            if self._stopping and report.name in ("Hold:0", *STANDING):
                self._finish_stop(time.monotonic() + self._options.timeout_s)
                report, t_host_ns, round_trip_s = self._line.report()
            x_m = self._x_m(report)
            moving = self._judge(report, x_m)
            sd_m = self._sd_m(moving, round_trip_s) if self._homed else self._anywhere_m
            self._fix = TrolleyFix(x_m, sd_m, moving, t_host_ns, report.name)
            return self._fix

    def stop(self) -> None:
        """Feed hold at once; :meth:`poll` then shows when the trolley stands. The position stays known.

        While homing only a reset helps: the trolley stops, and must be homed (or unlocked) before it moves again.

        Raises:
            DeviceLost, DeviceTimeout: the controller cannot be reached.
        """
        # Written before any lock is taken: another thread may be waiting for an answer.
        self._line.write(RESET if self._homing else b"!")
        with self._state_lock:
            self._move.end()
            self._fix = self._after_homing_m = None
            if self._homing:
                return  # the next poll tells of the alarm that this is
            self._stopping = True
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
            self._move.end()
            self._fix = self._alarm = self._after_homing_m = None
            self._stopping = self._homing = False

    def _open(self) -> Identity:
        line, options = self._line, self._options
        with line.exchange():
            line.wake()
            self._alarm, self._homed = None, True
            self._stopping = True
            line.write(b"!")
            version = self._finish_stop(time.monotonic() + 2 * options.timeout_s)
            report, _, _ = line.report()
            locked = report.state == "Alarm"
            build = line.command("$I")
            self._read_settings()
            if options.home_first and not self._can_home:
                raise line.refused("homing is not enabled ($22=0)", "send $22=1 in a terminal, or leave out home_first")
            if locked and options.unlock_at_open and not options.home_first:
                line.command("$X")
            elif locked and not options.home_first:
                raise line.refused("the controller is in alarm", UNLOCK_ADVICE)
            self._homed = not options.home_first
            # Reports with work positions say only now and then how these relate to machine positions.
            for _ in range(40):
                report, _, _ = line.report()
                if report.machine_mm is not None:
                    break
            x_m = self._x_m(report)
        stands = f"at x = {x_m:+.4f} m" if self._homed else "to be homed before its first move"
        return Identity("trolley", "grbl", version, f"{' '.join(build)} {stands}".strip())

    def _go(self, command: str, x_m: float, speed_m_s: float) -> None:
        """Send a move or a jog; the line is held."""
        self._check_alarm()
        if self._stopping:
            self._finish_stop(time.monotonic() + self._options.timeout_s)
        machine_mm = self._options.direction * (x_m - self._origin_m) * 1e3
        self._line.command(f"{command}{machine_mm:z.3f} F{speed_m_s * 6e4:.1f}")
        self._speed_m_s = speed_m_s
        self._move.begin(x_m, self._options.length_m / speed_m_s + self._options.move_margin_s)
        self._fix = None

    def _finish_stop(self, deadline_s: float) -> str:
        """Wait until the trolley stands, then discard the held move; return the banner."""
        banner = self._line.come_to_a_stand(deadline_s)
        self._stopping = False
        self._move.end()
        return banner

    def _poll_homing(self) -> TrolleyFix:
        """Hear whether homing is over; the firmware answers nothing else meanwhile."""
        try:
            said = self._line.heard()
            while said is not None and said != "ok":
                if said.startswith("error:"):
                    raise self._line.refused_command("$H", said)
                said = self._line.heard()
        except DeviceError:
            self._homing = False
            raise
        x_m = self._fix.x_m if self._fix is not None else 0.0
        if said == "ok":
            self._homing, self._homed = False, True
            target_m, self._after_homing_m = self._after_homing_m, None
            if target_m is not None:
                self._go(f"G21 G90 G53 G1 {self._options.axis}", target_m, self._feed_m_s)
            else:
                return self.poll()
        elif time.monotonic() > self._homing_deadline_s:
            self._homing = False
            self._line.write(RESET)
            raise DeviceTimeout(
                f"the limit switch was not found within {self._options.homing_timeout_s:g} s",
                where=self._line.where,
                advice="check the switch and its direction ($23), or raise homing_timeout_s",
            )
        return TrolleyFix(x_m, self._anywhere_m, True, time.monotonic_ns(), "Home")

    def _read_settings(self) -> None:
        options, settings = self._options, self._line.settings()
        axis = AXES.index(options.axis)
        if settings.get(13):
            raise self._line.refused("the controller reports inches ($13=1)", "send $13=0 in a terminal")
        if steps_per_mm := settings.get(100 + axis):
            self._step_m = 1e-3 / abs(steps_per_mm)
        limit_m_s = settings.get(110 + axis, math.inf) / 6e4
        self._limit_m_s = limit_m_s if limit_m_s > 0 else math.inf
        self._feed_m_s = self._speed_m_s = min(options.feed_m_s, self._limit_m_s)
        self._can_home = bool(settings.get(22))
        low, high = -options.length_m / 2, options.length_m / 2
        if settings.get(20) and (travel_mm := settings.get(130 + axis)):
            # The firmware's machine positions run from -travel to 0.
            ends = sorted(self._origin_m - options.direction * mm * 1e-3 for mm in (0.0, travel_mm))
            low, high = max(low, ends[0]), min(high, ends[1])
            if low >= high:
                raise self._line.refused(
                    f"its soft limits (x from {ends[0]:.3f} to {ends[1]:.3f} m) leave nothing of the rail",
                    "check the options origin_m and direction, and the controller's $130",
                )
        self._limits_m = (low, high)

    def _upset(self, alarm: str | None) -> None:
        """The controller raised an alarm, or restarted: what was under way is over."""
        self._move.end()
        self._after_homing_m = self._fix = None
        self._homing = False
        self._alarm = alarm

    def _check_alarm(self) -> None:
        if self._alarm is not None:
            raise self._line.refused(f"the controller is in alarm since {self._alarm}", UNLOCK_ADVICE)

    def _end_alarm(self) -> None:
        """After some alarms the firmware answers nothing until it is reset."""
        if self._alarm is not None:
            self._line.forget()
            self._line.reset()
            self._alarm = None

    def _check_limits(self, x_m: float, speed_m_s: float | None = None) -> None:
        low, high = self.limits_m
        if not low <= x_m <= high:
            raise self._line.refused(
                f"x = {x_m:g} m is outside the rail ({low:g} to {high:g} m)", "ask for a position on the rail"
            )
        if speed_m_s is not None and not 0 < speed_m_s <= self._limit_m_s:
            raise self._line.refused(
                f"{speed_m_s:g} m/s is not within its limit of {self._limit_m_s:g} m/s ($110)", "plan a lower speed"
            )

    def _x_m(self, report: Report) -> float:
        axis = AXES.index(self._options.axis)
        if report.machine_mm is None or axis >= len(report.machine_mm):
            raise DeviceBadAnswer(
                f"the status report has no machine position of axis {self._options.axis}",
                where=self._line.where,
                advice="send $10=1 in a terminal and check the option 'axis'",
            )
        return self._origin_m + self._options.direction * report.machine_mm[axis] * 1e-3

    @property
    def _anywhere_m(self) -> float:
        """Standard deviation of a position that may be anywhere on the rail."""
        return self._options.length_m / math.sqrt(12)

    def _sd_m(self, moving: bool, round_trip_s: float) -> float:
        """Uniform over the tolerance and one step; under way also over the distance covered in one round trip."""
        blur_m = self._speed_m_s * round_trip_s if moving else 0.0
        return math.sqrt(self._options.tolerance_m**2 / 3 + (self._step_m**2 + blur_m**2) / 12)

    def _judge(self, report: Report, x_m: float) -> bool:
        """Whether the trolley still moves."""
        if report.state == "Alarm" and self._homed:
            self._move.end()
            raise self._line.refused("the controller is in alarm", UNLOCK_ADVICE)
        if report.state == "Door":
            raise self._line.refused("the safety door is open", "close it, reset the controller and move again")
        if self._move.target_m is None:
            return self._stopping or report.state not in (*STANDING, "Alarm")
        return self._move.moving(
            x_m,
            standing=report.state in STANDING,
            driven=report.state in MOVING,
            tolerance_m=self._options.tolerance_m + self._step_m,
            state=report.name,
        )
