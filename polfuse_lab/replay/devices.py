"""Playback devices: the five contracts, answered from a tape when the replay's clock gets there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivers import contracts
from drivers.records import (
    AudioBlock,
    Channel,
    ClockFix,
    Frame,
    Identity,
    Level,
    PolarizerFix,
    SwitchState,
    TrolleyFix,
)
from polfuse_lab.replay.clock import ReplayClock
from polfuse_lab.replay.records import audio_block, frame, polarizer_fix, source_fix, switch_state, trolley_fix
from polfuse_lab.replay.tape import Diverged, Tape
from polfuse_lab.rig import Rig
from polfuse_lab.scheduler.control import Control
from polfuse_lab.scheduler.devices import Device, DeviceSet, in_order
from polfuse_lab.scheduler.lane import Lane
from polfuse_lab.scheduler.watch import Seen

LEAD_NS = 2_000_000_000
"""Where nothing went on in the recording (a pause, a person at work) the clock skips to so long before what comes."""
LEVEL_S = 0.1
_FULL_SCALE = {"int16": 32_768.0, "int32": 2_147_483_648.0, "float32": 1.0}


class Playback:
    """What all playback devices do: say who answered in the recording, and be back when it was back."""

    kind = ""

    def __init__(self, tape: Tape, clock: ReplayClock, identity: Identity) -> None:
        self._tape = tape
        self._clock = clock
        self._identity = identity

    def open(self) -> Identity:
        """Say who answered when the session was recorded. Raises where the device never came back then."""
        lost = self._tape.lost
        if self._tape.rolling and (lost is None or not lost.came_back):
            raise self._tape.end(self.kind)
        return self._identity

    def make_safe(self) -> None:
        """Nothing moves."""

    def close(self) -> None:
        """Nothing to release: the session is not this device's."""

    def recall(self, record: int) -> list[Seen]:
        """What the device was seen to do while a record was taken."""
        return [observed.state for observed in self._tape.observed(self.kind, record)]

    def lost_next(self) -> bool:
        """Whether it was lost before it was asked again; False for recordings that did not look during records."""
        return self._tape.lost_next(self.kind)

    def _lead_in(self, natural_ns: int = 0) -> None:
        """Skip what is longer than ``natural_ns`` (what the device itself took) and a moment before the next record."""
        at = self._tape.next_ns(self.kind)
        if at is not None:
            self._clock.skip_to(at - natural_ns - LEAD_NS)


class PlaybackRadar(Playback):
    """The radar: audio blocks with the device's own counts and times."""

    kind = "radar"

    def __init__(self, tape: Tape, clock: ReplayClock, identity: Identity) -> None:
        super().__init__(tape, clock, identity)
        self._asked = 0
        self._gapless = False
        self._lost = 0
        self._level = Level()

    @property
    def sample_rate_hz(self) -> float:
        """Nominal sample rate of the recording, Hz."""
        return self._tape.session.sample_rate_hz

    @property
    def lost_frames(self) -> int:
        """Audio frames lost in the blocks delivered so far."""
        return self._lost

    def begin(self, frames: int) -> None:
        """Ask for the next recorded block."""
        self._asked, self._gapless = frames, False
        self._lead_in()

    def begin_stream(self, frames: int) -> None:
        """Ask for the recorded blocks of a pass."""
        self.begin(frames)
        self._gapless = True

    def poll(self) -> AudioBlock | None:
        """The block asked for once the clock is at its end. Raises when it was not of the length asked for."""
        session = self._tape.session
        if not self._tape.rolling:
            # The scheduler listens before it records; of that nothing is in a session.
            config = session.config
            shape = (self._asked, int(config["audio_channels"]))
            return AudioBlock(np.zeros(shape, config["sample_dtype"]), self.sample_rate_hz, 0, 0.0, 0)
        if self._gapless and self._tape.pauses(self.kind):
            return None
        number = self._tape.ask(self.kind)
        row = session.sweeps[number]
        if int(row["samples"]) != self._asked:
            raise Diverged(
                f"is asked for {self._asked} frames where {int(row['samples'])} were recorded",
                where=f"radar, record {number}",
                advice="the session was recorded by another version",
            )
        if not self._clock.reached(int(row["t_host_ns"]) + round(1e9 * self._asked / self.sample_rate_hz)):
            return None
        block = audio_block(session, number)
        self._lost += block.lost_frames
        self._level = _level(block)
        return block

    def cancel(self) -> None:
        """Forget the block asked for."""
        self._asked, self._gapless = 0, False

    def level(self) -> Level:
        """Levels at the end of the block delivered last."""
        return self._level

    def clock(self) -> ClockFix | None:
        """None: the recording's clock fixes go into the copy where they stood, whatever the pace."""
        return None


class PlaybackSwitches(Playback):
    """The transfer switches: the routes that they reported."""

    kind = "switches"

    def select(self, channel: Channel) -> SwitchState:
        """The next recorded state."""
        return self.state()

    def state(self) -> SwitchState:
        """The next recorded state."""
        return switch_state(self._tape.session, self._tape.ask(self.kind))


class PlaybackTrolley(Playback):
    """The trolley: its fixes; under way between two of them where time is waited for."""

    kind = "trolley"

    def __init__(self, tape: Tape, clock: ReplayClock, identity: Identity, rig: Rig) -> None:
        super().__init__(tape, clock, identity)
        self._half_m = rig.trolley.length_m / 2
        self._speed_m_s = rig.trolley.speed_m_s
        self._moving = False
        self._began_ns = 0
        self._from = TrolleyFix(0.0, 0.0, False, 0)

    @property
    def limits_m(self) -> tuple[float, float]:
        """The rail's ends."""
        return -self._half_m, self._half_m

    def start_move(self, x_m: float, speed_m_s: float | None = None) -> None:
        """The next recorded fix is the end of this move."""
        self._moving = True
        self._lead_in(round(1.5e9 * abs(x_m - self._from.x_m) / (speed_m_s or self._speed_m_s)))
        self._began_ns = self._clock.now_ns()

    def poll(self) -> TrolleyFix:
        """The next recorded fix; on the way there while the clock has not reached it."""
        if self._tape.recovering:
            return self._from
        fix = trolley_fix(self._tape.session, self._tape.ask(self.kind))
        # A fix taken under way belongs to a record, whose audio keeps the pace.
        if self._moving and not fix.moving and not self._clock.reached(fix.t_host_ns):
            now = self._clock.now_ns()
            part = min(max((now - self._began_ns) / max(fix.t_host_ns - self._began_ns, 1), 0.0), 1.0)
            x_m = self._from.x_m + part * (fix.x_m - self._from.x_m)
            return TrolleyFix(x_m, fix.sd_m, True, now, "replay")
        self._tape.answered(self.kind)
        self._moving = self._moving and fix.moving
        self._from = fix
        return fix

    def stop(self) -> None:
        """The move, if any, ends where it ended in the recording."""
        self._moving = False


class PlaybackPolarizer(Playback):
    """A polarizer, the camera's or the light source's (``kind``): its fixes."""

    def __init__(self, tape: Tape, clock: ReplayClock, identity: Identity, kind: str = "polarizer") -> None:
        super().__init__(tape, clock, identity)
        self.kind = kind

    def start_turn(self, angle_rad: float) -> None:
        """The next recorded fix is the end of this turn."""
        self._lead_in()

    def poll(self) -> PolarizerFix:
        """The next recorded fix, moving while the clock has not reached it."""
        number, session = self._tape.ask(self.kind), self._tape.session
        fix = polarizer_fix(session, number) if self.kind == "polarizer" else source_fix(session, number).fix
        if not self._clock.reached(fix.t_host_ns):
            return PolarizerFix(fix.angle_rad, fix.sd_rad, True, self._clock.now_ns())
        self._tape.answered(self.kind)
        return fix

    def stop(self) -> None:
        """Nothing turns."""


class PlaybackCamera(Playback):
    """The camera: its frames. Frames of a search for an exposure were not kept: of those only the brightest pixel is
    known, and that is all that the search looks at."""

    kind = "camera"

    def __init__(self, tape: Tape, clock: ReplayClock, identity: Identity) -> None:
        super().__init__(tape, clock, identity)
        self._lost = 0
        self._looking = False

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a recorded frame."""
        rows, columns = self._tape.session.config["frame_shape"]
        return int(rows), int(columns)

    @property
    def lost_frames(self) -> int:
        """Frames lost or incomplete among those delivered so far."""
        return self._lost

    def trigger(self) -> None:
        """Ask for the next recorded frame."""
        self._lead_in()

    def poll(self) -> Frame | None:
        """The next recorded frame once the clock has reached it."""
        session = self._tape.session
        if self._looking:
            look = self._tape.look()
            if not self._clock.reached(look.t_host_ns):
                return None
            self._looking = False
            image = np.zeros(self.shape, session.config["frame_dtype"])
            image[0, 0] = look.peak_counts
            return Frame(image, 0, look.exposure_s, 0.0, 0.0, look.t_host_ns)
        number = self._tape.ask(self.kind)
        if not self._clock.reached(int(session.frames[number]["t_host_ns"])):
            return None
        found = frame(session, number)
        self._lost += found.lost_before + int(found.incomplete)
        return found

    def exposure_limits(self) -> tuple[float, float]:
        """Limits of the recorded camera, s."""
        return self._tape.look().limits_s

    def set_exposure(self, seconds: float) -> float:
        """What the recorded camera made of it, s; the next frame is one of the search."""
        self._looking = True
        return self._tape.look().exposure_s

    def clock(self) -> ClockFix | None:
        """None, as :meth:`PlaybackRadar.clock`."""
        return None


def playback_devices(tape: Tape, clock: ReplayClock, rig: Rig, control: Control, kinds: Sequence[str]) -> DeviceSet:
    """One playback device for each device of the recording, or that the plan asks for, in the scheduler's order.

    A recording may have more than its plan asks for: earlier versions opened the whole rig.
    """
    identities = [Identity(**fields) for fields in tape.session.config["identities"]]
    recorded = _by_kind(identities, kinds)
    made = DeviceSet(control)
    for kind in in_order({*kinds, *recorded}):
        identity = recorded.get(kind) or Identity(kind, "replay", f"recorded {kind}")
        device: contracts.Device
        match kind:
            case "radar":
                device = PlaybackRadar(tape, clock, identity)
            case "switches":
                device = PlaybackSwitches(tape, clock, identity)
            case "trolley":
                device = PlaybackTrolley(tape, clock, identity, rig)
            case "camera":
                device = PlaybackCamera(tape, clock, identity)
            case _:
                device = PlaybackPolarizer(tape, clock, identity, kind)
        # As if by hand: how long a move may take was decided when it was recorded.
        made.by_kind[kind] = Device(kind, "replay", device, Lane(f"replay {kind}"), by_hand=True)
    return made


def _by_kind(identities: Sequence[Identity], kinds: Sequence[str]) -> dict[str, Identity]:
    """Who answered, by what it was in the rig; the light source's polarizer calls itself a polarizer too."""
    found: dict[str, Identity] = {}
    for identity in identities:
        kind = identity.kind
        if kind == "polarizer" and (kind in found or (kind not in kinds and "source_polarizer" in kinds)):
            kind = "source_polarizer"
        found[kind] = identity
    return found


def _level(block: AudioBlock) -> Level:
    last = block.samples[-max(round(LEVEL_S * block.sample_rate_hz), 1) :].astype(np.float64)
    part = last / _FULL_SCALE[block.samples.dtype.name]
    peak, rms = np.abs(part).max(axis=0), np.sqrt(np.mean(part**2, axis=0))
    return Level(tuple(map(float, peak)), tuple(map(float, rms)))
