"""What a run does when a device is lost: it pauses, says so, opens the device again, and makes sure where things are.

A device is lost when it is gone, silent or talks nonsense; one that *refuses* (an alarm, a limit) needs a person and
ends the run. What was recorded before is on the disk before the first attempt to open the device again.
"""

from __future__ import annotations

import contextlib
import math
import time
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future

from drivers.errors import DeviceBadAnswer, DeviceError, DeviceLost, DeviceTimeout
from drivers.records import Identity, TrolleyFix
from polfuse_lab.plans import Plan
from polfuse_lab.scheduler.control import Control
from polfuse_lab.scheduler.devices import Device, DeviceSet
from polfuse_lab.scheduler.prompts import Prompts

RECOVERABLE = (DeviceLost, DeviceTimeout, DeviceBadAnswer)
RETRY_S = 0.5
"""Pause between two attempts to open a device."""
STAND_S = 1.0
"""Longest wait for the trolley to be told to stand while another device is away."""
POSITION_SLACK_M = 0.001
"""Beyond three standard deviations: play of a trolley that nobody moved."""


class Recovery:
    """Brings lost devices back, within the limits of the plan (``reconnect_wait_s``, ``max_reconnects``).

    Args:
        devices: all devices of the run.
        plan: its limits.
        control: every wait can be aborted.
        prompts: asks the operator about a trolley whose position is in doubt.
        tell: called with each stage in words.
    """

    def __init__(
        self, devices: DeviceSet, plan: Plan, control: Control, prompts: Prompts, tell: Callable[[str], None]
    ) -> None:
        self._devices = devices
        self._plan = plan
        self._control = control
        self._prompts = prompts
        self._tell = tell
        self._losses: Counter[str] = Counter()

    def kind(self, error: DeviceError) -> str | None:
        """Kind of the device that ``error`` lost and that may be waited for; None when the run must end."""
        kind = self._devices.failed
        if kind is None or not isinstance(error, RECOVERABLE) or self._plan.reconnect_wait_s == 0:
            return None
        return kind

    def bring_back(self, kind: str, error: DeviceError, last: TrolleyFix | None) -> str:
        """Wait for a device, open it again and return what came back, in words.

        Args:
            kind: which device.
            error: how it was lost.
            last: the trolley's last fix, to compare with what it says afterwards.

        Raises:
            DeviceError: it did not come back in time, was lost too often, or came back as something else.
            Aborted: the run was told to stop.
        """
        device = self._devices.by_kind[kind]
        self._losses[kind] += 1
        if self._losses[kind] > self._plan.max_reconnects:
            raise _worse(error, f" (lost {self._losses[kind]} times)", "see why this happens so often")
        if kind != "trolley":
            self._stand_still()
        wait_s = self._plan.reconnect_wait_s
        self._tell(f"{error.where}: {error.what}; waiting up to {wait_s:g} s for the {kind} to come back")
        end = time.monotonic() + wait_s
        before = device.identity
        identity = self._reopen(device, error, end)
        if before is not None and identity.name != before.name:
            raise DeviceError(
                f"came back as {identity.name!r} where {before.name!r} was",
                where=f"{kind} ({device.driver})",
                advice="connect the device with which the collect began, then collect again",
            )
        if kind == "trolley":
            self._confirm_position(last, time.monotonic() + wait_s)
        return f"{kind}: {identity.name} is back"

    def _reopen(self, device: Device, error: DeviceError, end: float) -> Identity:
        """Open a device again and again until it answers or the time is over."""
        latest: DeviceError = error

        def reopen() -> None:
            device.device.close()
            device.open()

        while True:
            attempt = device.lane.submit(reopen)
            try:
                self._await(attempt, end)
                attempt.result()
                assert device.identity is not None
                return device.identity
            except RECOVERABLE as failure:
                latest = failure
            except (OSError, RuntimeError, ValueError) as failure:
                latest = DeviceLost(f"{type(failure).__name__}: {failure}", where=error.where, advice=error.advice)
            if time.monotonic() + RETRY_S > end:
                raise _worse(latest, f", and it did not come back within {self._plan.reconnect_wait_s:g} s")
            self._control.sleep(RETRY_S)

    def _await(self, attempt: Future[None], end: float) -> None:
        while not attempt.done():
            if time.monotonic() > end:
                attempt.cancel()
                raise DeviceTimeout("its driver does not come back", where="device", advice="check its cable and power")
            self._control.slice()

    def _stand_still(self) -> None:
        """Stop the trolley while another device is away; one that cannot be told fails when it is used."""
        device = self._devices.by_kind.get("trolley")
        if device is None or device.lane.busy:
            return
        stopping = device.lane.submit(self._devices.trolley.stop)
        end = time.monotonic() + STAND_S
        while not stopping.done() and time.monotonic() < end:
            self._control.slice()
        if stopping.done():
            with contextlib.suppress(DeviceError):
                stopping.result()

    def _confirm_position(self, last: TrolleyFix | None, end: float) -> None:
        """Believe a trolley that stands where it stood; of any other, ask the operator: controllers restart at 0.

        Raises:
            DeviceError: nobody confirmed.
        """
        fix = self._devices.call("trolley", self._devices.trolley.poll)
        if last is not None and not last.moving:
            slack_m = 3 * math.hypot(fix.sd_m, last.sd_m) + POSITION_SLACK_M
            if abs(fix.x_m - last.x_m) <= slack_m:
                return
        was = "" if last is None else f" (last seen at x = {last.x_m:+.3f} m)"
        self._tell(f"the trolley is back and says x = {fix.x_m:+.3f} m{was}; waiting for the operator to confirm")
        ticket = self._prompts.ask(
            f"The trolley is back and says that it stands at x = {fix.x_m:+.3f} m{was}."
            " Measure where it stands: confirm if that is right, else abort the collect."
        )
        try:
            while not self._prompts.answered(ticket):
                self._control.slice()
                if time.monotonic() > end:
                    raise DeviceError(
                        f"it came back at x = {fix.x_m:+.3f} m{was} and nobody confirmed that it stands there",
                        where=f"trolley ({self._devices.by_kind['trolley'].driver})",
                        advice="set its position right (home it), then collect again",
                    )
        finally:
            self._prompts.withdraw(ticket)


def _worse(error: DeviceError, what: str, advice: str | None = None) -> DeviceError:
    return type(error)(error.what + what, where=error.where, advice=advice or error.advice)
