"""Aborts, pauses, notes, losses and faults in any order, at any moment of any kind of plan: a Hypothesis state machine.

Each rule acts on a collect that stands still in virtual time (:mod:`benchmarks.virtual_run`), or lets it go on for a
while. In the end the run is let go to its end, and everything that must be so is looked at.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any, ClassVar

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule

from benchmarks.interleaving_plans import PLANS
from benchmarks.virtual_checks import Injected, violations
from benchmarks.virtual_devices import VirtualRadar, VirtualSwitches, VirtualTrolley
from benchmarks.virtual_optics import VirtualCamera, VirtualPolarizer
from benchmarks.virtual_run import VirtualRun
from drivers.records import Channel
from polfuse_lab.plans.files import parse_plan

MEMORY = "/dev/shm"
KINDS = ("radar", "switches", "trolley", "camera", "polarizer", "source_polarizer")
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
        """A plan of any kind."""
        self.plan = data.draw(st.sampled_from(sorted(self.plans)), label="plan")
        self.run = VirtualRun(parse_plan(self.plans[self.plan], self.plan), self.folder / "s.h5")

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
    @rule()
    def pause(self) -> None:
        """Pause."""
        self._did("pause")
        self.here.control.pause()

    @precondition(alive)
    @rule()
    def resume(self) -> None:
        """Resume."""
        self._did("resume")
        self.here.control.resume()

    @precondition(lambda self: self.alive() and self.injected.abort_ns is None)
    @rule(sure=st.integers(0, 3))
    def abort(self, sure: int) -> None:
        """Abort; not as often as the rest, since it ends all."""
        if sure:
            return
        self._did("abort")
        self.injected.abort_ns = self.here.clock.now_ns
        self.here.abort()
        self.here.finish()

    @precondition(lambda self: self.alive() and self.here.recorder.begun and not self.here.recorder.failure)
    @rule(number=st.integers(0, 999))
    def note(self, number: int) -> None:
        """Make a note."""
        if self.here.scheduler.status().state == "stopping":
            return
        self._did("note")
        self.injected.notes.append(f"note {number}")
        self.here.scheduler.note(f"note {number}")

    @precondition(alive)
    @rule()
    def answer(self) -> None:
        """Confirm what is asked."""
        if self.here.answer_prompts():
            self._did("answer")

    # -- devices ------------------------------------------------------------------------------------------------------

    @precondition(alive)
    @rule(kind=st.sampled_from(KINDS), for_ever=st.integers(0, 9).map(lambda n: n == 0))
    def unplug(self, kind: str, for_ever: bool) -> None:
        """Pull a cable."""
        device = self.here.devices.get(kind)
        if device is not None and device.plugged:
            self._did(f"unplug {kind}")
            device.plugged = False
            if for_ever:
                self.gone.add(kind)

    @precondition(alive)
    @rule(kind=st.sampled_from(KINDS))
    def plug_in(self, kind: str) -> None:
        """Put it back."""
        device = self.here.devices.get(kind)
        if device is not None and not device.plugged:
            self._did(f"plug in {kind}")
            device.plugged = True
            self.gone.discard(kind)

    @precondition(alive)
    @rule(kind=st.sampled_from(KINDS), seconds=st.sampled_from((0.2, 1.0, 2.5, 10.0)))
    def hang(self, kind: str, seconds: float) -> None:
        """Let a driver hang in its next call."""
        device = self.here.devices.get(kind)
        if device is not None:
            self._did(f"hang {kind}")
            device.hang_s = seconds

    def _device(self, kind: str) -> Any:
        return self.here.devices.get(kind)

    @precondition(alive)
    @rule(frames=st.integers(1, 100))
    def lose_audio(self, frames: int) -> None:
        """Lose audio in the next record."""
        radar: VirtualRadar = self._device("radar")
        self._did("lose audio")
        radar.lose = frames

    @precondition(alive)
    @rule()
    def overflow(self) -> None:
        """Raise the overflow flag in the next record."""
        radar: VirtualRadar = self._device("radar")
        self._did("overflow")
        radar.overflow = True

    @precondition(alive)
    @rule(channel=st.sampled_from(Channel), delay_s=st.sampled_from((0.0, 0.01, 0.05)))
    def jump(self, channel: Channel, delay_s: float) -> None:
        """Let the switches jump."""
        switches: VirtualSwitches = self._device("switches")
        self._did("switches jump")
        switches.jump(channel, delay_s)

    @precondition(alive)
    @rule(stuck=st.booleans())
    def stick(self, stuck: bool) -> None:
        """Let the switches stick, or come loose."""
        switches: VirtualSwitches = self._device("switches")
        self._did("switches stick")
        switches.stuck = stuck

    @precondition(alive)
    @rule(by_m=st.sampled_from((-0.05, 0.003, 0.02)))
    def bump(self, by_m: float) -> None:
        """Push the trolley."""
        trolley: VirtualTrolley = self._device("trolley")
        self._did("bump trolley")
        trolley.bump(by_m)

    @precondition(alive)
    @rule(kind=st.sampled_from(("polarizer", "source_polarizer")), by_deg=st.sampled_from((-20.0, 1.0, 5.0)))
    def twist(self, kind: str, by_deg: float) -> None:
        """Turn a polarizer by hand."""
        polarizer: VirtualPolarizer | None = self._device(kind)
        if polarizer is not None:
            self._did(f"twist {kind}")
            polarizer.twist(math.radians(by_deg))

    @precondition(alive)
    @rule()
    def incomplete(self) -> None:
        """Let the next frame be incomplete."""
        camera: VirtualCamera | None = self._device("camera")
        if camera is not None:
            self._did("incomplete frame")
            camera.incomplete = True

    # -- the disk -----------------------------------------------------------------------------------------------------

    @precondition(alive)
    @rule(seconds=st.sampled_from((0.001, 0.1, 2.0)))
    def slow_disk(self, seconds: float) -> None:
        """Let flushes take long."""
        self._did("slow disk")
        self.here.recorder.flush_s = seconds

    @precondition(alive)
    @rule(seconds=st.sampled_from((0.01, 0.2, 1.5)))
    def full_queue(self, seconds: float) -> None:
        """Let the writer's queue be full for a while."""
        self._did("full queue")
        self.here.recorder.full_until_ns = self.here.clock.now_ns + round(seconds * 1e9)

    @precondition(lambda self: self.alive() and self.here.recorder.begun)
    @rule(sure=st.integers(0, 9))
    def full_disk(self, sure: int) -> None:
        """Let the disk be full; seldom, since it ends all."""
        if sure or self.here.scheduler.status().state == "stopping":
            return
        self._did("full disk")
        self.injected.disk_failed = True
        self.here.recorder.fail()
