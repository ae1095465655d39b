"""What a scheduler works with: where records go, who looks at them, who makes the devices."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from polfuse_lab.errors import PolfuseError
from polfuse_lab.records import Record
from polfuse_lab.rig import Rig
from polfuse_lab.scheduler.control import Control
from polfuse_lab.scheduler.devices import DeviceSet
from polfuse_lab.scheduler.prompts import Prompts
from polfuse_lab.session.layout import SessionConfig


class Recorder(Protocol):
    """Where records go; :class:`polfuse_lab.engine.recorder.WriterProcess` is the usual one."""

    @property
    def free_bytes(self) -> int | None:
        """Free space on the disk, where it is known."""

    def open(self, config: SessionConfig, *, expected_bytes: int = 0) -> None:
        """Declare the session."""

    @property
    def failure(self) -> PolfuseError | None:
        """Why nothing more can be written."""

    def offer(self, record: Record) -> bool:
        """Take a record, or say that there is no room at present."""

    def flush(self) -> int:
        """Begin to bring everything to the disk; return a ticket."""

    def flushed(self, ticket: int) -> bool:
        """Whether that is done."""

    def close(self, state: str, reason: str) -> Path:
        """Finish the session."""

    def kill(self) -> None:
        """Give up."""


class Viewer(Protocol):
    """Who looks at the records as they are made; :class:`polfuse_lab.live.LivePipeline` is the usual one."""

    def offer(self, record: Record) -> None:
        """Take a record; must return at once."""

    @property
    def fatal(self) -> str | None:
        """Why the collect is pointless."""

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know."""


class DeviceMaker(Protocol):
    """Makes the devices of a run; :func:`polfuse_lab.scheduler.devices.make_devices` is the usual one."""

    def __call__(self, rig: Rig, path: Path, operator: Prompts, control: Control, kinds: Sequence[str]) -> DeviceSet:
        """Make the drivers of these kinds of devices, not yet opened. Raises :class:`PolfuseError`."""
