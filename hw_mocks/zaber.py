"""A Zaber linear stage that moves the trolley, speaking the ASCII protocol (version 7) at the wire.

``/1 1 04 move abs 1000:EC`` is answered ``@01 1 04 OK BUSY WR 0``; message numbers and checksums are optional, replies
carry a number where the command did. A command for another device is not answered. After power on the stage has no
reference (flag ``WR``) until it is homed to its negative end.

Faults of its own (counts are moves): ``STALL`` (it stops half-way with flag ``FS``), ``LOST_STEPS`` (the trolley falls
behind by ``amount`` metres and the stage does not know).
"""

from __future__ import annotations

import math
import re
import time

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.stepper_motion import Profile, braking, travel
from hw_mocks.wire import Kind, Wire, seconds_until, serve
from hw_mocks.world import World

_COMMAND = re.compile(r"/\s*(?:(\d{1,2})(?:\s+(\d)(?:\s+(\d{1,2}))?)?)?\s*([^:]*?)\s*(?::([0-9A-F]{2}))?")
_SPEED_UNIT = 1.6384
_PACKET = 80


class ZaberStage:
    """The stage; device 1 with one axis.

    Args:
        world: where the trolley's position is written.
        length_m: travel, m; its position 0 (home) is the rail's left end.
        microstep_m: length of one microstep, m.
        speed_m_s: its ``maxspeed``, m/s.
        acceleration_m_s2: of every move, m/s^2.
        homed: whether it has a reference when switched on.
    """

    def __init__(
        self,
        world: World,
        *,
        length_m: float,
        microstep_m: float = 0.49609375e-6,
        speed_m_s: float = 0.5,
        acceleration_m_s2: float = 5.0,
        homed: bool = False,
    ) -> None:
        self.faults = FaultScript()
        """Faults of the stage and its line."""
        self._track = world.trolley_x_m
        self._half_m, self._microstep_m = length_m / 2, microstep_m
        self._maxspeed = round(speed_m_s / microstep_m * _SPEED_UNIT)
        self._acceleration_m_s2 = acceleration_m_s2
        # Without a reference it counts from where it stands.
        self._zero_m = -self._half_m if homed else self._track.at()
        self._flags: list[str] = [] if homed else ["WR"]
        self._begun = 0
        self._profile: Profile | None = None
        self._profile_ns, self._sign = 0, 1.0
        self._ends_ns: int | None = None
        self._ends_in = ""
        self._received = b""

    def handle(self, received: bytes) -> bytes:
        """React to bytes from the line (:class:`hw_mocks.wire.Handler`)."""
        self._advance()
        self._received = (self._received + received)[-4096:]
        answer = b""
        while b"\n" in self._received:
            line, _, self._received = self._received.partition(b"\n")
            answer += self._answer(line.decode("latin-1").strip())
        return answer

    def due_s(self) -> float | None:
        """The end of a move (:class:`hw_mocks.wire.Handler`)."""
        return None if self._ends_ns is None else seconds_until(self._ends_ns)

    @property
    def position(self) -> int:
        """Where it believes to stand, microsteps."""
        return round((self._track.at() - self._zero_m) / self._microstep_m)

    def _advance(self) -> None:
        if self._ends_ns is None or time.monotonic_ns() < self._ends_ns:
            return
        if self._ends_in == "home":
            self._zero_m, self._flags = -self._half_m, []
        elif self._ends_in == "stall":
            self._flags = ["FS", *self._flags]
        self._ends_ns, self._ends_in, self._profile = None, "", None

    def _answer(self, line: str) -> bytes:
        match = _COMMAND.fullmatch(line)
        if match is None or (match[5] and int(match[5], 16) != _checksum(line[1 : line.rindex(":")])):
            return b""
        device, axis = int(match[1] or 0), int(match[2] or 0)
        if device not in (0, 1):
            return b""
        number = "" if match[3] is None else f" {match[3]}"
        data = "BADAXIS" if axis > 1 else self._obey(match[4].split())
        refused = data.startswith("BAD")
        status = "IDLE" if self._ends_ns is None else "BUSY"
        flag = self._flags[0] if self._flags else "--"
        reply = f"01 {axis}{number} {'RJ' if refused else 'OK'} {status} {flag} {data}"
        return f"@{reply}:{_checksum(reply):02X}\r\n".encode()

    def _obey(self, words: list[str]) -> str:
        match words:
            case []:
                return "0"
            case ["get", name]:
                return self._get(name)
            case ["warnings"]:
                return " ".join([f"{len(self._flags):02d}", *self._flags])
            case ["warnings", "clear"]:
                flags, self._flags = self._flags, [flag for flag in self._flags if flag.startswith("W")]
                return " ".join([f"{len(flags):02d}", *flags])
            case ["home"]:
                self._start(-self._half_m, self._maxspeed, "home")
                return "0"
            case ["stop"]:
                self._stop()
                return "0"
            case ["move", "abs", target, *rest] if len(rest) <= 2 and all(map(_is_number, [target, *rest])):
                if not 0 <= int(target) <= round(2 * self._half_m / self._microstep_m):
                    return "BADDATA"
                speed = min(int(rest[0]), self._maxspeed) if rest and int(rest[0]) else self._maxspeed
                self._start(self._zero_m + int(target) * self._microstep_m, speed, "")
                return "0"
        return "BADCOMMAND"

    def _get(self, name: str) -> str:
        values = {
            "pos": self.position, "limit.min": 0, "limit.max": round(2 * self._half_m / self._microstep_m),
            "maxspeed": self._maxspeed, "deviceid": 50419, "system.axiscount": 1, "version": "7.38",
            "comm.packet.size.max": _PACKET, "comm.word.size.max": 50,
        }  # fmt: skip
        return str(values.get(name, "BADCOMMAND"))

    def _start(self, x_m: float, speed: int, ends_in: str) -> None:
        now_ns = time.monotonic_ns()
        start_m = self._track.at(now_ns)
        self._flags = [flag for flag in self._flags if flag.startswith("W")]
        if lost := self.faults.active(FaultKind.LOST_STEPS, now_ns, self._begun):
            slip_m = math.copysign(lost.amount, x_m - start_m)
            self._zero_m, x_m = self._zero_m - slip_m, x_m - slip_m
        way_mm = (min(max(x_m, -self._half_m), self._half_m) - start_m) * 1e3
        profile = travel(abs(way_mm), speed / _SPEED_UNIT * self._microstep_m * 1e3, self._acceleration_m_s2 * 1e3)
        if self.faults.active(FaultKind.STALL, now_ns, self._begun):
            profile, ends_in = profile.cut(abs(way_mm) / 2), "stall"
        self._begun += 1
        self._follow(profile, way_mm, now_ns, ends_in)

    def _stop(self) -> None:
        if self._profile is None:
            return
        now_ns = time.monotonic_ns()
        speed_mm_s = self._profile.speed_mm_s((now_ns - self._profile_ns) * 1e-9)
        room_mm = (self._half_m - self._sign * self._track.at(now_ns)) * 1e3
        profile = braking(speed_mm_s, speed_mm_s / (self._acceleration_m_s2 * 1e3)).cut(max(room_mm, 0.0))
        self._follow(profile, self._sign, now_ns, "")

    def _follow(self, profile: Profile, way_mm: float, now_ns: int, ends_in: str) -> None:
        start_m, self._sign = self._track.at(now_ns), math.copysign(1.0, way_mm)
        times_ns = [now_ns + round(t_s * 1e9) for t_s in profile.t_s]
        self._track.follow(times_ns, [start_m + self._sign * 1e-3 * s_mm for s_mm in profile.s_mm])
        self._profile, self._profile_ns = profile, now_ns
        self._ends_ns, self._ends_in = times_ns[-1] + 1, ends_in


def _checksum(body: str) -> int:
    """The protocol's longitudinal redundancy check: with it, all bytes of a message add up to 0."""
    return -sum(body.encode("latin-1")) & 0xFF


def _is_number(word: str) -> bool:
    return re.fullmatch(r"-?\d{1,12}", word) is not None


def start_zaber(
    world: World, *, length_m: float, speed_m_s: float = 0.5, homed: bool = False, kind: Kind | None = None
) -> Wire:
    """Put a :class:`ZaberStage` behind a line."""
    return serve(ZaberStage(world, length_m=length_m, speed_m_s=speed_m_s, homed=homed), kind=kind, name="zaber")
