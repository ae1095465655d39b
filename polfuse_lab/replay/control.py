"""Steering a replay: waits go by the recording's clock, recorded losses come back, the operator's answers are given."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from typing import Any

from polfuse_lab.replay.clock import ReplayClock
from polfuse_lab.replay.tape import Tape
from polfuse_lab.scheduler.control import SLICE_S, Control
from polfuse_lab.scheduler.devices import DeviceSet


class ReplayControl(Control):
    """A run's control that goes by a replay's clock.

    Args:
        tape: what is replayed.
        clock: its time.
        answer_prompts: confirms whatever the scheduler asks the operator; what came of it is in the recording.
    """

    def __init__(self, tape: Tape, clock: ReplayClock, answer_prompts: Callable[[], None]) -> None:
        super().__init__()
        self.devices: DeviceSet | None = None
        """The run's devices, known once they are made."""
        self._tape = tape
        self._clock = clock
        self._answer_prompts = answer_prompts

    def now(self) -> float:
        """Seconds of the recording."""
        return self._clock.now_ns() * 1e-9

    def slice(self, seconds: float = SLICE_S) -> None:
        """Wait for one slice. Raises as :meth:`Control.slice`."""
        self._answer_prompts()
        if self._tape.pause_due:
            self._tape.take_incident()
            self.pause()
        super().slice(seconds)

    def sleep(self, seconds: float) -> None:
        """Wait, unless the replay is as fast as possible. Raises as :meth:`Control.slice`."""
        end = self.now() + seconds
        self.check()
        while self._clock.waits and (left := end - self.now()) > 0:
            self.slice(left)

    def wait_for(self, future: Future[Any], timeout_s: float, what: str, where: str) -> None:
        """As :meth:`Control.wait_for`; raises the error of a recorded loss that the call has run into."""
        super().wait_for(future, timeout_s, what, where)
        self.lose()

    def lose(self) -> None:
        """Let the loss that is due happen, if there is one. Raises its :class:`DeviceError`."""
        loss = self._tape.due
        if loss is not None:
            self._tape.take_incident()
            assert self.devices is not None
            self.devices.failed = loss.kind
            raise loss.error
