"""Devices in virtual time whose data tell the truth: each audio sample carries its number, the route and the trolley's
place at the instant at which it was taken, each frame its number and the polarizers' angles.

Whatever the scheduler and the session file say of a record can thus be compared with what was so.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.virtual_time import Hanging, VirtualClock
from drivers.errors import DeviceLost, DeviceRefused
from drivers.records import (
    AudioBlock,
    Channel,
    ClockFix,
    Identity,
    Level,
    SwitchState,
    TrolleyFix,
)
from hw_mocks.world import Track, World

RATE_HZ = 8_000.0
GUARD_S = 0.004
PROBE_FRAMES = 256
EPOCH = 10_000_000
"""Audio frames are numbered anew, from a multiple of this, whenever the port is opened."""
X_UNIT_M = 1e-5
X_BIAS = 1 << 20
ANGLE_UNIT_RAD = math.radians(0.01)
SWITCH_S = 0.015
TURN_RAD_S = math.radians(450.0)
TROLLEY_M_S = 0.5
LIMIT_M = 1.6
SHAPE = (6, 8)


@dataclass
class Truth:
    """What was so, whatever anybody says."""

    clock: VirtualClock
    world: World = field(default_factory=World)
    source_rad: Track = field(default_factory=lambda: Track(0.0))
    audio: dict[int, tuple[int, str]] = field(default_factory=dict)
    """Audio delivered: number of its first frame, its frames, and during which step."""
    frames: dict[int, str] = field(default_factory=dict)
    """Camera frames delivered, and during which step."""
    late: set[tuple[str, int]] = field(default_factory=set)
    """Kinds and numbers of what was delivered by calls that had hung, which perhaps nobody waited for any more."""
    step: Callable[[], str] = lambda: ""
    """Name of the step that is under way."""


class VirtualDevice:
    """Open, safe and close, being unplugged, and hanging."""

    kind = ""

    def __init__(self, truth: Truth) -> None:
        self.truth = truth
        self.plugged = True
        self.hang_s = 0.0
        """The next call hangs for so long."""
        self.late = False
        """Whether the present call has hung: perhaps nobody waits for its answer any more."""
        self._hung = False
        self.opened = False
        self.lost = False
        """Whether it went away while it was open, and has not been opened since: nobody can make it safe."""
        self.unsafe_since: int | None = None
        """When it was last told to do something, unless it has been made safe since."""
        self.safe_ns: int | None = None
        """When it was last made safe."""

    @property
    def now_ns(self) -> int:
        """The present time."""
        return self.truth.clock.now_ns

    def call(self, command: bool = False) -> None:
        """Every call begins here. Raises when the device hangs or is away; ``command``: it will do something."""
        self.late = False
        if self.hang_s > 0:
            until = self.now_ns + round(self.hang_s * 1e9)
            self.hang_s, self._hung = 0.0, True
            raise Hanging(until)
        self.late, self._hung = self._hung, False
        if not self.plugged:
            self.lost, self.opened = self.lost or self.opened, False
            raise DeviceLost("is gone", where=f"virtual {self.kind}", advice="plug it in")
        if not self.opened:
            raise DeviceRefused("is not open", where=f"virtual {self.kind}", advice="open it first")
        if command:
            self.unsafe_since = self.now_ns

    def open(self) -> Identity:
        """Connect, unless it is unplugged."""
        if not self.plugged:
            raise DeviceLost("nobody answers", where=f"virtual {self.kind}", advice="plug it in")
        self.opened, self.lost = True, False
        return Identity(self.kind, "virtual", f"virtual {self.kind}")

    def make_safe(self) -> None:
        """Make it safe, if it is there."""
        if self.plugged and self.opened:
            self.rest()
            self.unsafe_since = None
        elif self.opened:
            self.lost = True
        self.safe_ns = self.now_ns

    def rest(self) -> None:
        """Its safe state."""

    def close(self) -> None:
        """Release it."""
        self.opened = False


class VirtualRadar(VirtualDevice):
    """Frames of two int32: the number; and the route (0 to 3, 4 where there is none) times 2**22 plus the place."""

    kind = "radar"
    sample_rate_hz = RATE_HZ
    lost_frames = 0

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        self.lose = 0
        """Frames that the next record loses."""
        self.overflow = False
        self._epoch = -1
        self._first: int | None = None
        self._frames = 0
        self._gapless = False
        self._open_ns = 0

    def open(self) -> Identity:
        """Begin to sample."""
        identity = super().open()
        self._epoch += 1
        self._open_ns = self.now_ns
        self._first = None
        return identity

    def begin(self, frames: int) -> None:
        """Ask for frames."""
        self.call(command=True)
        self._frames, self._gapless = frames, False
        self._first = math.ceil((self.now_ns - self._open_ns) * 1e-9 * RATE_HZ + GUARD_S * RATE_HZ)

    def begin_stream(self, frames: int) -> None:
        """Ask for blocks without a gap."""
        self.begin(frames)
        self._gapless = True

    def poll(self) -> AudioBlock | None:
        """The frames asked for, once they have been sampled."""
        self.call()
        if self._first is None:
            return None
        first, frames = self._first, self._frames
        if self._time_ns(first + frames) > self.now_ns:
            return None
        self._first = first + frames if self._gapless else None
        number = self._epoch * EPOCH + first
        samples = self._sample(first, frames)
        self.truth.audio[number] = (frames, self.truth.step())
        if self.late:
            self.truth.late.add((self.kind, number))
        lost, self.lose = self.lose, 0
        overflow, self.overflow = self.overflow, False
        return AudioBlock(samples, RATE_HZ, number, number / RATE_HZ, self._time_ns(first), lost, overflow)

    def cancel(self) -> None:
        """Forget what was asked for."""
        self._first = None

    def rest(self) -> None:
        """Forget what was asked for."""
        self._first = None

    @property
    def recording(self) -> bool:
        """Whether somebody waits for samples."""
        return self._first is not None

    def level(self) -> Level:
        """None."""
        return Level()

    def clock(self) -> ClockFix:
        """The frames' own clock, which is right."""
        self.call()
        t_s = self._epoch * EPOCH / RATE_HZ + (self.now_ns - self._open_ns) * 1e-9
        return ClockFix("radar", t_s, self.now_ns, 1000)

    def _time_ns(self, frame: int) -> int:
        return self._open_ns + round(frame / RATE_HZ * 1e9)

    def _sample(self, first: int, frames: int) -> NDArray[np.int32]:
        at_ns = self._open_ns + np.round((first + np.arange(frames)) * (1e9 / RATE_HZ)).astype(np.int64)
        world = self.truth.world
        place = np.round(world.trolley_x_m.at_many(at_ns) / X_UNIT_M).astype(np.int64) + X_BIAS
        route = np.zeros(frames, np.int64)
        transmit, receive = (
            _values(steps.changes(int(at_ns[0]), int(at_ns[-1])), at_ns) for steps in (world.transmit, world.receive)
        )
        route = np.where((transmit < 0) | (receive < 0), 4, 2 * transmit + receive)
        number = self._epoch * EPOCH + first + np.arange(frames)
        return np.stack([number, (route << 22) + place], axis=1).astype(np.int32)


def _values(changes: list[tuple[int, str]], at_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """0 for H, 1 for V, -1 in between, at each instant."""
    times = np.array([t_ns for t_ns, _ in changes], np.int64)
    codes = np.array(["HV".find(value) for _, value in changes], np.int64)
    values: NDArray[np.int64] = codes[np.maximum(np.searchsorted(times, at_ns, side="right") - 1, 0)]
    return values


def decode(samples: NDArray[np.int32]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Numbers, routes (as :class:`Channel`, 4 for none) and places in m of audio samples (frames, 2)."""
    code = samples[:, 1].astype(np.int64)
    return samples[:, 0].astype(np.int64), code >> 22, ((code & ((1 << 22) - 1)) - X_BIAS) * X_UNIT_M


class VirtualSwitches(VirtualDevice):
    """Two switches, which may stick or jump; they always say how they stand."""

    kind = "switches"

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        self.stuck = False

    def select(self, channel: Channel) -> SwitchState:
        """Route both, and wait until they have settled."""
        self.call(command=True)
        if not self.stuck:
            self._route(channel.transmit, channel.receive)
            self.truth.clock.advance(SWITCH_S)
        return self._state()

    def state(self) -> SwitchState:
        """How they stand."""
        self.call()
        return self._state()

    def jump(self, channel: Channel, delay_s: float) -> None:
        """Fault: they will stand otherwise."""
        at_ns = self.now_ns + round(delay_s * 1e9)
        self.truth.world.transmit.set(channel.transmit, at_ns)
        self.truth.world.receive.set(channel.receive, at_ns)

    def rest(self) -> None:
        """HH."""
        if not self.stuck:
            self._route("H", "H")

    def _route(self, transmit: str, receive: str) -> None:
        world, settled_ns = self.truth.world, self.now_ns + round(SWITCH_S * 1e9)
        for steps, value in ((world.transmit, transmit), (world.receive, receive)):
            if steps.at(settled_ns) != value:
                steps.set("?", self.now_ns)
                steps.set(value, settled_ns)

    def _state(self) -> SwitchState:
        world = self.truth.world
        return SwitchState(world.transmit.at(self.now_ns), world.receive.at(self.now_ns), True, self.now_ns)


class VirtualTrolley(VirtualDevice):
    """A trolley that knows where it is; it goes on to its target when its cable is pulled."""

    kind = "trolley"
    limits_m = (-LIMIT_M, LIMIT_M)

    def __init__(self, truth: Truth) -> None:
        super().__init__(truth)
        self._until_ns = 0

    def start_move(self, x_m: float, speed_m_s: float | None = None) -> None:
        """Begin to move."""
        self.call(command=True)
        if abs(x_m) > LIMIT_M:
            raise DeviceRefused("beyond its limits", where="virtual trolley", advice="stay inside")
        now, track = self.now_ns, self.truth.world.trolley_x_m
        start = track.at(now)
        self._until_ns = now + round(abs(x_m - start) / (speed_m_s or TROLLEY_M_S) * 1e9)
        track.move(start, x_m, now, self._until_ns)

    def poll(self) -> TrolleyFix:
        """Where it is."""
        self.call()
        x_m = self.truth.world.trolley_x_m.at(self.now_ns)
        return TrolleyFix(x_m, 0.0002, self.now_ns < self._until_ns, self.now_ns, "Idle")

    def bump(self, by_m: float) -> None:
        """Fault: somebody pushes it while it stands."""
        track, now = self.truth.world.trolley_x_m, self.now_ns
        if now >= self._until_ns:
            x_m = track.at(now)
            track.move(x_m, x_m + by_m, now, now + 10_000_000)

    def stop(self) -> None:
        """Stop now."""
        self.call()
        self.rest()

    def rest(self) -> None:
        """Stop now."""
        track, now = self.truth.world.trolley_x_m, self.now_ns
        track.hold(track.at(now), now)
        self._until_ns = now
