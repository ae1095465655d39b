"""Moving the trolley and turning polarizers, and waiting until they stand."""

from __future__ import annotations

import math

from drivers.contracts import Polarizer
from drivers.records import PolarizerFix, TrolleyFix
from polfuse_lab.plans.steps import MoveTo
from polfuse_lab.records import SourceFix
from polfuse_lab.scheduler.context import Context

MOVE_SLACK_S = 20.0
TURN_S = 30.0


class Motion:
    """Where trolley and polarizers are, and how they get elsewhere; every wait can be aborted."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.fix: TrolleyFix | None = None
        """The trolley's last fix."""
        self.angle: PolarizerFix | None = None
        """Where the polarizer was turned to."""
        self.source_angle: PolarizerFix | None = None
        """Where the polarizer of the light source was turned to."""
        self._target: MoveTo | None = None
        self._turning_rad: float | None = None
        self._unfinished: set[str] = set()
        """Polarizers with a turn whose end has not been seen."""

    def forget_orders(self) -> None:
        """Devices may have been stopped or opened again since: nothing is under way any more."""
        self._turning_rad = None

    def move(self, step: MoveTo) -> None:
        """Move the trolley and wait until it stands. Raises as a step."""
        devices = self._context.devices
        before = devices.call("trolley", devices.trolley.poll)
        self._target = step
        devices.call("trolley", devices.trolley.start_move, step.x_m)
        expected = abs(step.x_m - before.x_m) / self._context.rig.trolley.speed_m_s
        self.arrive(step.x_m, 3 * expected + MOVE_SLACK_S)
        self._context.position = step.position

    def arrive(self, x_m: float, seconds: float) -> TrolleyFix:
        """Wait until the trolley stands, keep where, and return it.

        Args:
            x_m: where it was sent, for the message.
            seconds: longest that it may take, s.

        Raises:
            DeviceTimeout: it does not come to a stand in time.
        """
        context, devices = self._context, self._context.devices
        deadline = context.deadline("trolley", seconds)
        while True:
            self.fix = devices.call("trolley", devices.trolley.poll)
            if not self.fix.moving:
                break
            context.in_time(deadline, "trolley", f"did not reach x = {x_m:.3f} m (it is at {self.fix.x_m:.3f} m)")
            context.control.slice()
        context.keep(self.fix)
        return self.fix

    def look(self) -> TrolleyFix:
        """Ask the trolley where it is, and keep that."""
        devices = self._context.devices
        self.fix = devices.call("trolley", devices.trolley.poll)
        self._context.keep(self.fix)
        return self.fix

    def go_back(self) -> None:
        """Move the trolley to where the last :class:`MoveTo` had sent it; without one it stays."""
        if self._target is not None:
            self.move(self._target)

    def start_turn(self, angle_rad: float) -> None:
        """Begin to turn the polarizer."""
        self._order("polarizer", self._context.devices.polarizer, angle_rad)
        self._turning_rad = angle_rad

    def turn(self, angle_rad: float) -> None:
        """Turn the polarizer (unless it turns there already) and wait until it stands."""
        if self._turning_rad != angle_rad:
            self.start_turn(angle_rad)
        self._turning_rad = None
        self.angle = self._stand("polarizer", self._context.devices.polarizer, angle_rad)
        self._context.keep(self.angle)

    def turn_source(self, angle_rad: float) -> None:
        """Turn the polarizer of the light source and wait until it stands."""
        polarizer = self._context.devices.source_polarizer
        self._order("source_polarizer", polarizer, angle_rad)
        self.source_angle = self._stand("source_polarizer", polarizer, angle_rad)
        self._context.keep(SourceFix(self.source_angle))

    def _order(self, kind: str, polarizer: Polarizer, angle_rad: float) -> None:
        """Begin a turn. One that another device's loss interrupted is still under way, and no mount takes two."""
        if kind in self._unfinished:
            fix = self._stand(kind, polarizer, angle_rad)
            self._context.keep(fix if kind == "polarizer" else SourceFix(fix))
        self._context.devices.call(kind, polarizer.start_turn, angle_rad)
        self._unfinished.add(kind)

    def _stand(self, kind: str, polarizer: Polarizer, angle_rad: float) -> PolarizerFix:
        context = self._context
        deadline = context.deadline(kind, TURN_S)
        while True:
            fix = context.devices.call(kind, polarizer.poll)
            if not fix.moving:
                self._unfinished.discard(kind)
                return fix
            context.in_time(deadline, kind, f"did not reach {math.degrees(angle_rad):.1f} deg")
            context.control.slice()
