"""What a run tells of itself while it goes on."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field
from pathlib import Path


class RunState(enum.StrEnum):
    """States of the scheduler."""

    IDLE = "idle"
    PREPARING = "preparing"
    RUNNING = "running"
    PAUSED = "paused"
    STOPPING = "stopping"
    FINISHED = "finished"


@dataclass(frozen=True)
class RunStatus:
    """A frozen picture of a run."""

    state: RunState = RunState.IDLE
    reason: str = ""
    """Why it is in this state: the present step in words, or why the run ended."""
    step: int = 0
    """Steps carried out."""
    steps: int = 0
    position: int = -1
    positions: int = 0
    x_m: float | None = None
    """Where the trolley was last reported, m."""
    channel: str = ""
    eta_s: float | None = None
    """Expected time to the end, s."""
    elapsed_s: float = 0.0
    sweeps: int = 0
    """Audio records taken."""
    frames: int = 0
    samples_lost: int = 0
    frames_lost: int = 0
    disk_free_bytes: int | None = None
    warnings: tuple[str, ...] = field(default_factory=tuple)
    """What the user should know, oldest first."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    state: str
    """``"finished"``, ``"aborted"`` or ``"failed"``."""
    reason: str
    session: Path | None
    """The session file, None where none was begun."""
    positions: int = 0
    sweeps: int = 0
    frames: int = 0
    samples_lost: int = 0
    frames_lost: int = 0
    sync_rms_s: float | None = None
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()
