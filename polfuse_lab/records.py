"""Records as a session keeps them: what a driver reported, with where and for what the scheduler asked for it."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from drivers.records import AudioBlock, Channel, ClockFix, Frame, PolarizerFix, SwitchState, TrolleyFix


class SweepFlag(enum.IntFlag):
    """What is to be known of one audio record before it is used."""

    NONE = 0
    LOST = 1
    """More audio frames were lost inside it than the plan allows; it was taken again."""
    OVERFLOW = 2
    """The audio device raised its overflow flag."""
    SWITCH_CHANGED = 4
    """The transfer switches stood differently after the record than before it."""
    SWITCH_UNVERIFIED = 8
    """The switches' route was commanded but not verified by the device."""
    RETRY = 16
    """Taken again since an earlier attempt was not good enough."""
    REPEATED = 32
    """Taken again since the collect was paused and resumed from its last checkpoint."""
    MOVED = 64
    """The trolley, which should have stood, moved during the record; it was taken again."""
    CONTINUOUS = 128
    """Part of a pass without a gap, in which the trolley moves as planned; each sweep has its own position."""


class FrameFlag(enum.IntFlag):
    """What is to be known of one camera frame before it is used."""

    NONE = 0
    MOVED = 1
    """A polarizer turned, or stood at another angle after the frame than before, or nobody could look; taken again."""
    RETRY = 2
    """Taken again since an earlier frame was not good enough."""


SUPERSEDED = SweepFlag.LOST | SweepFlag.SWITCH_CHANGED | SweepFlag.MOVED
"""Flags of audio records that were taken again."""


@dataclass(frozen=True)
class Sweeps:
    """One contiguous block of audio, recorded in one channel at one position.

    ``x_m`` and ``x_sd_m`` are what the trolley reported (in a pass: at the middle of the block). ``attempt`` counts
    from 0 for each position and channel; the latest attempt without a flag of :data:`SUPERSEDED` counts.
    """

    block: AudioBlock
    channel: Channel
    position: int
    x_m: float = 0.0
    x_sd_m: float = 0.0
    sweeps_requested: int = 0
    flags: SweepFlag = SweepFlag.NONE
    attempt: int = 0


@dataclass(frozen=True)
class Exposure:
    """One camera frame at one angle of the polarizer (radians from horizontal).

    ``source_angle_rad`` is the angle of the light source's polarizer, None where the source has none.
    """

    frame: Frame
    angle_rad: float
    angle_sd_rad: float = 0.0
    dark: bool = False
    attempt: int = 0
    source_angle_rad: float | None = None
    source_angle_sd_rad: float = 0.0
    flags: FrameFlag = FrameFlag.NONE


@dataclass(frozen=True)
class SourceFix:
    """Where the polarizer of the light source stood."""

    fix: PolarizerFix

    @property
    def t_host_ns(self) -> int:
        """When, on the host's monotonic clock."""
        return self.fix.t_host_ns


@dataclass(frozen=True)
class Observed:
    """What a device was seen to do *while* a record was taken, beside what the steps ask.

    ``record`` is the number of that record in its table: of an audio record for trolley and switches, of a frame for
    polarizers.
    """

    state: TrolleyFix | SwitchState | PolarizerFix | SourceFix
    record: int

    @property
    def t_host_ns(self) -> int:
        """When, on the host's monotonic clock."""
        return self.state.t_host_ns


@dataclass(frozen=True)
class Note:
    """A remark by the operator."""

    text: str
    t_host_ns: int


@dataclass(frozen=True)
class Event:
    """Something that the scheduler did or noticed: ``kind`` is one word, ``text`` a sentence."""

    kind: str
    text: str
    t_host_ns: int


Record = Sweeps | Exposure | TrolleyFix | SwitchState | PolarizerFix | SourceFix | Observed | ClockFix | Note | Event
