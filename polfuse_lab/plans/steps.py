"""The plain steps that plans yield. A step says what is to be done; only the scheduler touches devices."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.records import Channel


@dataclass(frozen=True)
class MoveTo:
    """Move the trolley to ``x_m`` and wait until it stands there."""

    x_m: float
    position: int


@dataclass(frozen=True)
class SelectChannel:
    """Route both transfer switches."""

    channel: Channel


@dataclass(frozen=True)
class Settle:
    """Wait for ``seconds`` (vibration of the trolley, contacts of the switches)."""

    seconds: float


@dataclass(frozen=True)
class RecordSweeps:
    """Record at least ``sweeps`` whole up-ramps in the present channel at the present position."""

    sweeps: int
    position: int
    channel: Channel


@dataclass(frozen=True)
class TurnPolarizer:
    """Turn the polarizer and wait until it stands."""

    angle_rad: float


@dataclass(frozen=True)
class AutoExpose:
    """Find an exposure that suits all polarizer angles, and keep it; no angles for a camera that sees them at once."""

    angles_rad: tuple[float, ...]


@dataclass(frozen=True)
class Expose:
    """Take ``frames`` frames at the present polarizer angle; ``dark`` marks frames taken with the lens covered."""

    frames: int
    angle_rad: float
    dark: bool = False


@dataclass(frozen=True)
class Checkpoint:
    """Everything before this is flushed; a resumed run starts again here."""

    position: int


@dataclass(frozen=True)
class Ask:
    """Ask the operator and wait for the answer."""

    prompt: str


Step = MoveTo | SelectChannel | Settle | RecordSweeps | TurnPolarizer | AutoExpose | Expose | Checkpoint | Ask
