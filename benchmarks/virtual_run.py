"""A whole collect in virtual time, which stands still wherever others could act, and goes on when it is told to."""

from __future__ import annotations

import contextlib
import itertools
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

from benchmarks.virtual_devices import Truth, VirtualDevice, VirtualRadar, VirtualSwitches, VirtualTrolley
from benchmarks.virtual_optics import VirtualCamera, VirtualPolarizer
from benchmarks.virtual_recorder import VirtualRecorder
from benchmarks.virtual_time import VirtualClock, VirtualControl, VirtualLane, virtual_time
from polfuse_lab.plans import Plan, plan_to_toml
from polfuse_lab.plans.listing import planned
from polfuse_lab.plans.steps import Step
from polfuse_lab.rig import Rig, parse_model
from polfuse_lab.scheduler import Control, Outcome, RunState, Scheduler
from polfuse_lab.scheduler.devices import Device, DeviceSet
from polfuse_lab.scheduler.prompts import Prompts

REAL_S = 30.0
"""Longest real time between two stands, s; anything near it is a hang."""

RIG = """\
[waveform]
centre_hz = 2.4e9
bandwidth_hz = 80e6
ramp_up_s = 0.002
sweep_period_s = 0.004
[geometry]
antenna_height_m = 1.069
[radar]
driver = "virtual"
sample_rate_hz = 8000.0
options = { sample_format = "int32" }
[switches]
driver = "virtual"
settle_s = 0.0
[trolley]
driver = "virtual"
length_m = 3.2
speed_m_s = 0.5
[camera]
driver = "virtual"
width_px = 8
height_px = 6
exposure_s = 0.01
focal_length_m = 0.008
pixel_pitch_m = 8e-6
[polarizer]
driver = "virtual"
[source_polarizer]
driver = "virtual"
"""


class Hung(Exception):
    """The run came to no stand and no end."""


@dataclass(frozen=True)
class Change:
    """A change of the run's status, and when."""

    state: str
    reason: str
    step: int
    now_ns: int
    confirmed: int
    """Newest flush that was done by then."""


def rig() -> Rig:
    """The rig's description."""
    return parse_model(RIG, Rig, "virtual rig")


class VirtualRun:
    """One collect. Use it with ``with``; it ends the run (by aborting it) where that has not ended.

    Args:
        plan: what is collected.
        path: the session.
    """

    def __init__(self, plan: Plan, path: Path) -> None:
        self.clock = VirtualClock()
        self.plan = plan
        self.path = path
        self.rig = rig()
        self.steps: tuple[Step, ...] = tuple(plan.steps(mosaic=self.rig.has_mosaic))
        self.truth = Truth(self.clock, step=self.step_name)
        self.recorder = VirtualRecorder(path, self.clock)
        needed = planned(self.steps).devices
        every = (VirtualRadar(self.truth), VirtualSwitches(self.truth), VirtualTrolley(self.truth),
                 VirtualCamera(self.truth), VirtualPolarizer(self.truth),
                 VirtualPolarizer(self.truth, "source_polarizer"))  # fmt: skip
        self.devices: dict[str, VirtualDevice] = {device.kind: device for device in every if device.kind in needed}
        self.control = VirtualControl(self.clock, self._point)
        self.changes: list[Change] = []
        self.outcome: Outcome | None = None
        self.points = 0
        self.abort_real_s: float | None = None
        """Real time from the abort to the end."""
        self.ended_ns: int | None = None
        """Virtual time of the end."""
        self._enough: Callable[[], bool] = lambda: True
        self._go, self._stands = threading.Semaphore(0), threading.Semaphore(0)
        self._patches = contextlib.ExitStack()
        self._patches.enter_context(virtual_time(self.clock))
        self.scheduler = Scheduler(
            self.rig,
            plan,
            path,
            self.recorder,
            rig_toml=RIG,
            plan_toml=plan_to_toml(plan),
            on_change=self._changed,
            control=self.control,
            devices=self._make_devices,
        )
        self._thread = threading.Thread(target=self._work, name="virtual run", daemon=True)
        self._thread.start()

    def __enter__(self) -> VirtualRun:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the run and give the scheduler's modules their time back. Idempotent."""
        if self._thread.is_alive():
            self.control.abort("the test has ended")
            for device in self.devices.values():
                device.hang_s = 0.0
            with contextlib.suppress(Hung):
                self.go_on(lambda: False)
        self._patches.close()

    def step_name(self) -> str:
        """Name of the kind of step that is under way, or of the run's state where there is none."""
        status = self.scheduler.status()
        if status.state in (RunState.RUNNING, RunState.PAUSED) and status.step < len(self.steps):
            return type(self.steps[status.step]).__name__
        return str(status.state)

    @property
    def closing(self) -> bool:
        """Whether the session is being closed, or has been."""
        return self.scheduler.status().state in (RunState.STOPPING, RunState.FINISHED)

    @property
    def ended(self) -> bool:
        """Whether the run has ended."""
        return self.outcome is not None

    def go_on(self, enough: Callable[[], bool]) -> None:
        """Let the run go on until it stands where ``enough()`` is true, or has ended.

        Raises:
            Hung: it does neither in :data:`REAL_S`.
        """
        if not self._thread.is_alive():
            return
        self._enough = enough
        self._go.release()
        if not self._stands.acquire(timeout=REAL_S):
            raise Hung(f"no stand and no end in {REAL_S:g} s: {self.scheduler.status()}")

    def go_points(self, number: int) -> None:
        """Let it come to the ``number``-th place from here where others could act."""
        left = itertools.count(number - 1, -1)
        self.go_on(lambda: next(left) <= 0)

    def go_seconds(self, seconds: float) -> None:
        """Let so much virtual time pass."""
        until = self.clock.now_ns + round(seconds * 1e9)
        self.go_on(lambda: self.clock.now_ns >= until)

    def go_steps(self, number: int) -> None:
        """Let it come to the beginning of another step, so many times (or for a minute)."""
        until, seen = self.clock.now_ns + 60_000_000_000, len(self.changes)
        self.go_on(lambda: len(self.changes) >= seen + number or self.clock.now_ns >= until)

    def _work(self) -> None:
        self._go.acquire()
        self.outcome = self.scheduler.run()
        self.ended_ns = self.clock.now_ns
        self._stands.release()

    def _point(self, what: str) -> None:
        if threading.current_thread() is not self._thread:
            return
        self.points += 1
        if self._enough():
            self._stands.release()
            self._go.acquire()

    def _changed(self) -> None:
        status = self.scheduler.status()
        self.changes.append(
            Change(str(status.state), status.reason, status.step, self.clock.now_ns, self.recorder.confirmed)
        )
        self._point("change")

    def _make_devices(
        self, rig: Rig, path: Path, operator: Prompts, control: Control, kinds: Sequence[str]
    ) -> DeviceSet:
        made = DeviceSet(control)
        for kind in kinds:
            device = self.devices[kind]
            made.by_kind[kind] = Device(kind, "virtual", device, VirtualLane(kind, self.clock), by_hand=False)
        return made

    def answer_prompts(self) -> bool:
        """Confirm what the operator is asked; whether there was anything."""
        answers = [self.scheduler.prompts.answer(ticket) for ticket, _ in self.scheduler.prompts.open()]
        return any(answers)

    def abort(self) -> None:
        """Abort, as a user does."""
        self.control.abort()

    def finish(self, longest_s: float = 900.0) -> Outcome:
        """Answer every prompt and let it run to its end.

        Raises:
            Hung: it does not end in that much virtual time.
        """
        until = self.clock.now_ns + round(longest_s * 1e9)
        began = time.monotonic()
        while not self.ended:
            self.go_on(lambda: bool(self.scheduler.prompts.open()) or self.clock.now_ns >= until)
            self.answer_prompts()
            if self.clock.now_ns >= until and not self.ended:
                raise Hung(f"no end in {longest_s:g} s of virtual time: {self.scheduler.status()}")
        self.abort_real_s = time.monotonic() - began
        assert self.outcome is not None
        return self.outcome
