"""Recording without a gap while the trolley runs."""

from __future__ import annotations

import math

import numpy as np

from drivers.contracts import GaplessRadar
from drivers.errors import DeviceError, DeviceRefused
from drivers.records import AudioBlock, SwitchState, TrolleyFix
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans.steps import PASS_POSITIONS, MoveTo, RecordPass
from polfuse_lab.records import SUPERSEDED, SweepFlag
from polfuse_lab.scheduler.context import Context
from polfuse_lab.scheduler.control import Aborted
from polfuse_lab.scheduler.motion import MOVE_SLACK_S, Motion
from polfuse_lab.scheduler.recording import AUDIO_SLACK_S, MOVED_M, Recording, switch_flags
from polfuse_lab.scheduler.watch import Seen

STOP_S = 10.0
"""Longest that the trolley may take to stand after it was told to stop."""
UNKNOWN_M = 0.1
"""A trolley that does not know better where it is under way does not measure it."""


class PassPaused(Exception):
    """The user paused in the middle of a pass; the trolley stands."""


class Passes:
    """Carries out passes: the audio in consecutive records, the trolley's fixes all the time."""

    def __init__(self, context: Context, motion: Motion, recording: Recording) -> None:
        self._context = context
        self._motion = motion
        self._recording = recording

    def run(self, step: RecordPass) -> None:
        """One pass, begun anew as often as the plan allows when a part of it is bad.

        Raises:
            PassPaused: the user paused; the pass has to be repeated from its start.
            Aborted: the run was told to stop.
            DeviceError: a device failed, or no attempt was good.
            PolfuseError: the radar's driver cannot record without a gap.
        """
        context = self._context
        flags = SweepFlag.CONTINUOUS | self._recording.repeated(step.first_position, step.channel)
        for retry in range(context.plan.retries + 1):
            self._to_the_start(step)
            bad, lost = self._pass(step, flags)
            if not bad:
                return
            what = self._recording.complaint(bad, lost)
            if retry < context.plan.retries:
                context.warn(f"pass {context.position}, {step.channel.name}: {what}; taken again")
            if bad & SweepFlag.SWITCH_CHANGED:
                context.devices.call("switches", context.devices.switches.select, step.channel)
            flags |= SweepFlag.RETRY
        raise self._recording.given_up(
            bad, what, f"in each of {retry + 1} runs of pass {context.position}, {step.channel.name}"
        )

    def _to_the_start(self, step: RecordPass) -> None:
        """After a pause or a bad attempt the trolley stands elsewhere."""
        fix = self._motion.look()
        if abs(fix.x_m - step.x_from_m) > 3 * fix.sd_m + MOVED_M:
            self._motion.move(MoveTo(step.x_from_m, step.first_position))
        self._context.position = step.first_position // PASS_POSITIONS

    def _pass(self, step: RecordPass, flags: SweepFlag) -> tuple[SweepFlag, int]:
        """One attempt; returns what was bad about it, and the audio frames lost."""
        context, devices, recording = self._context, self._context.devices, self._recording
        radar = devices.radar
        if not isinstance(radar, GaplessRadar):
            raise PolfuseError(
                f"its driver '{devices.by_kind['radar'].driver}' cannot record without a gap",
                where="radar",
                advice="plan a rail with stops (kind = 'rail_sar'), or use another driver",
            )
        route = recording.switch_state(step.channel)
        way = f"from x = {step.x_from_m:+.4f} m to {step.x_to_m:+.4f} m in {step.channel.name}"
        context.event("pass", f"pass {context.position} begins {way}")
        frames = max(round(step.block_s * radar.sample_rate_hz), 1)
        recording.watch.begin()
        devices.call("radar", radar.begin_stream, frames)
        try:
            devices.call("trolley", devices.trolley.start_move, step.x_to_m, *_speed(step))
            bad, lost = self._blocks(step, flags, route, frames / radar.sample_rate_hz)
        finally:
            recording.cancel()
        if context.devices.by_kind["trolley"].by_hand:
            devices.call("trolley", devices.trolley.stop)  # passed the end: nobody need confirm any more
        self._motion.arrive(step.x_to_m, STOP_S + MOVE_SLACK_S)
        after = recording.switch_state()
        context.event("pass", f"pass {context.position} ends at x = {self._stands_m:+.4f} m")
        return bad | (switch_flags([route, after]) & SweepFlag.SWITCH_CHANGED), lost

    def _blocks(self, step: RecordPass, flags: SweepFlag, route: SwitchState, block_s: float) -> tuple[SweepFlag, int]:
        """Keep block after block until the trolley has arrived."""
        context, devices, recording = self._context, self._context.devices, self._recording
        # Without a speed of its own the trolley goes as it does between positions.
        speed_m_s = step.speed_m_s or context.rig.trolley.speed_m_s
        deadline = context.deadline("trolley", 3 * abs(step.x_to_m - step.x_from_m) / speed_m_s + MOVE_SLACK_S)
        fixes = [self._motion.fix] if self._motion.fix is not None else []
        bad, lost, number = SweepFlag.NONE, 0, 0
        expected = context.control.now() + block_s
        while True:
            if context.control.pausing:
                self._halt(step)
            block = devices.call("radar", devices.radar.poll)
            if block is None:
                context.in_time(expected + AUDIO_SLACK_S, "radar", "delivered no complete record")
                context.in_time(deadline, "trolley", f"did not reach x = {step.x_to_m:.3f} m")
                recording.watch.tick(expected - context.control.now())
                context.control.slice(0.005)
                continue
            expected = context.control.now() + block_s
            position = step.first_position + number
            number += 1
            block_flags = flags | recording.audio_flags(block)
            try:
                seen = recording.watch.complete(recording.records, recording.end_ns(block))
            except (DeviceError, Aborted):
                fix = _place(block, fixes)
                recording.keep(block, position, step.channel, fix, block_flags | SweepFlag.SWITCH_UNVERIFIED)
                raise
            fixes = [*fixes[-2:], *(fix for fix in seen if isinstance(fix, TrolleyFix))]
            block_flags |= switch_flags([route, *seen])
            recording.keep(block, position, step.channel, _place(block, fixes), block_flags)
            self._motion.fix = fixes[-1]
            self._refuse_unmeasured(fixes)
            bad |= block_flags & SUPERSEDED
            lost += block.lost_frames
            if _arrived(step, seen):
                return bad, lost

    def _halt(self, step: RecordPass) -> None:
        """Feed hold in the middle of a pass; raises :class:`PassPaused` once the trolley stands."""
        devices = self._context.devices
        self._recording.cancel()
        devices.call("trolley", devices.trolley.stop)
        self._motion.arrive(step.x_to_m, STOP_S)
        raise PassPaused

    def _refuse_unmeasured(self, fixes: list[TrolleyFix]) -> None:
        fix = fixes[-1]
        if fix.moving and fix.sd_m > UNKNOWN_M:
            driver = self._context.devices.by_kind["trolley"].driver
            raise DeviceRefused(
                "does not measure where it is while it moves",
                where=f"trolley ({driver})",
                advice="use a driver that does ('encoder' for one pushed by hand), or plan a rail with stops",
            )

    @property
    def _stands_m(self) -> float:
        return math.nan if self._motion.fix is None else self._motion.fix.x_m


def _speed(step: RecordPass) -> tuple[float, ...]:
    # Drivers made before speeds could be asked for have one argument only.
    return () if step.speed_m_s is None else (step.speed_m_s,)


def _arrived(step: RecordPass, seen: list[Seen]) -> bool:
    """Whether the trolley was seen standing, or beyond the end of its way."""
    onward = math.copysign(1.0, step.x_to_m - step.x_from_m)
    fixes = [fix for fix in seen if isinstance(fix, TrolleyFix)]
    return any(not fix.moving or (fix.x_m - step.x_to_m) * onward >= 0 for fix in fixes)


def _place(block: AudioBlock, fixes: list[TrolleyFix]) -> TrolleyFix:
    """Where the trolley was at the middle of a block, between the fixes around it."""
    middle_ns = block.t_host_ns + round(len(block.samples) / block.sample_rate_hz * 0.5e9)
    times_s = np.array([(fix.t_host_ns - middle_ns) * 1e-9 for fix in fixes])
    order = np.argsort(times_s, kind="stable")
    x_m = float(np.interp(0.0, times_s[order], np.array([fix.x_m for fix in fixes])[order]))
    nearest = fixes[int(np.argmin(np.abs(times_s)))]
    return TrolleyFix(x_m, nearest.sd_m, nearest.moving, middle_ns, nearest.state)
