"""Every few seconds one pair of clock readings from each device that has a clock."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future

import numpy as np

from drivers.records import ClockFix
from polfuse_lab.clocks import sync_rms_s
from polfuse_lab.records import Record
from polfuse_lab.scheduler.devices import DeviceSet
from polfuse_lab.session.layout import TABLES

CLOCK_AFTER_S = (1.0, 2.0, 3.0, 5.0)
"""Time from one fix to the next; the last one stays. Closer at first, so that a short collect has enough for a fit."""


class ClockWatch:
    """Asks radar and camera for clock fixes and keeps them."""

    def __init__(self, devices: DeviceSet, keep: Callable[[Record], None]) -> None:
        self._devices = devices
        self._keep = keep
        self._taken: list[ClockFix] = []
        self._calls: dict[str, Future[ClockFix | None]] = {}
        self._due = 0.0
        self._rounds = 0
        self._readers: dict[str, Callable[[], ClockFix | None]] = {}
        if "radar" in devices:
            self._readers["radar"] = devices.radar.clock
        if "camera" in devices:
            self._readers["camera"] = devices.camera.clock

    def now(self) -> None:
        """Take one fix from each device and wait for it. Raises as :meth:`DeviceSet.call`."""
        for kind, reader in self._readers.items():
            self._take(self._devices.call(kind, reader))
        self._plan_next()

    def tick(self) -> None:
        """Called during waits: begin the fixes that are due and keep those that are done; does not wait.

        Raises:
            DeviceError: a device failed meanwhile.
        """
        for kind in list(self._calls):
            call = self._calls.get(kind)
            # None: keeping another fix has waited for room in the queue, and this one was kept in a tick of that wait.
            if call is not None and call.done():
                del self._calls[kind]
                self._take(self._devices.result(kind, call, "clock"))
        if time.monotonic() < self._due:
            return
        self._plan_next()
        for kind, reader in self._readers.items():
            if kind not in self._calls:
                self._calls[kind] = self._devices.by_kind[kind].lane.submit(reader)

    def forget(self) -> None:
        """Drop questions under way: a device that asked them has been opened again since."""
        self._calls.clear()

    def end(self) -> None:
        """All has been recorded: ask no more, and drop what is under way."""
        self._readers.clear()
        self._calls.clear()

    def sync_rms_s(self) -> float | None:
        """Sync uncertainty of what has been recorded, s; None where no device has a clock."""
        rows = np.zeros(len(self._taken), TABLES["clocks"])
        for row, fix in zip(rows, self._taken, strict=True):
            row["device"], row["t_device_s"] = fix.device.encode(), fix.t_device_s
            row["t_host_ns"], row["round_trip_ns"] = fix.t_host_ns, fix.round_trip_ns
        return sync_rms_s(rows)

    def _plan_next(self) -> None:
        self._due = time.monotonic() + CLOCK_AFTER_S[min(self._rounds, len(CLOCK_AFTER_S) - 1)]
        self._rounds += 1

    def _take(self, fix: ClockFix | None) -> None:
        if fix is not None:
            self._taken.append(fix)
            self._keep(fix)
