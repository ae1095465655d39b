"""The plan file: what to collect."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from polfuse_lab.rig import FileModel, read_model

ChannelName = Literal["HH", "HV", "VH", "VV"]


class OpticsPlan(FileModel):
    """The polarizer series that is taken at the aperture's centre."""

    angles_deg: tuple[float, ...] = Field(default=(0.0, 45.0, 90.0, 135.0), min_length=3)
    """Polarizer angles from horizontal, degrees."""
    frames_per_angle: int = Field(default=4, ge=1, le=10_000)
    """Frames taken and averaged at each angle."""
    settle_s: float = Field(default=0.05, ge=0, le=60)
    """Wait after the polarizer stands, s."""
    auto_exposure: bool = False
    """Find an exposure that saturates at no angle before the series, and keep it; otherwise the rig file's holds."""


class Plan(FileModel):
    """A collect. ``rail_sar`` moves along the rail; ``sky`` records the noise floor from one position, antennas up."""

    name: str = "collect"
    """A name for reports."""
    kind: Literal["rail_sar", "sky"] = "rail_sar"
    """What is collected."""
    aperture_m: float = Field(default=3.048, ge=0)
    """Length of the synthetic aperture, m (thesis: 10 ft)."""
    step_m: float = Field(default=0.0508, gt=0)
    """Distance between positions, m (thesis: 2 in)."""
    channels: tuple[ChannelName, ...] = Field(default=("HH", "HV", "VV", "VH"), min_length=1)
    """Channels at each position, in this order."""
    sweeps_per_channel: int = Field(default=4, ge=1, le=100_000)
    """Whole sweeps recorded and averaged for each channel at each position."""
    move_settle_s: float = Field(default=0.2, ge=0, le=60)
    """Wait after the trolley stands, s."""
    optics: OpticsPlan | None = None
    """Polarizer series at the aperture's centre; left out for radar only."""
    max_lost_frames: int = Field(default=0, ge=0)
    """Audio frames that may be lost in one record before it is taken again."""
    retries: int = Field(default=2, ge=0, le=100)
    """How often a record is taken again before the collect stops."""
    reconnect_wait_s: float = Field(default=120.0, ge=0, le=86_400)
    """How long a paused collect waits for a lost device to come back, s; 0 stops at once."""
    max_reconnects: int = Field(default=5, ge=0, le=1000)
    """How often each device may be lost and come back before the collect stops."""

    @model_validator(mode="after")
    def _sound(self) -> Plan:
        if len(set(self.channels)) != len(self.channels):
            raise ValueError(f"channels are each named once, found {list(self.channels)}")
        if self.kind == "rail_sar" and self.step_m > max(self.aperture_m, 1e-9):
            raise ValueError(f"step_m ({self.step_m}) is at most aperture_m ({self.aperture_m})")
        return self

    @property
    def positions_m(self) -> tuple[float, ...]:
        """Trolley positions x, m, symmetric about the aperture's centre (10 ft in 2 in steps: 61 positions)."""
        if self.kind == "sky":
            return (0.0,)
        # Steps that fit into the aperture; the tolerance lets 3.048 / 0.0508 be 60 in binary floating point.
        steps = int(self.aperture_m / self.step_m + 1e-6)
        return tuple((i - steps / 2) * self.step_m for i in range(steps + 1))


def load_plan(path: Path | str) -> Plan:
    """Read a plan file. Raises :class:`polfuse_lab.errors.PolfuseError` with file, line, field, found and allowed."""
    return read_model(path, Plan)
