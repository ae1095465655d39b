"""What a list of steps will leave behind: audio records, camera frames, positions; and which devices it needs."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from drivers.records import Channel
from polfuse_lab.plans.steps import (
    PASS_POSITIONS,
    AutoExpose,
    Checkpoint,
    Expose,
    MoveTo,
    RecordPass,
    RecordSeconds,
    RecordSweeps,
    SelectChannel,
    StartTurn,
    Step,
    TurnPolarizer,
    TurnSource,
)


@dataclass(frozen=True)
class PlannedRecord:
    """One audio record that a plan asks for; a run of the trolley counts as one, however often it is cut."""

    channel: Channel
    first_position: int
    positions: int = 1
    """Position numbers that it may take."""


@dataclass(frozen=True)
class Planned:
    """What a plan leaves behind."""

    records: tuple[PlannedRecord, ...]
    frames: int
    """Camera frames with light."""
    dark_frames: int
    """Camera frames with the lens covered."""
    positions: int
    """What is counted while it runs: positions, passes or records, each ended by a checkpoint."""
    devices: frozenset[str]
    """Kinds of devices that are spoken to: "radar", "switches", "trolley", "camera", "polarizer", …"""


def planned(listed: Iterable[Step]) -> Planned:
    """Sum up what steps leave behind."""
    records: list[PlannedRecord] = []
    frames = {False: 0, True: 0}
    positions = 0
    devices: set[str] = set()
    for step in listed:
        match step:
            case RecordSweeps() | RecordSeconds():
                records.append(PlannedRecord(step.channel, step.position))
                devices |= {"radar", "switches", "trolley"}
            case RecordPass():
                records.append(PlannedRecord(step.channel, step.first_position, PASS_POSITIONS))
                devices |= {"radar", "switches", "trolley"}
            case SelectChannel():
                devices.add("switches")
            case MoveTo():
                devices.add("trolley")
            case Expose():
                frames[step.dark] += step.frames
                devices.add("camera")
            case AutoExpose():
                devices |= {"camera", "polarizer"} if step.angles_rad else {"camera"}
            case StartTurn() | TurnPolarizer():
                devices.add("polarizer")
            case TurnSource():
                devices.add("source_polarizer")
            case Checkpoint(position):
                positions = max(positions, position + 1)
    return Planned(tuple(records), frames[False], frames[True], positions, frozenset(devices))
