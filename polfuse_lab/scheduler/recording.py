"""Audio records with the trolley at a stand: each is checked during its whole length, and taken again if it is bad."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable

from drivers.errors import DeviceError
from drivers.records import AudioBlock, Channel, SwitchState, TrolleyFix
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans.dry_run import record_frames
from polfuse_lab.plans.steps import RecordSeconds, RecordSweeps
from polfuse_lab.records import SUPERSEDED, SweepFlag, Sweeps
from polfuse_lab.scheduler.context import Context
from polfuse_lab.scheduler.control import Aborted
from polfuse_lab.scheduler.motion import Motion
from polfuse_lab.scheduler.watch import Seen, Watch, radar_watch

AUDIO_SLACK_S = 10.0
"""A record may take so much longer than its length before it is given up; drivers notice a stall much earlier."""
MOVED_M = 0.001
"""A trolley that was seen so far from where it stood has moved: 1/32 of a wavelength at 9.6 GHz, 1/125 at 2.4 GHz."""


class Recording:
    """Takes audio records and counts them."""

    def __init__(self, context: Context, motion: Motion) -> None:
        self._context = context
        self._motion = motion
        self._watch: Watch | None = None
        self._attempts: Counter[tuple[int, int]] = Counter()
        self.records = 0
        """Audio records kept: the next one has this number."""
        self.samples_lost = 0

    @property
    def watch(self) -> Watch:
        """Looks at trolley and switches during records."""
        if self._watch is None:
            self._watch = radar_watch(self._context)
        return self._watch

    def probe(self) -> AudioBlock:
        """Listen to the radar before anything moves: a short block, not kept.

        Raises:
            DeviceError: the radar does not deliver.
            PolfuseError: its samples are not of a kind that a session can hold.
        """
        block = self._listen(256, lambda left_s: None)
        dtype = block.samples.dtype.name
        if block.samples.ndim != 2 or dtype not in ("int16", "int32", "float32"):
            raise PolfuseError(
                f"delivers {block.samples.ndim}-dimensional {dtype} samples",
                where="radar",
                advice="choose int16, int32 or float32 in its options",
            )
        return block

    def sweeps(self, step: RecordSweeps) -> None:
        """Record some sweeps where the trolley stands. Raises as a step."""
        frames = record_frames(self._context.rig, step.sweeps, self._rate_hz)
        self._record(step.position, step.channel, frames, step.sweeps)

    def seconds(self, step: RecordSeconds) -> None:
        """Record for some time where the trolley stands. Raises as a step."""
        self._record(step.position, step.channel, max(round(step.seconds * self._rate_hz), 1), 0)

    @property
    def _rate_hz(self) -> float:
        return self._context.devices.radar.sample_rate_hz

    def _record(self, position: int, channel: Channel, frames: int, sweeps: int) -> None:
        context, devices = self._context, self._context.devices
        # A plan without MoveTo (sky) stays where the trolley stands.
        context.position = position
        fix = self._motion.look()
        flags = self.repeated(position, channel)
        for retry in range(context.plan.retries + 1):
            before = self.switch_state(channel)
            self.watch.begin()
            block = self._listen(frames, self.watch.tick)
            try:
                seen = self.watch.complete(self.records, self.end_ns(block), asked="switches")
                after = self.switch_state()
            except (DeviceError, Aborted):
                # What has been recorded is kept, but nobody can vouch for its route.
                flags |= self.audio_flags(block) | SweepFlag.SWITCH_UNVERIFIED
                self.keep(block, position, channel, fix, flags, sweeps)
                raise
            flags |= switch_flags([before, *seen, after]) | moved_flag(fix, seen) | self.audio_flags(block)
            self.keep(block, position, channel, fix, flags, sweeps)
            if not flags & SUPERSEDED:
                return
            what = self.complaint(flags, block.lost_frames)
            if retry < context.plan.retries:
                context.warn(f"position {position}, {channel.name}: {what}; taken again")
            if flags & SweepFlag.SWITCH_CHANGED:
                devices.call("switches", devices.switches.select, channel)
            if flags & SweepFlag.MOVED:
                self._motion.go_back()
                context.position = position
                fix = self._motion.look()
            last, flags = flags, (flags & SweepFlag.REPEATED) | SweepFlag.RETRY
        raise self.given_up(last, what, f"in each of {retry + 1} records at position {position}, {channel.name}")

    def repeated(self, position: int, channel: Channel) -> SweepFlag:
        """The mark of a record that was taken before the collect went back to a checkpoint."""
        again = self._context.repeating and self._attempts[position, int(channel)]
        return SweepFlag.REPEATED if again else SweepFlag.NONE

    def audio_flags(self, block: AudioBlock) -> SweepFlag:
        """What the audio device says of a block."""
        flags = SweepFlag.OVERFLOW if block.overflow else SweepFlag.NONE
        return flags | SweepFlag.LOST if block.lost_frames > self._context.plan.max_lost_frames else flags

    def keep(
        self, block: AudioBlock, position: int, channel: Channel, fix: TrolleyFix, flags: SweepFlag, sweeps: int = 0
    ) -> None:
        """Keep a record, as the next attempt at its position and channel."""
        key = (position, int(channel))
        attempt = self._attempts[key]
        # Counted first: a record that finds no room at once is kept all the same, whatever interrupts the wait.
        self._attempts[key] += 1
        self.records += 1
        self.samples_lost += block.lost_frames
        self._context.keep(Sweeps(block, channel, position, fix.x_m, fix.sd_m, sweeps, flags, attempt))

    def switch_state(self, channel: Channel | None = None) -> SwitchState:
        """Ask for the route and keep it; with ``channel``, refuse any other. Raises :class:`DeviceError`."""
        devices = self._context.devices
        state = devices.call("switches", devices.switches.state)
        if channel is not None and (state.transmit, state.receive) != (channel.transmit, channel.receive):
            raise DeviceError(
                f"route is {state.transmit}{state.receive} where {channel.name} was selected",
                where="switches",
                advice="check the switches' power and cables",
            )
        self._context.keep(state)
        return state

    def complaint(self, flags: SweepFlag, lost_frames: int) -> str:
        """Why a record must be taken again, in words."""
        if flags & SweepFlag.LOST:
            return f"{lost_frames} audio frames were lost"
        return f"the {'switches' if flags & SweepFlag.SWITCH_CHANGED else 'trolley'} moved during the record"

    def given_up(self, flags: SweepFlag, what: str, where: str) -> DeviceError:
        """The error when no attempt was good."""
        if flags & SweepFlag.LOST:
            kind, advice = "radar", "check the audio device and the load of the computer"
        elif flags & SweepFlag.SWITCH_CHANGED:
            kind, advice = "switches", "check the switches and their power"
        else:
            kind, advice = "trolley", "look what pushes or pulls the trolley, and whether its brake holds"
        return DeviceError(f"{what} {where}", where=kind, advice=advice)

    def end_ns(self, block: AudioBlock) -> int:
        """Host time of a block's end."""
        return block.t_host_ns + round(len(block.samples) / block.sample_rate_hz * 1e9)

    def _listen(self, frames: int, look: Callable[[float], None]) -> AudioBlock:
        """One record; ``look`` is called meanwhile with the time that it still takes, s."""
        context, devices = self._context, self._context.devices
        radar = devices.radar
        devices.call("radar", radar.begin, frames)
        expected = context.control.now() + frames / radar.sample_rate_hz
        try:
            while (block := devices.call("radar", radar.poll)) is None:
                context.in_time(expected + AUDIO_SLACK_S, "radar", "delivered no complete record")
                look(expected - context.control.now())
                context.control.slice(0.005)
        except BaseException:
            self.cancel()
            raise
        return block

    def cancel(self) -> None:
        """Let the radar forget what was asked of it, unless its driver is busy."""
        lane = self._context.devices.by_kind["radar"].lane
        if not lane.busy:
            lane.submit(self._context.devices.radar.cancel)


def switch_flags(seen: Iterable[Seen]) -> SweepFlag:
    """What the switches' states during a record say about it; other sights are left aside."""
    states = [state for state in seen if isinstance(state, SwitchState)]
    flags = SweepFlag.NONE
    if len({(state.transmit, state.receive) for state in states}) > 1:
        flags |= SweepFlag.SWITCH_CHANGED
    if not all(state.verified for state in states):
        flags |= SweepFlag.SWITCH_UNVERIFIED
    return flags


def moved_flag(stood: TrolleyFix, seen: Iterable[Seen]) -> SweepFlag:
    """Whether the trolley was seen further than :data:`MOVED_M` from where it stood, or under way."""
    fixes = [fix for fix in seen if isinstance(fix, TrolleyFix)]
    away = any(abs(fix.x_m - stood.x_m) > MOVED_M for fix in fixes)
    return SweepFlag.MOVED if away else SweepFlag.NONE
