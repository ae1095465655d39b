"""Go on with a collect that did not come to its end, in a new session that names the one before it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from drivers.records import Channel
from polfuse_lab.errors import PolfuseError
from polfuse_lab.plans import Plan
from polfuse_lab.plans.steps import (
    PASS_POSITIONS,
    Checkpoint,
    Expose,
    RecordPass,
    RecordSeconds,
    RecordSweeps,
    Step,
)
from polfuse_lab.records import SUPERSEDED, FrameFlag
from polfuse_lab.rig import Rig
from polfuse_lab.session.reader import Session, open_session
from polfuse_lab.session.space import ballast_path, in_use

ANGLE_TOLERANCE_RAD = math.radians(0.5)
"""Polarizers stand this near to the angle that was asked for."""


@dataclass(frozen=True)
class Continuation:
    """What is left of a collect."""

    predecessor: Path
    started: str
    """When the predecessor was started, which tells it from all others."""
    steps: tuple[Step, ...]
    """What is still to be done, from the first checkpoint that is missing."""

    @property
    def origin(self) -> dict[str, str]:
        """For the new session's configuration (:data:`polfuse_lab.session.layout.CONTINUES`)."""
        return {"session": self.predecessor.name, "started": self.started}


def continuation(predecessor: Path | str, rig: Rig, plan: Plan) -> Continuation:
    """What is left of the collect in ``predecessor``, which was made by the same plan on the same kind of rig.

    Raises:
        PolfuseError: the session cannot be read or is being written, belongs to another plan or waveform, or nothing
            is missing in it.
    """
    path = Path(predecessor)
    if path.suffix == ".partial" and in_use(ballast_path(path.with_suffix(""))):
        raise PolfuseError("is still being written", where=str(path), advice="wait until the collect has ended")
    with open_session(path) as session:
        steps = session.steps
        whole = tuple(plan.steps(mosaic=rig.has_mosaic))
        # A session that is itself a continuation holds the end of the plan's steps.
        if not steps or steps != whole[len(whole) - len(steps) :]:
            raise PolfuseError(
                "was collected with another plan", where=str(path), advice="continue it with its own (in 'config')"
            )
        if session.waveform != rig.waveform:
            raise PolfuseError(
                "was collected with another waveform", where=str(path), advice="continue it with its own rig file"
            )
        done = steps_done(session)
        if done == len(steps):
            raise PolfuseError("is complete: nothing is missing", where=str(path), advice="there is nothing to do")
        started = str(session.config["started"])
    return Continuation(path, started, steps[done:])


def steps_done(session: Session) -> int:
    """How many of a session's steps need not be done again: up to the last checkpoint before which nothing is missing.

    A pass of the trolley counts as done when something that follows it is there, since a pass may have been cut short.
    Steps that leave no record behind (questions, marks) are done again unless a later record is there.
    """
    have = _Have(session)
    sections = list(_sections(session.steps))
    done = 0
    for number, section in enumerate(sections):
        records = [step for step in section if isinstance(step, (RecordSweeps, RecordSeconds, RecordPass, Expose))]
        if not all(have.take(step) for step in records):
            break
        if not records:
            continue
        # In any case everything up to the section before was carried out.
        done = number if any(isinstance(step, RecordPass) for step in records) else number + 1
    else:
        if session.state == "finished":
            return len(session.steps)
    return sum(len(section) for section in sections[:done])


def _sections(steps: Sequence[Step]) -> Iterator[list[Step]]:
    """Steps up to and with each checkpoint; what follows the last one is a section as well."""
    section: list[Step] = []
    for step in steps:
        section.append(step)
        if isinstance(step, Checkpoint):
            yield section
            section = []
    if section:
        yield section


class _Have:
    """The good records of a session; :meth:`take` counts them off."""

    def __init__(self, session: Session) -> None:
        good = session.sweeps[(session.sweeps["flags"] & int(SUPERSEDED)) == 0]
        self._audio = {(int(row["position"]), Channel(int(row["channel"]))) for row in good}
        frames = session.frames
        self._frames = frames[~frames["incomplete"] & ((frames["flags"] & int(FrameFlag.MOVED)) == 0)]
        self._taken: Counter[tuple[float, bool, float | None]] = Counter()

    def take(self, step: RecordSweeps | RecordSeconds | RecordPass | Expose) -> bool:
        """Whether what a step leaves behind is there."""
        match step:
            case RecordSweeps() | RecordSeconds():
                return (step.position, step.channel) in self._audio
            case RecordPass():
                numbers = range(step.first_position, step.first_position + PASS_POSITIONS)
                return any(channel == step.channel and position in numbers for position, channel in self._audio)
            case Expose():
                key = (step.angle_rad, step.dark, step.source_angle_rad)
                self._taken[key] += step.frames
                return self._count(step) >= self._taken[key]

    def _count(self, step: Expose) -> int:
        rows = self._frames
        away = np.abs(np.angle(np.exp(2j * (rows["angle_rad"] - step.angle_rad)))) / 2  # a polarizer repeats after pi
        fits = (rows["dark"] == step.dark) & (away <= ANGLE_TOLERANCE_RAD)
        if step.source_angle_rad is not None:
            source = np.abs(np.angle(np.exp(2j * (rows["source_angle_rad"] - step.source_angle_rad)))) / 2
            fits &= source <= ANGLE_TOLERANCE_RAD
        return int(np.count_nonzero(fits))
