"""Aborts, pauses, notes, losses and faults in any order, at any moment of any kind of plan: a Hypothesis state machine.

Each rule acts on a collect that stands still in virtual time (:mod:`benchmarks.virtual_run`), or lets it go on for a
while. In the end the run is let go to its end, and everything that must be so is looked at.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, ClassVar

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from benchmarks.interleaving_plans import PLANS
from benchmarks.virtual_checks import Injected, violations
from benchmarks.virtual_run import VirtualRun
from drivers.records import Channel
from polfuse_lab.plans.files import parse_plan

MEMORY = "/dev/shm"
KINDS = ("radar", "switches", "trolley", "camera", "polarizer", "source_polarizer")
SELDOM = st.integers(0, 15).map(lambda number: number == 11)
"""True once in a while; small and extreme numbers are drawn more often than others."""
Fault = tuple[str, Sequence[Any], Callable[[Any, Any], None]]
FAULTS: dict[str, Fault] = {
    "lose audio": ("radar", (1, 50, 100), lambda radar, frames: setattr(radar, "lose", frames)),
    "overflow": ("radar", (True,), lambda radar, flag: setattr(radar, "overflow", flag)),
    "switches jump": (
        "switches",
        [(channel, delay_s) for channel in Channel for delay_s in (0.0, 0.01, 0.05)],
        lambda switches, how: switches.jump(*how),
    ),
    "switches stick": ("switches", (True, False), lambda switches, stuck: setattr(switches, "stuck", stuck)),
    "bump trolley": ("trolley", (-0.05, 0.003, 0.02), lambda trolley, by_m: trolley.bump(by_m)),
    "incomplete frame": ("camera", (True,), lambda camera, flag: setattr(camera, "incomplete", flag)),
    **{
        f"twist {kind}": (kind, (-20.0, 1.0, 5.0), lambda polarizer, by_deg: polarizer.twist(math.radians(by_deg)))
        for kind in ("polarizer", "source_polarizer")
    },
}
"""Faults by name: of which device, how much, and how it is done."""
seen: Counter[tuple[str, str, str]] = Counter()
"""How often each action was taken in each kind of step of each plan."""


class Violated(AssertionError):
    """Something that must be so is not."""


class Interleavings(RuleBasedStateMachine):
    """One collect, and whatever happens to it."""

    plans: ClassVar[dict[str, str]] = PLANS
    """Plans to choose from: TOML by name."""

    def __init__(self) -> None:
        super().__init__()
        self.run: VirtualRun | None = None
        self.injected = Injected()
        self.plan = ""
        self.gone: set[str] = set()
        """Kinds that are never plugged in again."""
        folder = MEMORY if Path(MEMORY).is_dir() else None
        self.folder = Path(tempfile.mkdtemp(prefix="polfuse-interleavings-", dir=folder))

    @initialize(data=st.data())
    def begin(self, data: st.DataObject) -> None:
        """A plan of any kind, at any moment."""
        self.plan = data.draw(st.sampled_from(sorted(self.plans)), label="plan")
        self.run = VirtualRun(parse_plan(self.plans[self.plan], self.plan), self.folder / "s.h5")
        self.run.go_points(data.draw(st.integers(1, 300), label="moment"))

    def teardown(self) -> None:
        """Let the run come to its end and look at everything."""
        try:
            if self.run is not None:
                self._end(self.run)
        finally:
            if self.run is not None:
                self.run.close()
            shutil.rmtree(self.folder, ignore_errors=True)

    def _end(self, run: VirtualRun) -> None:
        for kind, device in run.devices.items():
            device.plugged = kind not in self.gone
        run.control.resume()
        run.finish()
        found = violations(run, self.injected)
        if found:
            raise Violated(f"{self.plan}: " + "; ".join(found))

    @property
    def here(self) -> VirtualRun:
        """The run."""
        assert self.run is not None
        return self.run

    def alive(self) -> bool:
        """Whether the run has not ended."""
        return self.run is not None and not self.run.ended

    def _did(self, action: str) -> None:
        seen[self.plan, self.here.step_name(), action] += 1

    # -- going on -----------------------------------------------------------------------------------------------------

    @precondition(alive)
    @rule(points=st.integers(1, 40))
    def go_points(self, points: int) -> None:
        """A few calls and waits further on."""
        self.here.go_points(points)

    @precondition(alive)
    @rule(steps=st.integers(1, 8))
    def go_steps(self, steps: int) -> None:
        """A few steps further on."""
        self.here.go_steps(steps)

    @precondition(alive)
    @rule(seconds=st.sampled_from((0.03, 0.3, 3.0, 20.0)))
    def go_seconds(self, seconds: float) -> None:
        """Some time further on."""
        self.here.go_seconds(seconds)

    @precondition(lambda self: not self.alive())
    @rule()
    def over(self) -> None:
        """The run has ended: nothing more happens."""

    # -- the user -----------------------------------------------------------------------------------------------------

    @precondition(alive)
    @rule(action=st.sampled_from(("pause", "resume", "note", "answer")), number=st.integers(0, 999))
    def user(self, action: str, number: int) -> None:
        """Pause, resume, make a note, or confirm what is asked."""
        run = self.here
        if action == "note":
            # A run that has nothing to write to, or is closing it, takes no notes.
            if not run.recorder.begun or run.recorder.failure or run.closing:
                return
            self.injected.notes.append(f"note {number}")
        self._did(action)
        {
            "pause": run.control.pause,
            "resume": run.control.resume,
            "note": lambda: run.scheduler.note(f"note {number}"),
            "answer": run.answer_prompts,
        }[action]()

    @precondition(lambda self: self.alive() and self.injected.abort_ns is None)
    @rule(sure=SELDOM)
    def abort(self, sure: bool) -> None:
        """Abort; not as often as the rest, since it ends all."""
        if not sure:
            return
        self._did("abort")
        self.injected.abort_ns = self.here.clock.now_ns
        self.here.abort()
        self.here.finish()

    # -- devices ------------------------------------------------------------------------------------------------------

    @precondition(alive)
    @rule(kind=st.sampled_from(KINDS), for_ever=SELDOM)
    def unplug(self, kind: str, for_ever: bool) -> None:
        """Pull a cable."""
        device = self.here.devices.get(kind)
        if device is not None and device.plugged:
            self._did(f"unplug {kind}")
            device.plugged = False
            if for_ever:
                self.gone.add(kind)

    @precondition(lambda self: self.alive() and any(not device.plugged for device in self.here.devices.values()))
    @rule()
    def plug_in(self) -> None:
        """Put all cables back."""
        for kind, device in self.here.devices.items():
            if not device.plugged:
                self._did(f"plug in {kind}")
                device.plugged = True
        self.gone.clear()

    @precondition(alive)
    @rule(kind=st.sampled_from(KINDS), seconds=st.sampled_from((0.2, 1.0, 2.5, 10.0)))
    def hang(self, kind: str, seconds: float) -> None:
        """Let a driver hang in its next call."""
        device = self.here.devices.get(kind)
        if device is not None:
            self._did(f"hang {kind}")
            device.hang_s = seconds

    @precondition(alive)
    @rule(fault=st.sampled_from(sorted(FAULTS)), data=st.data())
    def fault(self, fault: str, data: st.DataObject) -> None:
        """Something that a device does, or that is done to it."""
        kind, amounts, act = FAULTS[fault]
        device = self.here.devices.get(kind)
        if device is not None:
            self._did(fault)
            act(device, data.draw(st.sampled_from(amounts)))

    # -- the disk -----------------------------------------------------------------------------------------------------

    @precondition(alive)
    @rule(action=st.sampled_from(("slow disk", "full queue")), seconds=st.sampled_from((0.001, 0.1, 2.0)))
    def disk(self, action: str, seconds: float) -> None:
        """Let flushes take long, or the writer's queue be full for a while."""
        self._did(action)
        if action == "slow disk":
            self.here.recorder.flush_s = seconds
        else:
            self.here.recorder.full_until_ns = self.here.clock.now_ns + round(seconds * 1e9)

    @precondition(lambda self: self.alive() and self.here.recorder.begun)
    @rule(sure=SELDOM)
    def full_disk(self, sure: bool) -> None:
        """Let the disk be full; seldom, since it ends all."""
        if not sure or self.here.closing:
            return
        self._did("full disk")
        self.injected.disk_failed = True
        self.here.recorder.fail()
