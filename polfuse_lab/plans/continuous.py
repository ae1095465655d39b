"""Collect along the rail without stops."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import Field, model_validator

from drivers.records import Channel
from polfuse_lab.plans.base import ChannelName, LoopedPlan
from polfuse_lab.plans.optics import OpticsPlan
from polfuse_lab.plans.rail import TrackOrder
from polfuse_lab.plans.steps import PASS_POSITIONS, Checkpoint, MoveTo, RecordPass, SelectChannel, Settle, Step


class ContinuousSarPlan(LoopedPlan):
    """``continuous_sar``: the trolley runs along the rail while one channel is recorded without a gap, channel after
    channel. Where the antenna was in each sweep is read from the trolley's fixes."""

    kind: Literal["continuous_sar"] = "continuous_sar"
    """Without stops along the rail."""
    aperture_m: float = Field(default=3.048, gt=0)
    """Length of the synthetic aperture, m (thesis: 10 ft)."""
    drive: Literal["constant_speed", "encoder"] = "constant_speed"
    """"constant_speed": driven at ``speed_m_s``; "encoder": pushed by hand, its encoder says where it is."""
    speed_m_s: float | None = Field(default=None, gt=0)
    """Speed along the aperture, m/s; needed for "constant_speed" only."""
    run_up_m: float = Field(default=0.0, ge=0)
    """Distance before and behind the aperture, in which the trolley gets to its speed and stops, m."""
    channels: tuple[ChannelName, ...] = Field(default=("HH", "HV", "VV", "VH"), min_length=1)
    """Channels, one run of the trolley for each."""
    track_order: TrackOrder = "serpentine"
    """"forward" (each run to larger x), "reverse", or "serpentine": each run begins where the last one ended."""
    passes: int = Field(default=1, ge=1, le=1000)
    """Runs for each channel."""
    block_s: float = Field(default=1.0, ge=0.1, le=60)
    """About how long each record is into which a run is cut (without a gap between them), s."""
    move_settle_s: float = Field(default=0.2, ge=0, le=60)
    """Wait before each run, s."""
    optics: OpticsPlan | None = None
    """Polarizer series at the aperture's centre, after the runs of each repeat; left out for radar only."""

    @model_validator(mode="after")
    def _sound(self) -> ContinuousSarPlan:
        if len(set(self.channels)) != len(self.channels):
            raise ValueError(f"channels are each named once, found {list(self.channels)}")
        if self.drive == "constant_speed" and self.speed_m_s is None:
            raise ValueError('speed_m_s is needed with drive = "constant_speed"')
        if self.drive == "encoder" and self.speed_m_s is not None:
            raise ValueError('speed_m_s is left out with drive = "encoder": whoever pushes decides')
        return self

    @property
    def uses_camera(self) -> bool:
        """Whether there is a polarizer series."""
        return self.optics is not None

    def unpaused_steps(self, mosaic: bool) -> Iterator[Step]:
        """To the start, select the channel, run; checkpoints are counted in runs."""
        run = 0
        end = self.aperture_m / 2 + self.run_up_m
        for _ in range(self.repeats):
            for number in range(self.passes * len(self.channels)):
                channel = Channel[self.channels[number % len(self.channels)]]
                backwards = self.track_order == "reverse" or (self.track_order == "serpentine" and number % 2 == 1)
                x_from = end if backwards else -end
                first = run * PASS_POSITIONS
                yield MoveTo(x_from, first)
                if self.move_settle_s:
                    yield Settle(self.move_settle_s)
                yield SelectChannel(channel)
                yield RecordPass(x_from, -x_from, self.speed_m_s, first, channel, self.block_s)
                yield Checkpoint(run)
                run += 1
            if self.optics is not None:
                yield from self.optics.early_steps(mosaic=mosaic)
                yield MoveTo(0.0, run * PASS_POSITIONS)
                yield from self.optics.steps(mosaic=mosaic)
                yield Checkpoint(run - 1)
