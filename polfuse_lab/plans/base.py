"""What all plans have in common: limits of a run, loops, and the steps that they become."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

from pydantic import Field, model_validator

from drivers.records import Channel
from polfuse_lab.plans.steps import Ask, Checkpoint, RecordSweeps, SelectChannel, Step
from polfuse_lab.rig import FileModel

ChannelName = Literal["HH", "HV", "VH", "VV"]


@dataclass(frozen=True)
class Visit:
    """One stay of the trolley at one place. Visits of one place (and target) are averaged when they are read."""

    position: int
    """Number of the visit, under which its records are kept."""
    x_m: float
    """Where the trolley stands, m."""
    place: int = 0
    """Number of the place along the rail, counted from the smallest x."""
    repeat: int = 0
    """Loop of the whole plan, from 0."""
    target: str = ""
    """Name of the target that stands in view, in a calibration series."""


class Plan(FileModel):
    """A collect of any kind. Each kind is a class of its own, chosen by ``kind`` in the plan file."""

    name: str = "collect"
    """A name for reports."""
    kind: str
    """What is collected."""
    max_lost_frames: int = Field(default=0, ge=0)
    """Audio frames that may be lost in one record before it is taken again."""
    retries: int = Field(default=2, ge=0, le=100)
    """How often a record is taken again before the collect stops."""
    reconnect_wait_s: float = Field(default=120.0, ge=0, le=86_400)
    """How long a paused collect waits for a lost device to come back, s; 0 stops at once."""
    max_reconnects: int = Field(default=5, ge=0, le=1000)
    """How often each device may be lost and come back before the collect stops."""

    ignored: ClassVar[frozenset[str]] = frozenset()
    """Keys that files of this kind may hold without effect, since earlier versions took them."""

    @model_validator(mode="before")
    @classmethod
    def _without_ignored(cls, values: object) -> object:
        if isinstance(values, dict):
            return {key: value for key, value in values.items() if key not in cls.ignored}
        return values

    @abstractmethod
    def steps(self, *, mosaic: bool = False) -> Iterator[Step]:
        """Yield the plan's steps in the order in which they are carried out.

        Args:
            mosaic: the camera sees all polarizer angles at once: nothing is turned, and frames are taken once.
        """

    @property
    def uses_camera(self) -> bool:
        """Whether it takes camera frames."""
        return False

    @property
    def continuous_wave(self) -> bool:
        """Whether the radar's ramp is switched off, so that its records have no ranges and perhaps no sync."""
        return False

    def visits(self) -> tuple[Visit, ...]:
        """Where the trolley stands for which records, in the order of their position numbers."""
        return ()

    @property
    def positions_m(self) -> tuple[float, ...]:
        """x of each visit, m."""
        return tuple(visit.x_m for visit in self.visits())


class LoopedPlan(Plan):
    """A plan that can be repeated as a whole and that can wait for the operator now and then."""

    repeats: int = Field(default=1, ge=1, le=10_000)
    """How often everything is done, one after the other."""
    pause_every: int = Field(default=0, ge=0)
    """Wait for the operator after so many positions (passes, records); 0 never."""

    @abstractmethod
    def unpaused_steps(self, mosaic: bool) -> Iterator[Step]:
        """The steps without the waits of ``pause_every``; each position ends with a checkpoint."""

    def steps(self, *, mosaic: bool = False) -> Iterator[Step]:
        """Yield the plan's steps; see :meth:`Plan.steps`."""
        done, due = 0, False
        for step in self.unpaused_steps(mosaic):
            if due:
                yield Ask(f"{done} of the plan's positions are done. Confirm to go on.")
                due = False
            yield step
            if isinstance(step, Checkpoint):
                done += 1
                due = self.pause_every > 0 and done % self.pause_every == 0


class ChannelsPlan(LoopedPlan):
    """A plan that records several channels at each position."""

    channels: tuple[ChannelName, ...] = Field(default=("HH", "HV", "VV", "VH"), min_length=1)
    """Channels at each position, in this order."""
    channel_order: Literal["same", "alternate"] = "same"
    """"same" at each position, or "alternate": backwards at every second one, so that the switches wear less."""
    sweeps_per_channel: int = Field(default=4, ge=1, le=100_000)
    """Whole sweeps recorded and averaged for each channel at each position."""

    @model_validator(mode="after")
    def _channels_once(self) -> ChannelsPlan:
        if len(set(self.channels)) != len(self.channels):
            raise ValueError(f"channels are each named once, found {list(self.channels)}")
        return self

    def record_channels(self, position: int) -> Iterator[Step]:
        """Select and record every channel at a position (its number decides about the order)."""
        backwards = self.channel_order == "alternate" and position % 2 == 1
        for name in reversed(self.channels) if backwards else self.channels:
            yield SelectChannel(Channel[name])
            yield RecordSweeps(self.sweeps_per_channel, position, Channel[name])
