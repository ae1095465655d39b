"""Plans as generators of plain steps."""

from __future__ import annotations

import math
from collections.abc import Iterator

from drivers.records import Channel
from polfuse_lab.plans.model import OpticsPlan, Plan
from polfuse_lab.plans.steps import (
    AutoExpose,
    Checkpoint,
    Expose,
    MoveTo,
    RecordSweeps,
    SelectChannel,
    Settle,
    Step,
    TurnPolarizer,
)


def steps(plan: Plan, *, mosaic: bool = False) -> Iterator[Step]:
    """Yield a plan's steps, in the order in which they are carried out.

    Args:
        plan: what to collect.
        mosaic: the camera sees all polarizer angles at once: nothing is turned, and frames are taken once.
    """
    positions = plan.positions_m
    centre = min(range(len(positions)), key=lambda i: abs(positions[i]))
    for index, x_m in enumerate(positions):
        if plan.kind == "rail_sar":
            yield MoveTo(x_m, index)
            if plan.move_settle_s:
                yield Settle(plan.move_settle_s)
        for name in plan.channels:
            channel = Channel[name]
            yield SelectChannel(channel)
            yield RecordSweeps(plan.sweeps_per_channel, index, channel)
        if plan.optics is not None and index == centre:
            yield from _mosaic_series(plan.optics) if mosaic else _polarizer_series(plan.optics)
        yield Checkpoint(index)


def _mosaic_series(optics: OpticsPlan) -> Iterator[Step]:
    if optics.auto_exposure:
        yield AutoExpose(())
    yield Expose(optics.frames_per_angle, 0.0)


def _polarizer_series(optics: OpticsPlan) -> Iterator[Step]:
    if optics.auto_exposure:
        yield AutoExpose(tuple(math.radians(angle_deg) for angle_deg in optics.angles_deg))
    for angle_deg in optics.angles_deg:
        angle = math.radians(angle_deg)
        yield TurnPolarizer(angle)
        if optics.settle_s:
            yield Settle(optics.settle_s)
        yield Expose(optics.frames_per_angle, angle)
