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
class RecordSeconds:
    """Record without a gap for ``seconds`` in the present channel at the present position (Doppler, long ranging)."""

    seconds: float
    position: int
    channel: Channel


@dataclass(frozen=True)
class RecordPass:
    """Record without a gap while the trolley runs from ``x_from_m`` to ``x_to_m``.

    The run is cut into consecutive records of about ``block_s``, whose positions are numbered from ``first_position``.
    The trolley stands at ``x_from_m`` already. With a speed of None a person pushes it, and the run ends when its
    encoder has passed ``x_to_m``.
    """

    x_from_m: float
    x_to_m: float
    speed_m_s: float | None
    first_position: int
    channel: Channel
    block_s: float


@dataclass(frozen=True)
class StartTurn:
    """Begin to turn the polarizer and do not wait; a later :class:`TurnPolarizer` to the same angle waits for it."""

    angle_rad: float


@dataclass(frozen=True)
class TurnPolarizer:
    """Turn the polarizer and wait until it stands."""

    angle_rad: float


@dataclass(frozen=True)
class TurnSource:
    """Turn the polarizer of the light source and wait until it stands (active mode, thesis 6.3)."""

    angle_rad: float


@dataclass(frozen=True)
class AutoExpose:
    """Find an exposure that suits all polarizer angles, and keep it; no angles for a camera that sees them at once."""

    angles_rad: tuple[float, ...]


@dataclass(frozen=True)
class Expose:
    """Take ``frames`` frames at the present polarizer angle.

    ``dark`` marks frames taken with the lens covered; ``source_angle_rad`` is the angle of the light source's
    polarizer, None when the scene is lit by something else.
    """

    frames: int
    angle_rad: float
    dark: bool = False
    source_angle_rad: float | None = None


@dataclass(frozen=True)
class Checkpoint:
    """Everything before this is flushed; a resumed run starts again here."""

    position: int


@dataclass(frozen=True)
class Ask:
    """Ask the operator and wait for the answer."""

    prompt: str


@dataclass(frozen=True)
class Mark:
    """Store ``text`` as an event of kind "mark": what the records that follow belong to."""

    text: str


PASS_POSITIONS = 10_000
"""Position numbers that each :class:`RecordPass` has to itself: its first one is a multiple of this."""

Step = (
    MoveTo
    | SelectChannel
    | Settle
    | RecordSweeps
    | RecordSeconds
    | RecordPass
    | StartTurn
    | TurnPolarizer
    | TurnSource
    | AutoExpose
    | Expose
    | Checkpoint
    | Ask
    | Mark
)
