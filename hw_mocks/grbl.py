"""A GRBL 1.1h controller that moves the trolley, at the wire.

Follows the firmware where a driver can see it: ``ok`` when a line is accepted, not when the move is over; up to 15
planned moves; feed hold (``Hold:1`` while slowing down, then ``Hold:0``; a resume in between is ignored); a soft reset
in motion is ``ALARM:3``, in a finished hold it is not and keeps the position; ``WCO`` and ``Ov`` only in some reports.
Faults of its own (counts are moves): ``LOST_STEPS`` (the trolley falls behind by ``amount`` metres in a move and the
controller, which only counts steps, does not know), ``STALL`` (``Run`` without advancing until it ends).
Left out: homing (``$22=0``), jogging, arcs, probes and spindle. Speed is constant along a move, with a ramp only into a
hold.
"""

from __future__ import annotations

import math
import re
import time
from collections import deque

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.wire import Kind, Wire, seconds_until, serve
from hw_mocks.world import World

_BANNER = "\r\nGrbl 1.1h ['$' for help]\r\n"
_LOCKED = "[MSG:'$H'|'$X' to unlock]\r\n"
_WORD = re.compile(r"([A-Z])([-+]?(?:\d+\.?\d*|\.\d+))")
_REALTIME = b"?!~\x18"
_PLANNER_BLOCKS = 15
_STALLED_NS = 20_000_000
_LINE_LENGTH = 80
_MODAL_G = {0.0, 1.0, 20.0, 21.0, 53.0, 90.0, 91.0, 94.0}


class Grbl:
    """The controller and the motor.

    Args:
        world: where the trolley's position is written.
        length_m: length of the rail, m; a limit switch at either end raises ``ALARM:1``.
        feed_limit_m_s: greatest speed, m/s (``$110``); make it large for quick simulated moves.
        origin_m: x at machine position 0, m; left out: the rail's left end.
        steps_per_mm: motor steps (``$100``); positions are whole steps.
        hold_s: time in which the trolley slows down to a feed hold, s.
        start_delay_s: time from ``ok`` to the first step, s; the state is still Idle.
        work_offset_mm: G54 offset of the axis, mm.
        reports_work: report work positions (``$10=0``), so that machine positions need the rare ``WCO``.
    """

    def __init__(
        self,
        world: World,
        *,
        length_m: float,
        feed_limit_m_s: float = 0.5,
        origin_m: float | None = None,
        steps_per_mm: float = 250.0,
        hold_s: float = 0.05,
        start_delay_s: float = 0.005,
        work_offset_mm: float = 0.0,
        reports_work: bool = False,
    ) -> None:
        self.faults = FaultScript()
        """Faults of the controller and its line."""
        self._begun = 0
        self._stalled = False
        self._track = world.trolley_x_m
        self._half_m = length_m / 2
        self._origin_m = -self._half_m if origin_m is None else origin_m
        self._limit_mm_s = feed_limit_m_s * 1e3
        self._steps_per_mm = steps_per_mm
        self._hold_s = hold_s
        self._start_delay_ns = round(start_delay_s * 1e9)
        self._offset_mm = work_offset_mm
        self._reports_work = reports_work
        self._state = "Idle"
        self._line = bytearray()
        self._input: deque[str] = deque()
        self._moves: deque[tuple[float, float]] = deque()
        self._speed_mm_s = 0.0
        self._event_ns: int | None = None
        self._reset_parser()

    def handle(self, received: bytes) -> bytes:
        """React to bytes from the line (:class:`hw_mocks.wire.Handler`)."""
        answer = self._advance()
        for byte in received:
            if byte in _REALTIME:
                answer += self._realtime(byte)
            elif byte in b"\r\n":
                if byte == 0x0A or self._line:
                    self._input.append(self._line.decode("latin-1"))
                self._line.clear()
            elif len(self._line) <= _LINE_LENGTH:
                self._line.append(byte)
        return (answer + self._take_lines()).encode("latin-1")

    def due_s(self) -> float | None:
        """The end of a move, a delay or a ramp (:class:`hw_mocks.wire.Handler`)."""
        return None if self._event_ns is None else seconds_until(self._event_ns)

    def power_cycle(self) -> None:
        """Restart as after a loss of supply: machine position 0 is wherever the trolley stands; says its banner."""
        self._track.hold(self._track.at())
        self._origin_m = self._track.at()
        self._moves.clear()
        self._state, self._event_ns = "Restart", time.monotonic_ns()

    # Motion

    def _machine_mm(self) -> float:
        mm = (self._track.at() - self._origin_m) * 1e3
        return round(mm * self._steps_per_mm) / self._steps_per_mm

    def _advance(self) -> str:
        said = ""
        while self._event_ns is not None and time.monotonic_ns() >= self._event_ns:
            if self._state == "Restart":
                said += self._reset()
                self._state, self._event_ns = "Idle", None
            elif self._state == "Hold:1":
                self._state, self._event_ns, self._speed_mm_s = "Hold:0", None, 0.0
            elif self._state == "Run" and self._at_limit():
                self._alarm()
                said += "ALARM:1\r\n"
            else:
                if self._state == "Run" and not self._stalled:
                    self._moves.popleft()
                self._next_move()
        return said + self._take_lines()

    def _at_limit(self) -> bool:
        return not -self._half_m - 1e-9 <= self._x_m(self._moves[0][0]) <= self._half_m + 1e-9

    def _x_m(self, machine_mm: float) -> float:
        return self._origin_m + machine_mm * 1e-3

    def _next_move(self) -> None:
        if not self._moves:
            self._state, self._event_ns, self._speed_mm_s = "Idle", None, 0.0
            return
        target_mm, self._speed_mm_s = self._moves[0]
        now_ns = time.monotonic_ns()
        start_m = self._track.at(now_ns)
        self._stalled = self.faults.active(FaultKind.STALL, now_ns, self._begun) is not None
        if self._stalled:
            self._state, self._event_ns = "Run", now_ns + _STALLED_NS
            return
        if lost := self.faults.active(FaultKind.LOST_STEPS, now_ns, self._begun):
            self._origin_m -= math.copysign(lost.amount, self._x_m(target_mm) - start_m)
        self._begun += 1
        end_m = min(max(self._x_m(target_mm), -self._half_m), self._half_m)
        self._event_ns = now_ns + round(abs(end_m - start_m) * 1e12 / self._speed_mm_s) + 1
        self._track.move(start_m, end_m, now_ns, self._event_ns)
        self._state = "Run"

    def _hold(self) -> None:
        now_ns = time.monotonic_ns()
        x_m, target_m = self._track.at(now_ns), self._x_m(self._moves[0][0])
        # Uniform deceleration covers half of what constant speed would.
        ramp_m = math.copysign(self._speed_mm_s * self._hold_s / 2e3, target_m - x_m)
        end_m = x_m + (ramp_m if abs(ramp_m) < abs(target_m - x_m) else target_m - x_m)
        end_m = min(max(end_m, -self._half_m), self._half_m)
        self._event_ns = now_ns + round(self._hold_s * 1e9) + 1
        self._track.move(x_m, end_m, now_ns, self._event_ns)
        self._state = "Hold:1"

    def _alarm(self) -> None:
        self._track.hold(self._track.at())
        self._moves.clear()
        self._state, self._event_ns, self._speed_mm_s = "Alarm", None, 0.0

    # Conversation

    def _reset_parser(self) -> None:
        self._absolute, self._millimetres, self._rapid, self._feed_mm_min = True, True, True, 0.0
        self._reports_to_offset, self._reports_to_overrides = 0, 1

    def _reset(self) -> str:
        self._line.clear()
        self._input.clear()
        self._moves.clear()
        self._reset_parser()
        return _BANNER

    def _realtime(self, byte: int) -> str:
        if byte == 0x3F:
            return self._report()
        if byte == 0x18:
            said = ""
            if self._state in ("Run", "Hold:1"):
                self._alarm()
                said = "ALARM:3\r\n"
            elif self._state != "Alarm":
                self._state, self._event_ns = "Idle", None
            return said + self._reset() + (_LOCKED if self._state == "Alarm" else "")
        if byte == 0x21 and self._state == "Run":
            self._hold()
        elif byte == 0x7E and self._state == "Hold:0":
            self._next_move()
        return ""

    def _report(self) -> str:
        mm = self._machine_mm()
        kind, shown = ("WPos", mm - self._offset_mm) if self._reports_work else ("MPos", mm)
        speed = round(self._speed_mm_s * 60) if self._state == "Run" else 0
        parts = [self._state, f"{kind}:{shown:z.3f},0.000,0.000", f"FS:{speed},0"]
        if self._reports_to_offset == 0:
            self._reports_to_offset = 30 if self._state == "Run" else 10
            parts.append(f"WCO:{self._offset_mm:.3f},0.000,0.000")
        elif self._reports_to_overrides == 0:
            self._reports_to_overrides = 20
            parts.append("Ov:100,100,100")
        self._reports_to_offset = max(self._reports_to_offset - 1, 0)
        self._reports_to_overrides = max(self._reports_to_overrides - 1, 0)
        return f"<{'|'.join(parts)}>\r\n"

    def _take_lines(self) -> str:
        said = ""
        while self._input and len(self._moves) < _PLANNER_BLOCKS:
            line = re.sub(r"\([^)]*\)|;.*|\s", "", self._input.popleft()).upper()
            if len(line) > _LINE_LENGTH:
                said += "error:11\r\n"
            elif line.startswith("$"):
                said += self._dollar(line)
            else:
                error = self._g_code(line) if line else 0
                said += f"error:{error}\r\n" if error else "ok\r\n"
        return said

    def _dollar(self, line: str) -> str:
        if self._state not in ("Idle", "Alarm"):
            return "error:8\r\n"
        match line:
            case "$I":
                return "[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"
            case "$$":
                rate = self._limit_mm_s * 60
                settings = {10: "1" if not self._reports_work else "0", 13: "0", 20: "0", 21: "1", 22: "0"}
                settings |= {100: f"{self._steps_per_mm:.3f}", 110: f"{rate:.3f}", 130: f"{self._half_m * 2e3:.3f}"}
                return "".join(f"${number}={value}\r\n" for number, value in settings.items()) + "ok\r\n"
            case "$X" if self._state == "Alarm":
                self._state = "Idle"
                return "[MSG:Caution: Unlocked]\r\nok\r\n"
            case "$X" | "$":
                return "ok\r\n"
            case "$H":
                return "error:5\r\n"
        return "error:3\r\n"

    def _g_code(self, line: str) -> int:
        """Accept one block; returns GRBL's error number, 0 for ok."""
        if self._state == "Alarm":
            return 9
        words = _WORD.findall(line)
        if "".join(letter + number for letter, number in words) != line:
            return 2 if line[0].isalpha() else 1
        if any(letter not in "GFXM" for letter, _ in words):
            return 20
        modal = [float(number) for letter, number in words if letter == "G"]
        if not set(modal) <= _MODAL_G or any(letter == "M" for letter, _ in words):
            return 20
        values = {letter: float(number) for letter, number in words if letter in "FX"}
        if len(values) < sum(letter in "FX" for letter, _ in words):
            return 25
        if sum(g in (0.0, 1.0) for g in modal) > 1 or {90.0, 91.0} <= set(modal) or {20.0, 21.0} <= set(modal):
            return 21
        return self._apply(modal, values)

    def _apply(self, modal: list[float], values: dict[str, float]) -> int:
        millimetres = 21.0 in modal or (self._millimetres and 20.0 not in modal)
        absolute = 90.0 in modal or (self._absolute and 91.0 not in modal)
        rapid = 0.0 in modal or (self._rapid and 1.0 not in modal)
        scale = 1.0 if millimetres else 25.4
        feed = values["F"] * scale if "F" in values else self._feed_mm_min
        if feed < 0:
            return 4
        if "X" in values and not rapid and feed == 0:
            return 22
        self._millimetres, self._absolute, self._rapid, self._feed_mm_min = millimetres, absolute, rapid, feed
        if "X" in values:
            self._plan(values["X"] * scale, machine=53.0 in modal)
        return 0

    def _plan(self, value_mm: float, *, machine: bool) -> None:
        if machine:
            target_mm = value_mm
        elif self._absolute:
            target_mm = value_mm + self._offset_mm
        else:
            target_mm = (self._moves[-1][0] if self._moves else self._machine_mm()) + value_mm
        target_mm = round(target_mm * self._steps_per_mm) / self._steps_per_mm
        speed_mm_s = self._limit_mm_s if self._rapid else min(self._feed_mm_min / 60, self._limit_mm_s)
        self._moves.append((target_mm, speed_mm_s))
        if self._state == "Idle" and self._event_ns is None:
            self._event_ns = time.monotonic_ns() + self._start_delay_ns


def start_grbl(
    world: World,
    *,
    length_m: float,
    feed_limit_m_s: float = 0.5,
    origin_m: float | None = None,
    kind: Kind | None = None,
) -> Wire:
    """Put a :class:`Grbl` behind a serial line."""
    device = Grbl(world, length_m=length_m, feed_limit_m_s=feed_limit_m_s, origin_m=origin_m)
    return serve(device, kind=kind, name="grbl")
