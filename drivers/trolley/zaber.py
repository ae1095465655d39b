"""A trolley on a Zaber linear stage (ASCII protocol), through the maker's package ``zaber-motion``.

Positions are in microsteps; the length of one is in the stage's data sheet (``microstep_m``), so that nothing has to be
looked up on the Internet. Each poll is one exchange: the reply to ``get pos`` carries position, busy or idle, and the
most urgent warning flag. A stage that has no reference homes before its first move, started and polled like a move.
"""

from __future__ import annotations

import contextlib
import math
import re
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Literal

from annotated_types import Ge, Gt, Le

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceRefused, DeviceTimeout
from drivers.options import checked
from drivers.records import Identity, TrolleyFix
from drivers.trolley.move_watch import MoveWatch

#: Native speed of a microstep per second (the protocol counts in 1.6384 of them).
SPEED_UNIT = 1.6384

_NO_REFERENCE = ("WR", "WH")
_FAULTS = {
    "FF": "a critical fault of its hardware",
    "FN": "no supply for its motor",
    "FZ": "its peripheral is not supported",
    "FH": "its home switch is missing or was not found",
    "FV": "its supply voltage is out of range",
    "FO": "its motor's driver is disabled by the supply or temperature",
    "FC": "a current peak",
    "FM": "a temperature that is too high",
    "FD": "its motor's driver is disabled",
    "FQ": "an error of its encoder",
    "FS": "a stall: it was blocked and has stopped",
    "FT": "an excessive twist",
    "FB": "a limit of a stream",
    "FP": "an interpolated path that left its limits",
    "FE": "a limit switch that was hit",
}
_FAULT_ADVICE = "look for an obstacle, check its supply and cable, then switch it off and on again"


class ZaberTrolley:
    """Driver ``zaber``. Thread-safe."""

    @dataclass(frozen=True)
    class Options:
        """The table ``[trolley.options]``."""

        __pydantic_config__: ClassVar[dict[str, object]] = {"extra": "forbid", "allow_inf_nan": False}

        port: str
        """Serial port, or ``socket://host:port`` (a stage with Ethernet, a serial server)."""
        length_m: Annotated[float, Gt(0)]
        """Usable length of the rail, m; x runs from -length_m/2 to +length_m/2."""
        microstep_m: Annotated[float, Gt(0), Le(1e-3)]
        """Length of one microstep, m, from the stage's data sheet (an X-LRQ has 0.49609375e-6)."""
        device: Annotated[int, Ge(1), Le(99)] = 1
        """Number of the stage in its chain."""
        axis: Annotated[int, Ge(1), Le(9)] = 1
        """Number of the axis of a controller; 1 for stages with their own."""
        direction: Literal[1, -1] = 1
        """1 where x grows with the stage's position, -1 where it falls."""
        origin_m: float | None = None
        """x at the stage's position 0 (home), m; left out: the end of the rail (-direction * length_m/2)."""
        feed_m_s: Annotated[float, Ge(1e-4), Le(10)] | None = None
        """Speed of moves, m/s; left out: the stage's own (``maxspeed``). Needs firmware 7.25 or later."""
        accuracy_sd_m: Annotated[float, Gt(0), Le(0.1)] = 5e-5
        """Standard deviation of a position, m (from the data sheet's accuracy)."""
        tolerance_m: Annotated[float, Gt(0), Le(0.1)] = 0.0005
        """How far from its target the trolley may stand, m."""
        home_first: bool = True
        """Home a stage without a reference before its first move; off: such a stage is refused."""
        timeout_s: Annotated[float, Gt(0), Le(5)] = 1.0
        """Time for an answer, s."""
        move_margin_s: Annotated[float, Gt(0), Le(600)] = 10.0
        """Time that a move or homing may take beyond length over speed, s."""
        stall_s: Annotated[float, Gt(0), Le(60)] = 1.5
        """Time without any advance after which a move counts as blocked, s."""

    def __init__(self, options: Options) -> None:
        self._options = checked(options)
        half = options.length_m / 2
        self._origin_m = -options.direction * half if options.origin_m is None else options.origin_m
        self._limits_m = (-half, half)
        self._ends = (0, 0)
        self._where = f"Zaber trolley on {options.port}"
        self._lock = threading.RLock()
        self._connection: Any = None
        self._axis: Any = None
        self._own_m_s = self._speed_m_s = options.feed_m_s or 0.1
        self._move = MoveWatch(self._where, options.stall_s)
        self._homing = False
        self._homing_deadline_s = 0.0
        self._after_homing_m: float | None = None
        self._stopping = False

    @property
    def limits_m(self) -> tuple[float, float]:
        """Smallest and largest x that may be asked for, m: the rail's, or the stage's own limits within it."""
        return self._limits_m

    def open(self) -> Identity:
        """Connect, stop the stage, read its limits.

        Raises:
            DeviceRefused: ``zaber-motion`` is not installed, the stage reports a fault, or it has no reference.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: nobody answers, or somebody else.
        """
        try:
            from zaber_motion.ascii import Connection
        except ImportError as error:
            raise DeviceRefused(
                f"the package zaber-motion cannot be used ({error})",
                where=self._where,
                advice="install it: pip install 'polfuse-lab[zaber]'",
            ) from error
        with self._lock:
            self.close()
            try:
                with self._failures("opening"):
                    tcp = re.fullmatch(r"(?:socket|tcp)://(.+):(\d+)/?", self._options.port)
                    made = (
                        Connection.open_tcp(tcp[1].strip("[]"), int(tcp[2]))
                        if tcp
                        else Connection.open_serial_port(self._options.port, exclusive=True)
                    )
                    self._connection = made
                    made.default_request_timeout = round(self._options.timeout_s * 1e3)
                    self._axis = made.get_device(self._options.device).get_axis(self._options.axis)
                return self._begin()
            except BaseException:
                self.close()
                raise

    def start_move(self, x_m: float, speed_m_s: float | None = None) -> None:
        """Begin to move to ``x_m`` (a stage without a reference begins to home, then moves).

        Args:
            x_m: where to, m.
            speed_m_s: constant speed between the ramps, m/s (firmware 7.25 or later); left out: ``feed_m_s``, or the
                stage's own.

        Raises:
            DeviceRefused: outside the limits, or the stage refused.
            DeviceTimeout, DeviceLost, DeviceBadAnswer: the stage cannot be talked to.
        """
        low, high = self.limits_m
        if not low <= x_m <= high:
            raise DeviceRefused(
                f"x = {x_m:g} m is outside the rail ({low:g} to {high:g} m)",
                where=self._where,
                advice="ask for a position on the rail",
            )
        with self._lock:
            if self._homing or not self._referenced():
                if not self._homing:
                    self.start_homing()
                self._after_homing_m = x_m
            else:
                self._go(x_m, speed_m_s)

    def start_homing(self) -> None:
        """Begin to seek the home sensor; :meth:`poll` shows ``moving`` until it is found. Raises as a move."""
        with self._lock:
            self._ask("home")
            self._move.end()
            self._homing, self._stopping, self._after_homing_m = True, False, None
            longest_s = self._options.length_m / self._own_m_s + self._options.move_margin_s
            self._homing_deadline_s = time.monotonic() + longest_s

    def poll(self) -> TrolleyFix:
        """Present position; ``moving`` until the stage is idle at the target, or has come to a stand after a stop.

        Raises:
            DeviceRefused: the stage reports a fault (a stall, a limit), or stands elsewhere than at the target.
            DeviceTimeout: the move takes longer than it can, or nobody answers.
            DeviceLost, DeviceBadAnswer: the stage cannot be talked to.
        """
        with self._lock:
            asked_ns = time.monotonic_ns()
            reply = self._ask("get pos")
            answered_ns = time.monotonic_ns()
            x_m = self._x_m(self._number(reply.data, "get pos"))
            idle = reply.status == "IDLE"
            flag = reply.warning_flag
            if flag.startswith("F"):
                self._forget()
                raise self._refused(
                    f"the stage reports {_FAULTS.get(flag, 'a fault')} (flag {flag}) at x = {x_m:.4f} m", _FAULT_ADVICE
                )
            moving = self._judge(x_m, idle, flag)
            homed = flag not in _NO_REFERENCE and not self._homing
            blur_m = self._speed_m_s * (answered_ns - asked_ns) * 1e-9 / math.sqrt(12) if moving else 0.0
            sd_m = math.hypot(self._options.accuracy_sd_m, blur_m) if homed else self._options.length_m / math.sqrt(12)
            state = "Home" if self._homing else "Busy" if not idle else "Idle"
            return TrolleyFix(x_m, sd_m, moving, (asked_ns + answered_ns) // 2, state)

    def stop(self) -> None:
        """Slow down and stand; :meth:`poll` shows when. The position stays known (also of an interrupted homing: none).

        Raises:
            DeviceLost, DeviceTimeout, DeviceBadAnswer: the stage cannot be reached.
        """
        with self._lock:
            self._forget()
            self._stopping = True
            self._ask("stop")

    def make_safe(self) -> None:
        """Stop the trolley. Never raises."""
        try:
            if self._connection is not None:
                self.stop()
        except DeviceError:
            pass  # lost already

    def close(self) -> None:
        """Release the port. Idempotent; never raises."""
        with self._lock:
            connection, self._connection, self._axis = self._connection, None, None
            self._forget()
            self._stopping = False
        if connection is not None:
            with contextlib.suppress(Exception):
                connection.close()

    def _begin(self) -> Identity:
        options = self._options
        self._ask("stop")
        number = self._ask("get deviceid", of_device=True).data
        version = self._ask("get version", of_device=True).data
        first, last = (round(self._number(self._ask(f"get limit.{end}").data, end)) for end in ("min", "max"))
        self._ends = first, last
        ends = sorted(self._x_m(position) for position in (first, last))
        half = options.length_m / 2
        # A rail's end that is a fraction of a microstep beyond the stage's can be reached as well as any other point.
        self._limits_m = max(-half, ends[0] - options.microstep_m), min(half, ends[1] + options.microstep_m)
        if self._limits_m[0] >= self._limits_m[1]:
            raise self._refused(
                f"its limits (x from {ends[0]:.3f} to {ends[1]:.3f} m) leave nothing of the rail",
                "check the options origin_m, direction and microstep_m",
            )
        if options.feed_m_s is None:
            native = self._number(self._ask("get maxspeed").data, "get maxspeed")
            self._own_m_s = self._speed_m_s = max(native / SPEED_UNIT * options.microstep_m, 1e-4)
        referenced = self._referenced()
        if not referenced and not options.home_first:
            raise self._refused("the stage has no reference", "home it, or set home_first = true")
        x_m = self._x_m(self._number(self._ask("get pos").data, "get pos"))
        stands = f"x = {x_m:+.4f} m" if referenced else "to be homed before its first move"
        return Identity("trolley", "zaber", f"Zaber device {number}", f"firmware {version}, {stands}")

    def _go(self, x_m: float, speed_m_s: float | None = None) -> None:
        position = round(self._options.direction * (x_m - self._origin_m) / self._options.microstep_m)
        position = min(max(position, self._ends[0]), self._ends[1])
        asked_m_s = speed_m_s or self._options.feed_m_s
        speed = "" if asked_m_s is None else f" {round(asked_m_s / self._options.microstep_m * SPEED_UNIT)}"
        self._ask(f"move abs {position}{speed}")
        self._stopping = False
        self._speed_m_s = asked_m_s or self._own_m_s
        self._move.begin(x_m, self._options.length_m / self._speed_m_s + self._options.move_margin_s)

    def _judge(self, x_m: float, idle: bool, flag: str) -> bool:
        """Whether the trolley still moves."""
        if self._homing:
            if idle:
                self._homing = False
                target_m, self._after_homing_m = self._after_homing_m, None
                if flag in _NO_REFERENCE:
                    raise self._refused("the stage did not find its home sensor", _FAULT_ADVICE)
                if target_m is not None:
                    self._go(target_m)
                    return True
            elif time.monotonic() > self._homing_deadline_s:
                self._homing = False
                self._ask("stop")
                raise DeviceTimeout(
                    "the stage does not come to the end of homing", where=self._where, advice=_FAULT_ADVICE
                )
            return self._homing
        if self._move.target_m is None:
            self._stopping = self._stopping and not idle
            return not idle
        tolerance_m = self._options.tolerance_m + self._options.microstep_m
        state = "Idle" if idle else "Busy"
        return self._move.moving(x_m, standing=idle, driven=not idle, tolerance_m=tolerance_m, state=state)

    def _forget(self) -> None:
        self._move.end()
        self._homing, self._after_homing_m = False, None

    def _referenced(self) -> bool:
        """Whether the stage knows where it is: ``warnings`` lists all flags."""
        return not set(_NO_REFERENCE) & set(self._ask("warnings").data.split()[1:])

    def _x_m(self, position: float) -> float:
        return self._origin_m + self._options.direction * position * self._options.microstep_m

    def _number(self, data: str, question: str) -> float:
        try:
            number = float(data)
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise DeviceBadAnswer(
                f"answered {question!r} with {data[:40]!r}",
                where=self._where,
                advice="check the numbers of device and axis in the rig file",
            )
        return number

    def _ask(self, command: str, *, of_device: bool = False) -> Any:
        """One exchange."""
        axis = self._axis
        if axis is None:
            raise DeviceLost("the port is not open", where=self._where, advice="open the device (again)")
        with self._failures(command):
            return (axis.device if of_device else axis).generic_command(command)

    @contextlib.contextmanager
    def _failures(self, doing: str) -> Iterator[None]:
        """The package's many exceptions as the few of a driver."""
        from zaber_motion import exceptions as zaber

        try:
            yield
        except zaber.RequestTimeoutException as error:
            raise DeviceTimeout(
                f"no answer to {doing!r} within {self._options.timeout_s:g} s",
                where=self._where,
                advice="check power, port and the numbers of device and axis",
            ) from error
        except zaber.CommandFailedException as error:
            raise self._refused(
                f"{doing!r} was refused ({error.details.response_data})",
                "check the rig file's [trolley.options] (limits, microstep_m, feed_m_s) and the stage's state",
            ) from error
        except (
            zaber.ConnectionFailedException,
            zaber.ConnectionClosedException,
            zaber.SerialPortBusyException,
        ) as error:
            self.close()
            raise DeviceLost(
                f"cannot be reached, or was lost, while {doing} ({_words(error)})",
                where=self._where,
                advice="check cable, power and port, then open the device again",
            ) from error
        except zaber.MotionLibException as error:
            raise DeviceBadAnswer(
                f"{doing!r}: {_words(error)}",
                where=self._where,
                advice="check that a Zaber stage with the ASCII protocol is connected to the port",
            ) from error

    def _refused(self, what: str, advice: str) -> DeviceRefused:
        return DeviceRefused(what, where=self._where, advice=advice)


def _words(error: Exception) -> str:
    return str(error).partition(": ")[2].strip().rstrip(".") or type(error).__name__
