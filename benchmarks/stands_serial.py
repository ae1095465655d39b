"""Stands of switches, trolleys and the polarizer, whose simulated devices hang on wires with faults."""

from __future__ import annotations

import math
import time
from pathlib import Path
from typing import Any

from benchmarks.stand import Untruthful, within
from drivers.polarizer.ell14 import Ell14
from drivers.records import Channel
from drivers.switches.dowkey_ms import DowKeyMs
from drivers.switches.minicircuits_rc import MiniCircuitsRc
from drivers.switches.numato_relay import NumatoRelay
from drivers.trolley.encoder import EncoderTrolley
from drivers.trolley.grbl import GrblTrolley
from hw_mocks.encoder import start_encoder
from hw_mocks.faults import FaultKind
from hw_mocks.grbl import start_grbl
from hw_mocks.minicircuits import host_and_port, start_rc_box
from hw_mocks.numato import start_relays
from hw_mocks.rotator import start_rotator
from hw_mocks.switch_box import start_switch_box
from hw_mocks.wire import Wire
from hw_mocks.world import World


class _SerialStand:
    """What serial stands share: the wire's script."""

    def __init__(self, name: str, wire: Wire, driver: Any, timeout_s: float) -> None:
        self.name, self._wire, self.driver, self.timeout_s = name, wire, driver, timeout_s
        self.opening_s = timeout_s + 3.0
        self._late_s = 0.0

    def begin(self, kind: FaultKind, amount: float) -> None:
        """Begin a fault of the line or the device; ``SLOW`` by 0 is half as much again as the driver's time-out."""
        if kind is FaultKind.SLOW and amount == 0:
            amount = 1.5 * self.timeout_s
        self._late_s = amount if kind is FaultKind.SLOW else 0.0
        self._wire.faults.start(kind, amount=amount)
        self._wire.wake()

    def end(self, kind: FaultKind) -> None:
        """End it, and wait until the cable is back or late answers have arrived."""
        self._wire.faults.stop(kind)
        self._wire.wake()
        time.sleep(0.1 + self._late_s)

    def reset(self) -> None:
        """Nothing to do."""

    def close(self) -> None:
        """Close the driver, then its device."""
        self.driver.close()
        self._wire.close()


class SwitchStand(_SerialStand):
    """From HH to VV and back; the route that the driver states is compared with the true one."""

    def __init__(self, name: str, wire: Wire, driver: Any, timeout_s: float, world: World) -> None:
        super().__init__(name, wire, driver, timeout_s)
        self._world = world

    def round(self) -> None:
        """Both switches there and back."""
        for channel in (Channel.VV, Channel.HH):
            state = self.driver.select(channel)
            true = (self._world.transmit.at(), self._world.receive.at())
            if true != (state.transmit, state.receive):
                raise Untruthful(f"says {state.transmit}{state.receive}, is {''.join(true)}")


def dowkey_stand(folder: Path, timeout_s: float = 1.0) -> SwitchStand:
    """Dow-Key MS over a serial line."""
    world = World()
    wire = start_switch_box(world)
    options = DowKeyMs.Options(port=wire.url, timeout_s=timeout_s, settle_s=0.03, cycles_folder=str(folder))
    return SwitchStand("switches: Dow-Key MS", wire, DowKeyMs(options), timeout_s, world)


def numato_stand(folder: Path, timeout_s: float = 1.0) -> SwitchStand:
    """Numato relays over a serial line, with fail-safe switches."""
    world = World()
    wire = start_relays(world)
    options = NumatoRelay.Options(port=wire.url, timeout_s=timeout_s, settle_s=0.03, cycles_folder=str(folder))
    return SwitchStand("switches: Numato relays", wire, NumatoRelay(options), timeout_s, world)


def rc_stand(folder: Path, timeout_s: float = 1.0) -> SwitchStand:
    """Mini-Circuits RC over HTTP."""
    world = World()
    wire = start_rc_box(world)
    host, port = host_and_port(wire)
    options = MiniCircuitsRc.Options(
        host=host, port=port, timeout_s=timeout_s, settle_s=0.03, cycles_folder=str(folder)
    )
    return SwitchStand("switches: Mini-Circuits RC", wire, MiniCircuitsRc(options), timeout_s, world)


class TrolleyStand(_SerialStand):
    """GRBL: 0.2 m there and back; the position that the driver states is compared with the true one."""

    def __init__(self, folder: Path, timeout_s: float = 2.0) -> None:
        self._world = World()
        wire = start_grbl(self._world, length_m=1.0, feed_limit_m_s=2.0)
        options = GrblTrolley.Options(port=wire.url, length_m=1.0, feed_m_s=2.0, timeout_s=timeout_s)
        super().__init__("trolley: GRBL", wire, GrblTrolley(options), timeout_s)

    def round(self) -> None:
        """There and back."""
        for x_m in (0.2, 0.0):
            self.driver.start_move(x_m)
            for _ in within():
                fix = self.driver.poll()
                if not fix.moving:
                    break
            true_m = self._world.trolley_x_m.at()
            if abs(true_m - fix.x_m) > 4 * fix.sd_m:
                raise Untruthful(f"says x = {fix.x_m:.4f} m, is {true_m:.4f} m")


class _Hand:
    """A person who does what is asked, and confirms nothing."""

    def ask(self, prompt: str) -> int:
        """Nothing to show."""
        return 1

    def answered(self, ticket: int) -> bool:
        """Never: the encoder itself tells."""
        return False

    def withdraw(self, ticket: int) -> None:
        """Nothing to take back."""


class EncoderStand(_SerialStand):
    """Hand-pushed with an encoder: 0.1 m there and back; the stated position is compared with the true one."""

    def __init__(self, folder: Path, timeout_s: float = 1.0) -> None:
        world = World()
        self._track = world.trolley_x_m
        wire = start_encoder(world)
        options = EncoderTrolley.Options(
            port=wire.url, length_m=1.0, counts_per_m=10_000.0, start_x_m=0.0, rest_s=0.1, silence_s=timeout_s
        )
        super().__init__("trolley: encoder", wire, EncoderTrolley(options, _Hand()), timeout_s)

    def round(self) -> None:
        """There and back, at 0.5 m/s. A trolley that does not seem to arrive within a second is no error by itself."""
        for x_m in (0.1, 0.0):
            self.driver.start_move(x_m)
            now_ns = time.monotonic_ns()
            start_m = self._track.at(now_ns)
            self._track.move(start_m, x_m, now_ns, now_ns + round(abs(x_m - start_m) / 0.5 * 1e9) + 1)
            for _ in within(2.0):
                fix = self.driver.poll()
                if not fix.moving:
                    break
            true_m = self._track.at()
            if abs(true_m - fix.x_m) > max(4 * fix.sd_m, 0.005):
                raise Untruthful(f"says x = {fix.x_m:.4f} m, is {true_m:.4f} m")

    def reset(self) -> None:
        """The trolley is pushed to where it stands when the driver is opened."""
        self._track.hold(0.0)


class PolarizerStand(_SerialStand):
    """ELL14: 60 degrees there and back; the angle that the driver states is compared with the true one."""

    def __init__(self, folder: Path, timeout_s: float = 2.0) -> None:
        self._world = World()
        wire = start_rotator(self._world)
        options = Ell14.Options(port=wire.url, timeout_s=timeout_s, turn_timeout_s=max(timeout_s, 1.5))
        super().__init__("polarizer: ELL14", wire, Ell14(options), max(timeout_s, 1.5))

    def round(self) -> None:
        """There and back."""
        for angle_deg in (60.0, 0.0):
            self.driver.start_turn(math.radians(angle_deg))
            for _ in within():
                fix = self.driver.poll()
                if not fix.moving:
                    break
            true_rad = self._world.polarizer_rad.at()
            if abs(math.remainder(true_rad - fix.angle_rad, 2 * math.pi)) > 4 * fix.sd_rad:
                raise Untruthful(f"says {fix.angle_rad:.3f} rad, is {true_rad:.3f} rad")
