"""What set-up mode does with switches, trolley, polarizers and the radar."""

from __future__ import annotations

import math
import time
from typing import cast

from drivers import contracts
from drivers.errors import DeviceRefused
from drivers.records import Channel, PolarizerFix, SwitchState, TrolleyFix
from polfuse_lab.bench.protocol import SwitchView, TrolleyView, TurnView
from polfuse_lab.bench.station import Bench, Station
from polfuse_lab.doctor.devices import LISTEN_S, judged, who_answered
from polfuse_lab.records import Sweeps

MOVING_LOOK_S = 0.08
"""What moves is looked at so often."""


class SwitchStation(Station):
    """The transfer switches."""

    state: SwitchState | None = None

    @property
    def view(self) -> SwitchView | None:
        """Where they stand; None while that is not known."""
        state = self.state
        return None if state is None else SwitchView(state.transmit + state.receive, state.verified)

    def route(self) -> Channel:
        """The channel; HH while that is not known."""
        state = self.state
        return Channel.HH if state is None else Channel[state.transmit + state.receive]

    def select(self, channel: str) -> None:
        """Switch to a channel."""
        self.ask(lambda: self._seen(self.call(self._device.select, Channel[channel])))

    @property
    def _device(self) -> contracts.Switches:
        if self.made is None:
            raise DeviceRefused("are not open", where=f"switches ({self.driver})", advice="try them again first")
        return cast(contracts.Switches, self.made.device)

    def opened(self) -> None:
        """Ask for the route."""
        self.look()

    def look(self) -> None:
        """Ask for the route. Raises :class:`DeviceError`."""
        self._seen(self.call(self._device.state))

    def closed(self) -> None:
        """Nobody knows the route."""
        self.state = None

    def _seen(self, state: SwitchState) -> None:
        self.state = state
        self.bench.feed.offer(state)
        self.bench.on_change()


class TrolleyStation(Station):
    """The trolley on its rail."""

    fix: TrolleyFix | None = None
    _limits_m: tuple[float, float] = (0.0, 0.0)
    _target_m: float | None = None

    @property
    def view(self) -> TrolleyView | None:
        """Where it is; None while that is not known."""
        fix = self.fix
        return None if fix is None else TrolleyView(fix.x_m, fix.sd_m, self.moving, *self._limits_m, fix.state)

    @property
    def moving(self) -> bool:
        """Whether it is under way."""
        fix = self.fix  # the station's thread may forget it meanwhile
        return fix is not None and (fix.moving or self._target_m is not None)

    def move_to(self, x_m: float) -> None:
        """Move to a place; refused beyond the limits."""
        self.ask(lambda: self._go(x_m))

    def jog(self, by_m: float) -> None:
        """Move from where it is, or is going to, no further than the limits."""
        self.ask(lambda: self._jog(by_m))

    def stop(self) -> None:
        """Stop now, and forget what was asked before."""
        self.ask(self._halt, first=True)

    @property
    def _device(self) -> contracts.Trolley:
        if self.made is None:
            raise DeviceRefused("is not open", where=f"trolley ({self.driver})", advice="try it again first")
        return cast(contracts.Trolley, self.made.device)

    def opened(self) -> None:
        """Ask for limits and place."""
        self._limits_m = self._device.limits_m
        self.look()

    def look(self) -> None:
        """Ask where it is. Raises :class:`DeviceError`."""
        fix = self.call(self._device.poll)
        if not fix.moving:
            self._target_m = None
        self.LOOK_S = MOVING_LOOK_S if self.moving or fix.moving else 0.5
        changed = self.fix is None or (fix.x_m, fix.moving, fix.state) != (
            self.fix.x_m,
            self.fix.moving,
            self.fix.state,
        )
        self.fix = fix
        if changed:
            self.bench.feed.offer(fix)
            self.bench.on_change()

    def closed(self) -> None:
        """Nobody knows where it is."""
        self.fix = self._target_m = None

    def _go(self, x_m: float) -> None:
        low, high = self._limits_m
        if not (math.isfinite(x_m) and low <= x_m <= high):
            raise DeviceRefused(
                f"x = {x_m:g} m is beyond the rail ({low:g} to {high:g} m)",
                where=f"trolley ({self.driver})",
                advice="choose a place on the rail",
            )
        device = self._device
        if self.moving:
            # No motor takes two orders.
            self._halt()
            end = time.monotonic() + 2.0
            while self.call(device.poll).moving and time.monotonic() < end:
                self._control.slice()
        self.call(device.start_move, x_m)
        self._target_m = x_m
        self.look()

    def _jog(self, by_m: float) -> None:
        if self.fix is None:
            self.look()
        assert self.fix is not None
        low, high = self._limits_m
        begin = self._target_m if self._target_m is not None else self.fix.x_m
        self._go(min(max(begin + by_m, low), high) if math.isfinite(by_m) else math.nan)

    def _halt(self) -> None:
        self.call(self._device.stop)
        self._target_m = None
        self.look()


class TurnStation(Station):
    """A polarizer in its mount."""

    LOOK_S = 0.25
    fix: PolarizerFix | None = None
    _turning = False

    @property
    def view(self) -> TurnView | None:
        """How it stands; None while that is not known."""
        fix = self.fix
        return None if fix is None else TurnView(math.degrees(fix.angle_rad), fix.moving)

    @property
    def moving(self) -> bool:
        """Whether it turns."""
        fix = self.fix
        return fix is not None and fix.moving

    def angle(self) -> tuple[float, float, bool]:
        """Angle and its standard deviation (rad), and whether it turns; 0 while that is not known."""
        fix = self.fix
        return (0.0, 0.0, False) if fix is None else (fix.angle_rad, fix.sd_rad, fix.moving)

    def turn(self, angle_deg: float) -> None:
        """Turn to an angle from horizontal, degrees."""
        self.ask(lambda: self._go(angle_deg))

    def stop(self) -> None:
        """Stop turning."""
        self.ask(lambda: self.call(self._device.stop), first=True)

    @property
    def _device(self) -> contracts.Polarizer:
        if self.made is None:
            raise DeviceRefused("is not open", where=f"{self.kind} ({self.driver})", advice="try it again first")
        return cast(contracts.Polarizer, self.made.device)

    def opened(self) -> None:
        """Ask for the angle."""
        self.look()

    def look(self) -> None:
        """Ask for the angle. Raises :class:`DeviceError`."""
        fix = self.call(self._device.poll)
        changed = self.fix is None or (fix.angle_rad, fix.moving) != (self.fix.angle_rad, self.fix.moving)
        self.fix = fix
        self.LOOK_S = MOVING_LOOK_S if fix.moving else 0.25
        if changed:
            self.bench.on_change()

    def closed(self) -> None:
        """Nobody knows the angle."""
        self.fix = None

    def _go(self, angle_deg: float) -> None:
        if not math.isfinite(angle_deg):
            raise DeviceRefused(f"{angle_deg} deg is no angle", where=self.kind, advice="give degrees from horizontal")
        device = self._device
        if self.moving:
            self.call(device.stop)
            end = time.monotonic() + 2.0
            while self.call(device.poll).moving and time.monotonic() < end:
                self._control.slice()
        self.call(device.start_turn, math.radians(angle_deg))
        self.look()


class RadarStation(Station):
    """The radar's audio: judged every second by the doctor's measures."""

    LOOK_S = 1.0

    def __init__(self, bench: Bench, kind: str) -> None:
        super().__init__(bench, kind)
        self._asked = False
        self._heard_at = 0.0

    @property
    def _device(self) -> contracts.Radar:
        assert self.made is not None
        return cast(contracts.Radar, self.made.device)

    def opened(self) -> None:
        """Let the live view listen."""
        self.bench.feed.overhear(self._device)
        self._asked = False
        if not isinstance(self._device, contracts.OverheardRadar):
            self.LOOK_S = 0.05

    def look(self) -> None:
        """Judge the newest piece of the signal. Raises :class:`DeviceError`."""
        radar = self._device
        frames = round(LISTEN_S * radar.sample_rate_hz)
        if isinstance(radar, contracts.OverheardRadar):
            block = radar.newest(frames)
            # Nothing is asked for, but a sound card that has gone is noticed.
            self.call(radar.poll)
            if block is None or len(block.samples) < frames // 2:
                return
        else:
            if not self._asked:
                self.call(radar.begin, frames)
                self._asked = True
            block = self.call(radar.poll)
            if block is None:
                return
            self._asked = False
            self.bench.feed.offer(Sweeps(block, self.bench.route(), -1))
        assert self.made is not None
        self.tell(judged(self.bench.rig, self.driver, who_answered(self.made), block.samples, block.sample_rate_hz))

    def closed(self) -> None:
        """Nobody listens."""
        self.bench.feed.overhear(None)
