"""A GRBL 1.1h controller that moves the trolley, at the wire.

Follows the firmware where a driver can see it: ``ok`` when a line is accepted, not when the move is over; up to 15
planned moves; feed hold (``Hold:1`` while slowing down, then ``Hold:0``; a resume in between is ignored); a soft reset
in motion is ``ALARM:3``, in a finished hold it is not and keeps the position; ``WCO`` and ``Ov`` only in some reports;
jogs (``$J=``) end in ``Idle`` by a feed hold or 0x85; while homing (``$H``) nothing is answered but a soft reset
(``ALARM:6``); after ``ALARM:1`` and ``ALARM:2`` everything waits for a soft reset. With homing (``$22=1``) the
controller starts locked, and machine positions after homing are those of the firmware, 0 at the positive end.

Faults of its own (counts are moves): ``LOST_STEPS`` (the trolley falls behind by ``amount`` metres in a move and the
controller, which only counts steps, does not know), ``STALL`` (``Run`` without advancing until it ends; homing does not
find its switch, ``ALARM:9``).

Left out: arcs, probes and spindle; each move is from rest to rest, neighbouring moves are not blended.
"""

from __future__ import annotations

import math
import re
import time
from collections import deque
from typing import Literal

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.grbl_gcode import Motion, Parser
from hw_mocks.stepper_motion import Profile, braking, travel
from hw_mocks.wire import Kind, Wire, seconds_until, serve
from hw_mocks.world import World

_BANNER = "\r\nGrbl 1.1h ['$' for help]\r\n"
_LOCKED = "[MSG:'$H'|'$X' to unlock]\r\n"
_RESET_TO_GO_ON = "[MSG:Reset to continue]\r\n"
_REALTIME = b"?!~\x18\x85"
_PLANNER_BLOCKS = 15
_STALLED_NS = 20_000_000
_LINE_LENGTH = 80


class Grbl:
    """The controller and the motor.

    Args:
        world: where the trolley's position is written.
        length_m: length of the rail, m (also ``$130``); a limit switch at either end raises ``ALARM:1``.
        feed_limit_m_s: greatest speed, m/s (``$110``); make it large for quick simulated moves.
        acceleration_m_s2: of every move (``$120``), m/s^2; infinite for none.
        origin_m: x at machine position 0, m; left out: the rail's left end (homing sets it anew).
        steps_per_mm: motor steps (``$100``); positions are whole steps.
        hold_s: time in which the trolley slows down to a feed hold where there is no acceleration, s.
        start_delay_s: time from ``ok`` to the first step, s; the state is still Idle.
        work_offset_mm: G54 offset of the axis, mm.
        reports_work: report work positions (``$10=0``), so that machine positions need the rare ``WCO``.
        homing: limit switches can be sought (``$22=1``).
        soft_limits: targets beyond ``$130`` raise ``ALARM:2`` (``$20=1``; needs ``homing``).
        home_end: 1 where homing seeks the switch at positive x, -1 for the other end (``$23``).
        homing_m_s: speed of homing (``$25``), m/s.
        pull_off_mm: distance from the switch after homing (``$27``), mm.
    """

    def __init__(
        self,
        world: World,
        *,
        length_m: float,
        feed_limit_m_s: float = 0.5,
        acceleration_m_s2: float = math.inf,
        origin_m: float | None = None,
        steps_per_mm: float = 250.0,
        hold_s: float = 0.05,
        start_delay_s: float = 0.005,
        work_offset_mm: float = 0.0,
        reports_work: bool = False,
        homing: bool = False,
        soft_limits: bool = False,
        home_end: Literal[1, -1] = 1,
        homing_m_s: float = 0.5,
        pull_off_mm: float = 1.0,
    ) -> None:
        self.faults = FaultScript()
        """Faults of the controller and its line."""
        self._begun = 0
        self._stalled = False
        self._track = world.trolley_x_m
        self._half_m = length_m / 2
        self._origin_m = -self._half_m if origin_m is None else origin_m
        self._limit_mm_s = feed_limit_m_s * 1e3
        self._acceleration_mm_s2 = acceleration_m_s2 * 1e3
        self._steps_per_mm = steps_per_mm
        self._hold_s = hold_s
        self._start_delay_ns = round(start_delay_s * 1e9)
        self._offset_mm = work_offset_mm
        self._reports_work = reports_work
        self._homing, self._soft_limits = homing, soft_limits
        self._home_end, self._homing_mm_s, self._pull_off_mm = home_end, homing_m_s * 1e3, pull_off_mm
        self._state = "Alarm" if homing else "Idle"
        self._blocked = self._report_owed = False
        self._line = bytearray()
        self._input: deque[str] = deque()
        self._moves: deque[tuple[float, float]] = deque()
        self._profile: Profile | None = None
        self._profile_ns = 0
        self._event_ns: int | None = None
        self._parser = Parser()
        self._reports_to_offset, self._reports_to_overrides = 0, 1

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
        self._stand()
        self._origin_m = self._track.at()
        self._state, self._event_ns = "Restart", time.monotonic_ns()

    # Motion

    def _machine_mm(self) -> float:
        mm = (self._track.at() - self._origin_m) * 1e3
        return round(mm * self._steps_per_mm) / self._steps_per_mm

    def _advance(self) -> str:
        said = ""
        while self._event_ns is not None and time.monotonic_ns() >= self._event_ns:
            match self._state:
                case "Restart":
                    self._state, self._event_ns = ("Alarm" if self._homing else "Idle"), None
                    said += self._reset() + (_LOCKED if self._homing else "")
                case "Hold:1":
                    self._state, self._event_ns, self._profile = "Hold:0", None, None
                case "Home":
                    said += self._end_homing()
                case "Run" | "Jog" if self._profile is not None and self._at_limit():
                    said += self._alarm(1, blocked=True)
                case _:
                    if self._profile is not None and self._moves:
                        self._moves.popleft()
                    self._next_move()
        return said + self._take_lines()

    def _at_limit(self) -> bool:
        return bool(self._moves) and not -self._half_m - 1e-9 <= self._x_m(self._moves[0][0]) <= self._half_m + 1e-9

    def _x_m(self, machine_mm: float) -> float:
        return self._origin_m + machine_mm * 1e-3

    def _next_move(self) -> None:
        if not self._moves:
            self._state, self._event_ns, self._profile = "Idle", None, None
            return
        jog = self._state == "Jog"
        target_mm, speed_mm_s = self._moves[0]
        now_ns = time.monotonic_ns()
        start_m = self._track.at(now_ns)
        self._stalled = self.faults.active(FaultKind.STALL, now_ns, self._begun) is not None
        if self._stalled:
            self._state, self._event_ns, self._profile = "Jog" if jog else "Run", now_ns + _STALLED_NS, None
            return
        if lost := self.faults.active(FaultKind.LOST_STEPS, now_ns, self._begun):
            self._origin_m -= math.copysign(lost.amount, self._x_m(target_mm) - start_m)
        self._begun += 1
        way_mm = (self._x_m(target_mm) - start_m) * 1e3
        room_mm = (self._half_m - math.copysign(1, way_mm) * start_m) * 1e3
        profile = travel(abs(way_mm), speed_mm_s, self._acceleration_mm_s2).cut(max(room_mm, 0.0))
        self._follow(profile, way_mm, now_ns)
        self._state = "Jog" if jog else "Run"

    def _follow(self, profile: Profile, way_mm: float, now_ns: int) -> None:
        start_m, sign = self._track.at(now_ns), math.copysign(1e-3, way_mm)
        times_ns = [now_ns + round(t_s * 1e9) for t_s in profile.t_s]
        self._track.follow(times_ns, [start_m + sign * s_mm for s_mm in profile.s_mm])
        self._profile, self._profile_ns = profile, now_ns
        self._event_ns = times_ns[-1] + 1

    def _speed_mm_s(self) -> float:
        if self._profile is None:
            return 0.0
        return self._profile.speed_mm_s((time.monotonic_ns() - self._profile_ns) * 1e-9)

    def _hold(self) -> None:
        now_ns = time.monotonic_ns()
        speed_mm_s = self._speed_mm_s()
        way_mm = (self._x_m(self._moves[0][0]) - self._track.at(now_ns)) * 1e3
        with_ramp = math.isfinite(self._acceleration_mm_s2)
        ramp = braking(speed_mm_s, speed_mm_s / self._acceleration_mm_s2 if with_ramp else self._hold_s)
        room_mm = (self._half_m - math.copysign(1, way_mm) * self._track.at(now_ns)) * 1e3
        self._follow(ramp.cut(max(min(abs(way_mm), room_mm), 0.0)), way_mm, now_ns)
        if self._state == "Jog":
            self._moves.clear()  # a jog is cancelled, not held
        else:
            self._state = "Hold:1"

    def _stand(self) -> None:
        self._track.hold(self._track.at())
        self._moves.clear()
        self._profile = self._event_ns = None

    def _alarm(self, number: int, *, blocked: bool = False) -> str:
        self._stand()
        self._state, self._blocked = "Alarm", blocked
        return f"ALARM:{number}\r\n" + (_RESET_TO_GO_ON if blocked else "")

    def _start_homing(self) -> None:
        now_ns = time.monotonic_ns()
        self._stalled = self.faults.active(FaultKind.STALL, now_ns, self._begun) is not None
        self._begun += 1
        way_mm = (self._home_end * self._half_m - self._track.at(now_ns)) * 1e3
        seek = travel(abs(way_mm), self._homing_mm_s, self._acceleration_mm_s2)
        self._state = "Home"
        if self._stalled:
            self._event_ns = now_ns + round(seek.seconds * 1.5e9)
            return
        self._follow(seek, way_mm, now_ns)

    def _end_homing(self) -> str:
        if self._stalled:
            self._stalled = self._report_owed = False
            return self._alarm(9)
        end_m = self._home_end * (self._half_m - self._pull_off_mm * 1e-3)
        self._track.hold(end_m)
        machine_mm = -self._pull_off_mm if self._home_end > 0 else self._pull_off_mm - self._half_m * 2e3
        self._origin_m = end_m - machine_mm * 1e-3
        # A status question that came meanwhile is answered while the state is still Home.
        said = self._report() if self._report_owed else ""
        self._report_owed = False
        self._state, self._event_ns, self._profile = "Idle", None, None
        return said + "ok\r\n"

    # Conversation

    def _reset(self) -> str:
        self._line.clear()
        self._input.clear()
        self._moves.clear()
        self._parser.reset()
        self._blocked = self._report_owed = False
        self._reports_to_offset, self._reports_to_overrides = 0, 1
        return _BANNER

    def _realtime(self, byte: int) -> str:
        if byte == 0x18:
            said = ""
            if self._state in ("Run", "Jog", "Hold:1"):
                said = self._alarm(3)
            elif self._state == "Home":
                said = self._alarm(6)
            elif self._state != "Alarm":
                self._state, self._event_ns, self._profile = "Idle", None, None
            return said + self._reset() + (_LOCKED if self._state == "Alarm" else "")
        if self._blocked:
            return ""
        if byte == 0x3F:
            if self._state == "Home":
                self._report_owed = True
                return ""
            return self._report()
        if (byte == 0x21 and self._state in ("Run", "Jog")) or (byte == 0x85 and self._state == "Jog"):
            if self._profile is not None and self._moves:
                self._hold()
            elif self._state == "Jog":
                self._moves.clear()
            else:
                self._state, self._event_ns = "Hold:0", None
        elif byte == 0x7E and self._state == "Hold:0":
            self._next_move()
        return ""

    def _report(self) -> str:
        mm = self._machine_mm()
        kind, shown = ("WPos", mm - self._offset_mm) if self._reports_work else ("MPos", mm)
        speed = round(self._speed_mm_s() * 60) if self._state in ("Run", "Jog") else 0
        parts = [self._state, f"{kind}:{shown:z.3f},0.000,0.000", f"FS:{speed},0"]
        if self._reports_to_offset == 0:
            self._reports_to_offset = 30 if self._state in ("Run", "Jog") else 10
            parts.append(f"WCO:{self._offset_mm:.3f},0.000,0.000")
        elif self._reports_to_overrides == 0:
            self._reports_to_overrides = 20
            parts.append("Ov:100,100,100")
        self._reports_to_offset = max(self._reports_to_offset - 1, 0)
        self._reports_to_overrides = max(self._reports_to_overrides - 1, 0)
        return f"<{'|'.join(parts)}>\r\n"

    def _take_lines(self) -> str:
        said = ""
        while self._input and len(self._moves) < _PLANNER_BLOCKS and self._state != "Home" and not self._blocked:
            line = re.sub(r"\([^)]*\)|;.*|\s", "", self._input.popleft()).upper()
            if len(line) > _LINE_LENGTH:
                said += "error:11\r\n"
            elif line.startswith("$"):
                said += self._dollar(line)
            elif line and self._state in ("Alarm", "Jog"):
                said += "error:9\r\n"
            else:
                said += self._accept(self._parser.block(line) if line else None)
        return said

    def _dollar(self, line: str) -> str:
        if line.startswith("$J="):
            return self._accept(self._parser.jog(line[3:])) if self._state in ("Idle", "Jog") else "error:8\r\n"
        if self._state not in ("Idle", "Alarm"):
            return "error:8\r\n"
        match line:
            case "$I":
                return "[VER:1.1h.20190830:]\r\n[OPT:V,15,128]\r\nok\r\n"
            case "$$":
                return "".join(f"${number}={value}\r\n" for number, value in self._settings().items()) + "ok\r\n"
            case "$X" if self._state == "Alarm":
                self._state = "Idle"
                return "[MSG:Caution: Unlocked]\r\nok\r\n"
            case "$X" | "$":
                return "ok\r\n"
            case "$H" if self._homing:
                self._start_homing()
                return ""
            case "$H":
                return "error:5\r\n"
        return "error:3\r\n"

    def _settings(self) -> dict[int, str]:
        ramp = self._acceleration_mm_s2 if math.isfinite(self._acceleration_mm_s2) else 1e6
        return {
            10: str(int(not self._reports_work)), 13: "0", 20: str(int(self._soft_limits)), 21: "1",
            22: str(int(self._homing)), 23: str(int(self._home_end < 0)), 25: f"{self._homing_mm_s * 60:.3f}",
            27: f"{self._pull_off_mm:.3f}", 100: f"{self._steps_per_mm:.3f}", 110: f"{self._limit_mm_s * 60:.3f}",
            120: f"{ramp:.3f}", 130: f"{self._half_m * 2e3:.3f}",
        }  # fmt: skip

    def _accept(self, asked: int | Motion | None) -> str:
        if isinstance(asked, int):
            return f"error:{asked}\r\n"
        if asked is None:
            return "ok\r\n"
        target_mm = asked.value_mm
        if asked.frame == "work":
            target_mm += self._offset_mm
        elif asked.frame == "relative":
            target_mm += self._moves[-1][0] if self._moves else self._machine_mm()
        target_mm = round(target_mm * self._steps_per_mm) / self._steps_per_mm
        if self._soft_limits and not -self._half_m * 2e3 <= target_mm <= 0:
            return "error:15\r\n" if asked.jog else self._alarm(2, blocked=True)
        self._moves.append((target_mm, min(asked.feed_mm_min / 60, self._limit_mm_s)))
        if self._state == "Idle" and self._event_ns is None:
            self._event_ns = time.monotonic_ns() + self._start_delay_ns
            if asked.jog:
                self._state = "Jog"
        return "ok\r\n"


def start_grbl(
    world: World,
    *,
    length_m: float,
    feed_limit_m_s: float = 0.5,
    acceleration_m_s2: float = math.inf,
    origin_m: float | None = None,
    kind: Kind | None = None,
) -> Wire:
    """Put a :class:`Grbl` behind a serial line."""
    device = Grbl(
        world,
        length_m=length_m,
        feed_limit_m_s=feed_limit_m_s,
        acceleration_m_s2=acceleration_m_s2,
        origin_m=origin_m,
    )
    return serve(device, kind=kind, name="grbl")
