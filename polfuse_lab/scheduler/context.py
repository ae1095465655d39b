"""What every action of a run needs: the rig, the plan's limits, the devices, and where records and warnings go."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from drivers.errors import DeviceTimeout
from polfuse_lab.plans import Plan
from polfuse_lab.records import Event, Record
from polfuse_lab.rig import Rig
from polfuse_lab.scheduler.control import Control
from polfuse_lab.scheduler.devices import DeviceSet
from polfuse_lab.scheduler.prompts import Prompts


class Context:
    """Shared by all actions of one run. Records go to ``keep``."""

    def __init__(
        self,
        rig: Rig,
        plan: Plan,
        devices: DeviceSet,
        control: Control,
        prompts: Prompts,
        keep: Callable[[Record], None],
    ) -> None:
        self.rig = rig
        self.plan = plan
        self.devices = devices
        self.control = control
        self.prompts = prompts
        self.keep = keep
        self.warnings: tuple[str, ...] = ()
        self.position = -1
        """Position (in a pass: its number) at which records are taken."""
        self.repeating = False
        """Whether what is done now has been begun before, up to the next checkpoint."""

    def warn(self, text: str) -> None:
        """Tell the user something that does not end the run."""
        self.warnings = (*self.warnings, text)[-20:]
        self.event("warning", text)

    def event(self, kind: str, text: str) -> None:
        """Keep an event of this moment."""
        self.keep(Event(kind, text, time.monotonic_ns()))

    def deadline(self, kind: str, seconds: float) -> float:
        """Until when a device must have done something; a person is given all the time."""
        return math.inf if self.devices.by_kind[kind].by_hand else self.control.now() + seconds

    def in_time(self, deadline: float, kind: str, what: str) -> None:
        """Raise :class:`DeviceTimeout` when a deadline is over; the device counts as lost then."""
        if self.control.now() > deadline:
            driver = self.devices.by_kind[kind].driver
            self.devices.failed = kind
            raise DeviceTimeout(what, where=f"{kind} ({driver})", advice="check the device, its power and its cable")
