"""The two RF transfer switches themselves, whatever drives them; the world shows ``"?"`` while contacts travel.

Fault of their own: ``STUCK_SWITCH`` (``amount`` the switch's number, 0 for all; counts are switchings), contacts stop
half-way until it ends.
"""

from __future__ import annotations

import time

from hw_mocks.faults import FaultKind, FaultScript
from hw_mocks.wire import seconds_until
from hw_mocks.world import Steps, World


class _Switch:
    def __init__(self, route: Steps) -> None:
        self.route = route
        self.position = self.target = route.at()
        self.arrives_ns: int | None = None
        self.jammed = False


class TransferSwitches:
    """Switch 1 stands in the transmit path, switch 2 in the receive path. Used by one thread.

    Args:
        world: where the routes are written.
        actuation_s: time for which the contacts travel, s (real ones: 10 to 30 ms).
        faults: script of the unit that they belong to.
    """

    def __init__(self, world: World, actuation_s: float, faults: FaultScript) -> None:
        self._faults = faults
        self._actuation_s = actuation_s
        self._switchings = 0
        self._switches = {1: _Switch(world.transmit), 2: _Switch(world.receive)}

    def __contains__(self, number: int) -> bool:
        return number in self._switches

    @property
    def travelling(self) -> bool:
        """Whether any contacts are under way (or stuck half-way)."""
        return any(switch.arrives_ns is not None for switch in self._switches.values())

    def position(self, number: int) -> str:
        """``"H"``, ``"V"``, or ``"?"`` while the contacts travel."""
        return self._switches[number].position

    def go(self, number: int, polarization: str) -> None:
        """Send a switch's contacts to ``"H"`` or ``"V"``; nothing moves where they stand there already."""
        self._switchings += 1
        switch = self._switches[number]
        if polarization == switch.position:
            return
        switch.target, switch.position = polarization, "?"
        now_ns = time.monotonic_ns()
        switch.arrives_ns = now_ns + round(self._actuation_s * 1e9)
        switch.route.set("?", now_ns)

    def jam(self, number: int, jammed: bool) -> None:
        """Make a switch's contacts stop half-way, or let them arrive again."""
        self._switches[number].jammed = jammed

    def advance(self) -> None:
        """Let contacts arrive whose time has come."""
        now_ns = time.monotonic_ns()
        for number, switch in self._switches.items():
            if switch.arrives_ns is not None and now_ns >= switch.arrives_ns and not self._stuck(number):
                switch.position = switch.target
                switch.route.set(switch.target, switch.arrives_ns)
                switch.arrives_ns = None

    def due_s(self) -> float | None:
        """Seconds until contacts arrive, None while all stand or are stuck."""
        due = [s.arrives_ns for n, s in self._switches.items() if s.arrives_ns is not None and not self._stuck(n)]
        return seconds_until(min(due)) if due else None

    def _stuck(self, number: int) -> bool:
        fault = self._faults.active(FaultKind.STUCK_SWITCH, count=self._switchings)
        return self._switches[number].jammed or (fault is not None and fault.amount in (0, number))
