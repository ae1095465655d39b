"""What a plan will do, how long it takes and how large its file gets, without touching a device."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from polfuse_lab.plans.base import Plan
from polfuse_lab.plans.checks import outside_limits, problems
from polfuse_lab.plans.costs import file_bytes, pass_blocks, record_frames, step_seconds, switch_cycles
from polfuse_lab.plans.listing import Planned, planned
from polfuse_lab.plans.steps import Ask, MoveTo, RecordPass, RecordSeconds, RecordSweeps, Step
from polfuse_lab.rig import Rig
from polfuse_lab.session.space import free_bytes
from processing.sar.aperture import alias_free_angle_rad

__all__ = ["DryRun", "dry_run", "record_frames", "step_seconds"]


@dataclass(frozen=True)
class DryRun:
    """The outcome of a dry run."""

    steps: tuple[Step, ...]
    seconds: float
    """Expected duration, s, if operators answer at once."""
    bytes: int
    """Upper bound of the file's size (as if nothing could be compressed), bytes."""
    limits_ok: bool
    """Whether every position can be reached."""
    problems: tuple[str, ...]
    """Why the plan cannot be carried out with this rig, one sentence each; empty when it can."""
    warnings: tuple[str, ...]
    """What can be carried out and is perhaps not meant, one sentence each."""
    planned: Planned
    """What it leaves behind."""
    records: int
    """Audio records; those of a pass at its expected duration."""
    switch_cycles: int
    """Changes of the transfer switches."""
    questions: int
    """How often the operator is waited for."""
    free_bytes: int | None
    """Free space where the file will be written, bytes; None where no output was named."""


def dry_run(rig: Rig, plan: Plan, *, output: Path | str | None = None) -> DryRun:
    """List, time, size and check a plan.

    Args:
        rig: the rig that it is meant for.
        plan: any plan.
        output: the session file that it would be written to, for the free space there.
    """
    listed = tuple(plan.steps(mosaic=rig.has_mosaic))
    found = problems(rig, listed)
    size = file_bytes(rig, listed)
    free: int | None = None
    if output is not None:
        try:
            free = free_bytes(Path(output).resolve())
        except OSError as error:
            found.append(f"{output} cannot be written ({error.strerror}): choose a folder that is there")
    if free is not None and size > free:
        found.append(
            f"the file takes up to {size / 1e6:.1f} MB and {free / 1e6:.1f} MB are free: write it to another disk"
        )
    return DryRun(
        steps=listed,
        seconds=sum(step_seconds(rig, listed)),
        bytes=size,
        limits_ok=not outside_limits(rig, listed),
        problems=tuple(found),
        warnings=tuple(_warnings(rig, listed)),
        planned=planned(listed),
        records=sum(
            pass_blocks(rig, step) if isinstance(step, RecordPass) else 1
            for step in listed
            if isinstance(step, (RecordSweeps, RecordSeconds, RecordPass))
        ),
        switch_cycles=switch_cycles(listed),
        questions=sum(isinstance(step, Ask) for step in listed),
        free_bytes=free,
    )


def _warnings(rig: Rig, listed: tuple[Step, ...]) -> Iterator[str]:
    """Places so far apart that targets inside the antennas' beam are ambiguous (thesis 5.3: a quarter wavelength)."""
    stops = sorted({step.x_m for step in listed if isinstance(step, MoveTo)})
    passes = [step for step in listed if isinstance(step, RecordPass)]
    if passes:
        speed = max(step.speed_m_s or rig.trolley.speed_m_s for step in passes)
        spacing = speed * rig.waveform.sweep_period_s
        advice = "run more slowly"
    elif len(stops) > 1:
        spacing = max(b - a for a, b in itertools.pairwise(stops))
        advice = "take smaller steps"
    else:
        return
    if not spacing > 0:
        return
    free = math.degrees(alias_free_angle_rad(spacing, rig.waveform.wavelength_m))
    if free < rig.geometry.beamwidth_deg / 2:
        yield (
            f"places {spacing * 100:.3g} cm apart show targets beyond {free:.0f} degrees from broadside at wrong places"
            f" as well (the beam reaches {rig.geometry.beamwidth_deg / 2:g}): {advice}, or look closer to broadside"
        )
