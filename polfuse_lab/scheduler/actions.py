"""How each step of a plan is carried out with the devices."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Callable
from typing import cast

from drivers.contracts import ExposureControl
from drivers.errors import DeviceError, DeviceTimeout
from drivers.records import AudioBlock, Channel, Frame, PolarizerFix, SwitchState, TrolleyFix
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import Plan
from polfuse_lab.plans.dry_run import record_frames
from polfuse_lab.plans.steps import (
    Ask,
    AutoExpose,
    Checkpoint,
    Expose,
    Mark,
    MoveTo,
    RecordSweeps,
    SelectChannel,
    Settle,
    Step,
    TurnPolarizer,
)
from polfuse_lab.records import Event, Exposure, Record, SweepFlag, Sweeps
from polfuse_lab.rig import Rig
from polfuse_lab.scheduler.control import Control
from polfuse_lab.scheduler.devices import DeviceSet
from polfuse_lab.scheduler.prompts import Prompts

AUDIO_SLACK_S = 10.0
"""A record may take so much longer than its length before it is given up; drivers notice a stall much earlier."""
MOVE_SLACK_S = 20.0
TURN_S = 30.0
FRAME_SLACK_S = 10.0


def describe(step: Step) -> str:
    """A step in words."""
    match step:
        case MoveTo(x_m):
            return f"moving to x = {x_m:.3f} m"
        case SelectChannel(channel):
            return f"switching to {channel.name}"
        case Settle(seconds):
            return f"settling {seconds:g} s"
        case RecordSweeps(sweeps, _, channel):
            return f"recording {sweeps} sweeps in {channel.name}"
        case TurnPolarizer(angle_rad):
            return f"turning the polarizer to {math.degrees(angle_rad):.1f} deg"
        case AutoExpose():
            return "finding the exposure"
        case Expose(frames):
            return f"taking {frames} frames"
        case Checkpoint():
            return "saving"
        case Ask(prompt):
            return f"asking: {prompt}"
        case Mark(text):
            return text


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
        self.warnings: tuple[str, ...] = ()
        self.positions_done = 0
        self._rig = rig
        self._plan = plan
        self._devices = devices
        self._control = control
        self._prompts = prompts
        self._keep = keep
        self._fix: TrolleyFix | None = None
        self._angle: PolarizerFix | None = None
        self._channel: Channel | None = None
        self._exposure_s = rig.camera.exposure_s if rig.camera is not None else 0.0
        self._exposure_found = False
        self._position = -1
        self._attempts: Counter[tuple[int, int]] = Counter()
        self._exposures: Counter[float] = Counter()
        self._repeating = False
        self._sweeps = self._frames = self._samples_lost = self._frames_lost = 0

    def do(self, step: Step) -> None:
        """Carry out one step. Raises :class:`Aborted`, :class:`DeviceError` or :class:`PolfuseError`."""
        match step:
            case MoveTo():
                self._move(step)
            case SelectChannel(channel):
                self._channel = channel
                self._keep(self._devices.call("switches", self._devices.switches.select, channel))
            case Settle(seconds):
                self._control.sleep(seconds)
            case RecordSweeps():
                self._record(step)
            case TurnPolarizer(angle_rad):
                self._turn(angle_rad)
            case AutoExpose():
                self._auto_expose(step)
            case Expose():
                self._expose(step)
            case Ask(prompt):
                self._ask(prompt)
            case Mark(text):
                self._keep(Event("mark", text, time.monotonic_ns()))
            case Checkpoint(position):
                self.positions_done = max(self.positions_done, position + 1)
                self._repeating = False

    def repeat(self) -> None:
        """What follows, up to the next checkpoint, has been begun before: mark it."""
        self._repeating = True

    def probe(self) -> AudioBlock:
        """Listen to the radar before anything moves: a short block, not kept.

        Raises:
            DeviceError: the radar does not deliver.
            PolfuseError: its samples are not of a kind that a session can hold.
        """
        block = self._listen(256)
        dtype = block.samples.dtype.name
        if block.samples.ndim != 2 or dtype not in ("int16", "int32", "float32"):
            raise PolfuseError(
                f"delivers {block.samples.ndim}-dimensional {dtype} samples",
                where="radar",
                advice="choose int16, int32 or float32 in its options",
            )
        return block

    def record_frames(self, sweeps: int) -> int:
        """Audio frames of a record of ``sweeps`` sweeps."""
        return record_frames(self._rig, sweeps, self._devices.radar.sample_rate_hz)

    @property
    def last_fix(self) -> TrolleyFix | None:
        """The trolley's last fix."""
        return self._fix

    def counts(self) -> dict[str, object]:
        """The present numbers, named as in :class:`~polfuse_lab.scheduler.status.RunStatus`."""
        return {
            "sweeps": self._sweeps,
            "frames": self._frames,
            "samples_lost": self._samples_lost,
            "frames_lost": self._frames_lost,
            "position": self._position,
            "channel": self._channel.name if self._channel is not None else "",
            "x_m": self._fix.x_m if self._fix is not None else None,
        }

    def _move(self, step: MoveTo) -> None:
        trolley = self._devices.trolley
        before = self._devices.call("trolley", trolley.poll)
        self._devices.call("trolley", trolley.start_move, step.x_m)
        expected = abs(step.x_m - before.x_m) / self._rig.trolley.speed_m_s
        deadline = self._deadline("trolley", 3 * expected + MOVE_SLACK_S)
        while True:
            fix = self._devices.call("trolley", trolley.poll)
            self._fix = fix
            if not fix.moving:
                break
            self._in_time(deadline, "trolley", f"did not reach x = {step.x_m:.3f} m (it is at {fix.x_m:.3f} m)")
            self._control.slice()
        self._position = step.position
        self._keep(fix)

    def _turn(self, angle_rad: float) -> None:
        polarizer = self._devices.polarizer
        self._devices.call("polarizer", polarizer.start_turn, angle_rad)
        deadline = self._deadline("polarizer", TURN_S)
        while True:
            fix = self._devices.call("polarizer", polarizer.poll)
            if not fix.moving:
                break
            self._in_time(deadline, "polarizer", f"did not reach {math.degrees(angle_rad):.1f} deg")
            self._control.slice()
        self._angle = fix
        self._keep(fix)

    def _record(self, step: RecordSweeps) -> None:
        key = (step.position, int(step.channel))
        # A plan without MoveTo (sky) stays where the trolley stands.
        self._position = step.position
        fix = self._devices.call("trolley", self._devices.trolley.poll)
        self._fix = fix
        self._keep(fix)
        frames = self.record_frames(step.sweeps)
        flags = SweepFlag.REPEATED if self._repeating and self._attempts[key] else SweepFlag.NONE
        for retry in range(self._plan.retries + 1):
            before = self._switch_state(step.channel)
            block = self._listen(frames)
            try:
                after = self._switch_state()
            except DeviceError:
                # What has been recorded is kept, but nobody can vouch for its route.
                self._keep_sweeps(step, block, fix, flags | SweepFlag.SWITCH_UNVERIFIED)
                raise
            flags |= _switch_flags(before, after)
            if block.overflow:
                flags |= SweepFlag.OVERFLOW
            lost = block.lost_frames > self._plan.max_lost_frames
            moved = bool(flags & SweepFlag.SWITCH_CHANGED)
            if lost:
                flags |= SweepFlag.LOST
            self._keep_sweeps(step, block, fix, flags)
            if not lost and not moved:
                return
            what = f"{block.lost_frames} audio frames were lost" if lost else "the switches moved during the record"
            if retry < self._plan.retries:
                self.warn(f"position {step.position}, {step.channel.name}: {what}; taken again")
            if moved:
                self._devices.call("switches", self._devices.switches.select, step.channel)
            flags = (flags & SweepFlag.REPEATED) | SweepFlag.RETRY
        raise DeviceError(
            f"{what} in each of {self._plan.retries + 1} records at position {step.position}, {step.channel.name}",
            where="radar" if lost else "switches",
            advice="check the audio device and the load of the computer"
            if lost
            else "check the switches and their power",
        )

    def _keep_sweeps(self, step: RecordSweeps, block: AudioBlock, fix: TrolleyFix, flags: SweepFlag) -> None:
        key = (step.position, int(step.channel))
        attempt = self._attempts[key]
        self._keep(Sweeps(block, step.channel, step.position, fix.x_m, fix.sd_m, step.sweeps, flags, attempt))
        self._attempts[key] += 1
        self._sweeps += 1
        self._samples_lost += block.lost_frames

    def _listen(self, frames: int) -> AudioBlock:
        radar = self._devices.radar
        self._devices.call("radar", radar.begin, frames)
        deadline = self._control.now() + frames / radar.sample_rate_hz + AUDIO_SLACK_S
        try:
            while (block := self._devices.call("radar", radar.poll)) is None:
                self._in_time(deadline, "radar", "delivered no complete record")
                self._control.slice(0.005)
        except BaseException:
            if not self._devices.by_kind["radar"].lane.busy:
                self._devices.by_kind["radar"].lane.submit(radar.cancel)
            raise
        return block

    def _switch_state(self, channel: Channel | None = None) -> SwitchState:
        """Ask for the route and record it; with ``channel``, refuse any other."""
        state = self._devices.call("switches", self._devices.switches.state)
        if channel is not None and (state.transmit, state.receive) != (channel.transmit, channel.receive):
            raise DeviceError(
                f"route is {state.transmit}{state.receive} where {channel.name} was selected",
                where="switches",
                advice="check the switches' power and cables",
            )
        self._keep(state)
        return state

    def _expose(self, step: Expose) -> None:
        camera = self._devices.camera
        angle = self._angle
        key = round(step.angle_rad, 6)
        attempt = self._exposures[key]
        exposure_s = self._exposure_s
        for _ in range(step.frames):
            for retry in range(self._plan.retries + 1):
                self._devices.call("camera", camera.trigger)
                frame = self._await_frame(exposure_s)
                self._frames_lost += frame.lost_before + int(frame.incomplete)
                self._keep(
                    Exposure(
                        frame,
                        angle.angle_rad if angle is not None else step.angle_rad,
                        angle.sd_rad if angle is not None else 0.0,
                        step.dark,
                        attempt,
                    )
                )
                self._frames += 1
                if not frame.incomplete:
                    break
                if retry == self._plan.retries:
                    raise DeviceError(
                        f"each of {retry + 1} frames was incomplete",
                        where="camera",
                        advice="check its network (jumbo frames, packet delay) and its cable",
                    )
                self.warn(f"an incomplete camera frame at {math.degrees(step.angle_rad):.1f} deg was taken again")
        self._exposures[key] += 1

    def _auto_expose(self, step: AutoExpose) -> None:
        """Find the exposure with frames that are not kept. One that suits badly is only a warning."""
        from drivers.camera.auto_exposure import ExposureGoal, Seen, search

        section = self._rig.camera
        assert section is not None
        control = cast(ExposureControl, self._devices.camera)
        if self._exposure_found:
            # A series that is repeated goes on with the exposure of its first frames.
            self._exposure_s = self._devices.call("camera", control.set_exposure, self._exposure_s)
            return
        goal = ExposureGoal(
            self._devices.call("camera", control.exposure_limits), section.saturation_counts, section.black_level_counts
        )
        asking = search(goal, self._exposure_s, max(len(step.angles_rad), 1))
        at: int | None = None
        seen: Seen | None = None
        while True:
            try:
                look = next(asking) if seen is None else asking.send(seen)
            except StopIteration as end:
                found = end.value
                break
            if step.angles_rad and look.angle != at:
                self._turn(step.angles_rad[look.angle])
                at = look.angle
            self._exposure_s = self._devices.call("camera", control.set_exposure, look.exposure_s)
            self._devices.call("camera", self._devices.camera.trigger)
            image = self._await_frame(self._exposure_s).image
            seen = Seen(self._exposure_s, goal.level(image))
            self._keep(exposure_look(goal.limits_s, self._exposure_s, int(image.max())))
        # The camera stands at the last exposure looked at, which is the one found.
        self._exposure_found = True
        if found.problem:
            self.warn(f"automatic exposure: {found.problem}")
        text = f"exposure {found.exposure_s:g} s after {found.looks} frames"
        self._keep(Event("exposure", text, time.monotonic_ns()))

    def _await_frame(self, exposure_s: float) -> Frame:
        deadline = self._control.now() + exposure_s + FRAME_SLACK_S
        while (frame := self._devices.call("camera", self._devices.camera.poll)) is None:
            self._in_time(deadline, "camera", "delivered no frame")
            self._control.slice(0.005)
        return frame

    def _ask(self, prompt: str) -> None:
        ticket = self._prompts.ask(prompt)
        try:
            while not self._prompts.answered(ticket):
                self._control.slice()
        finally:
            self._prompts.withdraw(ticket)

    def _deadline(self, kind: str, seconds: float) -> float:
        return math.inf if self._devices.by_kind[kind].by_hand else self._control.now() + seconds

    def _in_time(self, deadline: float, kind: str, what: str) -> None:
        if self._control.now() > deadline:
            driver = self._devices.by_kind[kind].driver
            self._devices.failed = kind
            raise DeviceTimeout(what, where=f"{kind} ({driver})", advice="check the device, its power and its cable")

    def warn(self, text: str) -> None:
        """Tell the user, and keep it in the session."""
        self.warnings = (*self.warnings, text)[-20:]
        self._keep(Event("warning", text, time.monotonic_ns()))


def exposure_look(limits_s: tuple[float, float], exposure_s: float, peak: int) -> Event:
    """What a look of the search for an exposure showed, to the last bit: the search can be gone through again by it."""
    low, high = limits_s
    text = f"exposure {float(exposure_s)!r} s of {float(low)!r} to {float(high)!r} s, brightest pixel {peak} counts"
    return Event("look", text, time.monotonic_ns())


def _switch_flags(before: SwitchState, after: SwitchState) -> SweepFlag:
    flags = SweepFlag.NONE
    if (before.transmit, before.receive) != (after.transmit, after.receive):
        flags |= SweepFlag.SWITCH_CHANGED
    if not (before.verified and after.verified):
        flags |= SweepFlag.SWITCH_UNVERIFIED
    return flags
