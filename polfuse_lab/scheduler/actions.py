"""How each step of a plan is carried out with the devices."""

from __future__ import annotations

from collections.abc import Callable

from drivers.records import AudioBlock, Channel, TrolleyFix
from polfuse_lab.plans import Plan
from polfuse_lab.plans.steps import (
    Ask,
    AutoExpose,
    Checkpoint,
    Expose,
    Mark,
    MoveTo,
    RecordPass,
    RecordSeconds,
    RecordSweeps,
    SelectChannel,
    Settle,
    StartTurn,
    Step,
    TurnPolarizer,
    TurnSource,
)
from polfuse_lab.records import Record
from polfuse_lab.rig import Rig
from polfuse_lab.scheduler.context import Context
from polfuse_lab.scheduler.control import Control
from polfuse_lab.scheduler.devices import DeviceSet
from polfuse_lab.scheduler.frames import Frames
from polfuse_lab.scheduler.motion import Motion
from polfuse_lab.scheduler.passes import Passes
from polfuse_lab.scheduler.prompts import Prompts
from polfuse_lab.scheduler.recording import Recording


class Actions:
    """Carries out one step at a time; every wait can be aborted. Records go to ``keep``."""

    def __init__(
        self,
        rig: Rig,
        plan: Plan,
        devices: DeviceSet,
        control: Control,
        prompts: Prompts,
        keep: Callable[[Record], None],
    ) -> None:
        self.positions_done = 0
        self._context = Context(rig, plan, devices, control, prompts, keep)
        self._motion = Motion(self._context)
        self._recording = Recording(self._context, self._motion)
        self._passes = Passes(self._context, self._motion, self._recording)
        self._frames = Frames(self._context, self._motion)
        self._channel: Channel | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know, oldest first."""
        return self._context.warnings

    def do(self, step: Step) -> None:
        """Carry out one step.

        Raises:
            Aborted: the run was told to stop.
            PassPaused: the run was paused in the middle of a pass, which must be repeated.
            DeviceError: a device failed.
            PolfuseError: something else did.
        """
        context = self._context
        match step:
            case MoveTo():
                self._motion.move(step)
            case SelectChannel(channel):
                self._channel = channel
                context.keep(context.devices.call("switches", context.devices.switches.select, channel))
            case Settle(seconds):
                context.control.sleep(seconds)
            case RecordSweeps():
                self._recording.sweeps(step)
            case RecordSeconds():
                self._recording.seconds(step)
            case RecordPass():
                self._passes.run(step)
            case StartTurn(angle_rad):
                self._motion.start_turn(angle_rad)
            case TurnPolarizer(angle_rad):
                self._motion.turn(angle_rad)
            case TurnSource(angle_rad):
                self._motion.turn_source(angle_rad)
            case AutoExpose():
                self._frames.auto_expose(step)
            case Expose():
                self._frames.expose(step)
            case Ask(prompt):
                self._ask(prompt)
            case Mark(text):
                context.event("mark", text)
            case Checkpoint(position):
                self.positions_done = max(self.positions_done, position + 1)
                context.repeating = False

    def repeat(self) -> None:
        """What follows, up to the next checkpoint, has been begun before: mark it."""
        self._context.repeating = True
        self._motion.forget_orders()

    def warn(self, text: str) -> None:
        """Tell the user, and keep it in the session."""
        self._context.warn(text)

    def probe(self) -> AudioBlock:
        """Listen to the radar before anything moves. Raises as :meth:`Recording.probe`."""
        return self._recording.probe()

    @property
    def last_fix(self) -> TrolleyFix | None:
        """The trolley's last fix."""
        return self._motion.fix

    def counts(self) -> dict[str, object]:
        """The present numbers, named as in :class:`~polfuse_lab.scheduler.status.RunStatus`."""
        fix = self._motion.fix
        return {
            "sweeps": self._recording.records,
            "frames": self._frames.frames,
            "samples_lost": self._recording.samples_lost,
            "frames_lost": self._frames.frames_lost,
            "position": self._context.position,
            "channel": self._channel.name if self._channel is not None else "",
            "x_m": fix.x_m if fix is not None else None,
        }

    def _ask(self, prompt: str) -> None:
        prompts, control = self._context.prompts, self._context.control
        ticket = prompts.ask(prompt)
        try:
            while not prompts.answered(ticket):
                control.slice()
        finally:
            prompts.withdraw(ticket)
