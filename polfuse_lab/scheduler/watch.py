"""Looking at devices while something is recorded, so that nothing moves unseen.

A look is made in the device's own thread and never makes the record wait. When the record is whole, one more look after
its end completes the picture; only then is it known whether it may be used. What was seen is kept with the record.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from drivers.errors import DeviceError
from drivers.records import PolarizerFix, SwitchState, TrolleyFix
from polfuse_lab.records import Observed, SourceFix
from polfuse_lab.scheduler.context import Context

Seen = TrolleyFix | SwitchState | PolarizerFix | SourceFix

TROLLEY_LOOK_S = 0.08
"""From one look at the trolley to the next: more than ten a second, also under way."""
SWITCHES_LOOK_S = 0.25
POLARIZER_LOOK_S = 0.25
LOOK_TIMEOUT_S = 3.0
TO_THE_END_S = 1.0
"""A record that ends so soon is brought to its end although a device that is looked at was lost."""
LAST_LOOK_S = 1.0
"""Longest wait for a look that is later than the record's end; drivers keep fixes for some hundredths of a second."""


@runtime_checkable
class Recalling(Protocol):
    """A device that is played back: it knows what it was seen to do."""

    def recall(self, record: int) -> Sequence[Seen]:
        """Everything that was seen while a record was taken."""

    def lost_next(self) -> bool:
        """Whether it was lost before it was asked again."""


@dataclass(frozen=True)
class Look:
    """How a device is looked at."""

    ask: Callable[[], Seen]
    every_s: float


class Watch:
    """Looks at some devices during records, one record after another.

    Args:
        context: the run.
        looks: by the device's kind, how it is looked at.
    """

    def __init__(self, context: Context, looks: Mapping[str, Look]) -> None:
        self._context = context
        self._looks = looks
        self._recalling = {
            kind: device for kind in looks if isinstance(device := context.devices.by_kind[kind].device, Recalling)
        }
        self._calls: dict[str, Future[Seen]] = {}
        self._due: dict[str, float] = {}
        self._seen: list[Seen] = []
        self._failed: DeviceError | None = None

    def begin(self) -> None:
        """A record begins: forget what was seen before."""
        self._seen.clear()
        self._failed = None
        self._calls.clear()
        now = time.monotonic()
        self._due = {kind: now + look.every_s for kind, look in self._looks.items()}

    def tick(self, left_s: float) -> None:
        """Called while a record is taken: begin looks that are due and take in those that are done; does not wait.

        Args:
            left_s: about how long the record still takes, s. Just before its end nothing is begun, so that the look
                that completes the picture need not wait for one that comes too early.

        Raises:
            DeviceError: a device failed meanwhile, and the record would still take long.
        """
        now = time.monotonic()
        for kind, look in self._looks.items():
            if kind in self._recalling:
                continue
            call = self._calls.get(kind)
            if call is not None and call.done():
                del self._calls[kind]
                try:
                    self._take(kind, call)
                except DeviceError as error:
                    if left_s > TO_THE_END_S:
                        raise
                    self._failed = error
            elif self._failed is not None:
                continue
            elif call is None and now >= self._due.get(kind, math.inf) and left_s > look.every_s / 2:
                self._due[kind] = now + look.every_s
                self._calls[kind] = self._context.devices.by_kind[kind].lane.submit(look.ask)

    def complete(self, record: int, end_ns: int, *, asked: str = "") -> list[Seen]:
        """Look once more, keep what was seen as seen during ``record``, and return it; more may follow for the next.

        Args:
            record: number of the record.
            end_ns: host time of the record's end; the last look is not earlier.
            asked: a kind of device that a step asks after the record anyway, and that needs no last look.

        Raises:
            Aborted: the run was told to stop.
            DeviceError: a device failed; what had been seen is kept.
        """
        recalled = {kind: device.recall(record) for kind, device in self._recalling.items()}
        for states in recalled.values():
            self._seen += states
        try:
            if self._failed is not None:
                raise self._failed
            for kind in self._looks:
                if kind not in recalled:
                    self._take_pending(kind)
                    if kind != asked:
                        self._look_after(kind, end_ns)
                elif (
                    kind != asked
                    and self._recalling[kind].lost_next()
                    and not any(state.t_host_ns >= end_ns for state in recalled[kind])
                ):
                    # The last look is missing: the device was lost in it, and asked now it says so.
                    self._context.devices.call(kind, self._looks[kind].ask)
        except DeviceError:
            self._hand_over(record)
            raise
        return self._hand_over(record)

    def _hand_over(self, record: int) -> list[Seen]:
        seen, self._seen = self._seen, []
        for state in seen:
            self._context.keep(Observed(state, record))
        return seen

    def _take_pending(self, kind: str) -> None:
        call = self._calls.pop(kind, None)
        if call is not None:
            driver = self._context.devices.by_kind[kind].driver
            self._context.control.wait_for(call, LOOK_TIMEOUT_S, "look", f"{kind} ({driver})")
            self._take(kind, call)

    def _look_after(self, kind: str, end_ns: int) -> None:
        devices = self._context.devices
        give_up = time.monotonic() + LAST_LOOK_S
        while True:
            seen = devices.call(kind, self._looks[kind].ask)
            if seen.t_host_ns >= end_ns or time.monotonic() > give_up:
                self._seen.append(seen)
                return
            # Whether the frame or record is over already is a matter of its own clock: not a wait for its own sake.
            left_s = (end_ns - time.monotonic_ns()) * 1e-9
            self._context.control.slice(min(max(left_s, 0.0005), 0.005))

    def _take(self, kind: str, call: Future[Seen]) -> None:
        self._seen.append(self._context.devices.result(kind, call, "look"))


def radar_watch(context: Context) -> Watch:
    """A watch on the trolley and the switches, for records of the radar."""
    devices = context.devices
    return Watch(
        context,
        {
            "trolley": Look(devices.trolley.poll, TROLLEY_LOOK_S),
            "switches": Look(devices.switches.state, SWITCHES_LOOK_S),
        },
    )


def camera_watch(context: Context) -> Watch:
    """A watch on whatever polarizers there are, for frames of the camera."""
    devices = context.devices
    looks: dict[str, Look] = {}
    if "polarizer" in devices:
        looks["polarizer"] = Look(devices.polarizer.poll, POLARIZER_LOOK_S)
    if "source_polarizer" in devices:
        looks["source_polarizer"] = Look(lambda: SourceFix(devices.source_polarizer.poll()), POLARIZER_LOOK_S)
    return Watch(context, looks)
