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


@dataclass(frozen=True)
class Sweeps:
    """One contiguous block of audio, recorded in one channel at one position.

    ``x_m`` and ``x_sd_m`` are what the trolley reported. ``attempt`` counts from 0 for each position and channel; the
    latest attempt without :attr:`SweepFlag.LOST` supersedes the earlier ones.
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
    """One camera frame at one angle of the polarizer (radians from horizontal)."""

    frame: Frame
    angle_rad: float
    angle_sd_rad: float = 0.0
    dark: bool = False
    attempt: int = 0


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


Record = Sweeps | Exposure | TrolleyFix | SwitchState | PolarizerFix | ClockFix | Note | Event
