"""Collects from one place: the noise of the sky, ranges over time, and speeds in CW."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import ClassVar, Literal

from pydantic import Field, model_validator

from drivers.records import Channel
from polfuse_lab.plans.base import ChannelName, ChannelsPlan, LoopedPlan, Visit
from polfuse_lab.plans.optics import OpticsPlan
from polfuse_lab.plans.steps import Ask, Checkpoint, MoveTo, RecordSeconds, RecordSweeps, SelectChannel, Step

LONGEST_S = 3600.0
"""Longest single record, s: it is held in memory until it is complete."""
CW_ON = "Set the radar to CW: switch its ramp off (bandwidth 0), then confirm."
CW_OFF = "Switch the radar's ramp on again, then confirm."


class SkyPlan(ChannelsPlan):
    """``sky``: the noise floor and the antennas' coupling from one position, antennas up; nothing moves."""

    kind: Literal["sky"] = "sky"
    """The empty sky."""
    optics: OpticsPlan | None = None
    """Polarizer series after the radar's records; left out for radar only."""

    ignored: ClassVar[frozenset[str]] = frozenset({"aperture_m", "step_m", "move_settle_s"})

    @property
    def uses_camera(self) -> bool:
        """Whether there is a polarizer series."""
        return self.optics is not None

    def visits(self) -> tuple[Visit, ...]:
        """One stay for each repeat."""
        return tuple(Visit(repeat, 0.0, 0, repeat) for repeat in range(self.repeats))

    def unpaused_steps(self, mosaic: bool) -> Iterator[Step]:
        """Every channel where the trolley stands."""
        for visit in self.visits():
            if self.optics is not None:
                yield from self.optics.early_steps(mosaic=mosaic)
            yield from self.record_channels(visit.position)
            if self.optics is not None:
                yield from self.optics.steps(mosaic=mosaic)
            yield Checkpoint(visit.position)


class FixedPlan(LoopedPlan):
    """One channel from one place, record after record."""

    channel: ChannelName = "HH"
    """The channel that is recorded."""
    x_m: float | None = None
    """Where the trolley is moved to, m from the rail's centre; left out: it stays where it stands."""

    def visits(self) -> tuple[Visit, ...]:
        """One stay for each record."""
        return tuple(Visit(repeat, self.x_m or 0.0, 0, repeat) for repeat in range(self.repeats))

    @abstractmethod
    def record(self, position: int) -> Step:
        """The step that makes one record."""

    def unpaused_steps(self, mosaic: bool) -> Iterator[Step]:
        """Move there once; then record again and again."""
        for visit in self.visits():
            if self.x_m is not None and visit.position == 0:
                yield MoveTo(self.x_m, 0)
            yield SelectChannel(Channel[self.channel])
            yield self.record(visit.position)
            yield Checkpoint(visit.position)


class RangingPlan(FixedPlan):
    """``ranging``: ranges over time of what moves in front of a radar that stands still."""

    kind: Literal["ranging"] = "ranging"
    """Ranges over time."""
    seconds: float | None = Field(default=None, gt=0, le=LONGEST_S)
    """Length of each record, s; either this or ``sweeps``."""
    sweeps: int | None = Field(default=None, ge=1, le=100_000)
    """Whole sweeps in each record; either this or ``seconds``."""

    @model_validator(mode="after")
    def _one_length(self) -> RangingPlan:
        if (self.seconds is None) == (self.sweeps is None):
            raise ValueError("a ranging plan says either seconds or sweeps, for the length of each record")
        return self

    def record(self, position: int) -> Step:
        """So many seconds, or so many sweeps."""
        channel = Channel[self.channel]
        if self.seconds is not None:
            return RecordSeconds(self.seconds, position, channel)
        assert self.sweeps is not None
        return RecordSweeps(self.sweeps, position, channel)


class DopplerPlan(FixedPlan):
    """``doppler``: speeds, with the radar in continuous wave (its ramp switched off by the operator)."""

    kind: Literal["doppler"] = "doppler"
    """Speeds in CW."""
    seconds: float = Field(default=10.0, gt=0, le=LONGEST_S)
    """Length of each record, s; the resolution of Doppler frequencies is its inverse at best."""
    ask_cw: bool = True
    """Ask the operator to switch the ramp off before and on again after; false for a radar that stands in CW."""

    @property
    def continuous_wave(self) -> bool:
        """Always."""
        return True

    def record(self, position: int) -> Step:
        """So many seconds."""
        return RecordSeconds(self.seconds, position, Channel[self.channel])

    def unpaused_steps(self, mosaic: bool) -> Iterator[Step]:
        """The records, between the two questions to the operator."""
        if self.ask_cw:
            yield Ask(CW_ON)
        yield from super().unpaused_steps(mosaic)
        if self.ask_cw:
            yield Ask(CW_OFF)
