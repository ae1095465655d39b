"""What a plan will do, how long it takes and how large its file gets, without touching a device."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from polfuse_lab.plans.generate import steps
from polfuse_lab.plans.model import Plan
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
from polfuse_lab.rig import Rig

PERIOD_MARGIN = 1.06
"""True sweep periods are up to 5 % off nominal; a record is made long enough for that."""
EDGE_FRAMES = 64
"""An edge of the sync is measured from samples on both sides of it, which must be in the record too."""
LIMIT_TOLERANCE_M = 1e-6

# What a step costs besides what the rig file says: exchanges with the device, guard time of the audio port, turning.
_EXCHANGE_S = 0.03
_AUDIO_GUARD_S = 0.1
_FRAME_S = 0.05
_TURN_S = 0.6
_AUTO_FRAMES = 8
_FILE_BYTES = 500_000
_ROW_BYTES = 400
_ITEM_BYTES = {"uint8": 1, "uint16": 2, "int16": 2, "int32": 4, "float32": 4}


@dataclass(frozen=True)
class DryRun:
    """The outcome of a dry run."""

    steps: tuple[Step, ...]
    seconds: float
    """Expected duration, s."""
    bytes: int
    """Upper bound of the file's size (as if nothing could be compressed), bytes."""
    limits_ok: bool
    """Whether every position can be reached."""
    problems: tuple[str, ...]
    """Why the plan cannot be carried out with this rig, one sentence each; empty when it can."""


def dry_run(rig: Rig, plan: Plan) -> DryRun:
    """List, time, size and check a plan."""
    listed = tuple(steps(plan, mosaic=rig.has_mosaic))
    half = rig.trolley.length_m / 2
    outside = [step.x_m for step in listed if isinstance(step, MoveTo) and abs(step.x_m) > half + LIMIT_TOLERANCE_M]
    problems = []
    if outside:
        problems.append(
            f"{len(outside)} positions are beyond the rail's {-half:g} .. {half:g} m (farthest"
            f" {max(outside, key=abs):g} m): shorten aperture_m or correct trolley.length_m"
        )
    if plan.optics is not None and rig.camera is None:
        problems.append("the plan has [optics] and the rig has no camera and polarizer: add them or leave it out")
    return DryRun(listed, sum(step_seconds(rig, listed)), _bytes(rig, listed), not outside, tuple(problems))


def record_frames(rig: Rig, sweeps: int, sample_rate_hz: float) -> int:
    """Audio frames that hold ``sweeps`` whole up-ramps wherever the record begins, for periods up to 6 % too long."""
    return math.ceil((sweeps + 1) * rig.waveform.sweep_period_s * PERIOD_MARGIN * sample_rate_hz) + EDGE_FRAMES


def step_seconds(rig: Rig, listed: Iterable[Step]) -> Iterator[float]:
    """Expected duration of each step, s."""
    x_m = 0.0
    for step in listed:
        match step:
            case MoveTo():
                yield abs(step.x_m - x_m) / rig.trolley.speed_m_s + _EXCHANGE_S
                x_m = step.x_m
            case SelectChannel():
                yield rig.switches.settle_s + _EXCHANGE_S
            case Settle():
                yield step.seconds
            case RecordSweeps():
                rate = rig.radar.sample_rate_hz
                yield record_frames(rig, step.sweeps, rate) / rate + _AUDIO_GUARD_S
            case TurnPolarizer():
                yield _TURN_S
            case AutoExpose():
                exposure = rig.camera.exposure_s if rig.camera else 0.0
                yield len(step.angles_rad) * _TURN_S + _AUTO_FRAMES * (exposure + _FRAME_S)
            case Expose():
                exposure = rig.camera.exposure_s if rig.camera else 0.0
                yield step.frames * (exposure + _FRAME_S)
            case _:
                yield _EXCHANGE_S


def _bytes(rig: Rig, listed: Iterable[Step]) -> int:
    item = _ITEM_BYTES.get(str(rig.radar.options.get("sample_format", "int16")), 4)
    total = _FILE_BYTES
    for step in listed:
        if isinstance(step, RecordSweeps):
            total += 2 * item * record_frames(rig, step.sweeps, rig.radar.sample_rate_hz) + _ROW_BYTES
        elif isinstance(step, Expose) and rig.camera is not None:
            pixel = _ITEM_BYTES[rig.camera.counts_dtype]
            total += step.frames * (rig.camera.width_px * rig.camera.height_px * pixel + _ROW_BYTES)
        elif not isinstance(step, (Settle, Checkpoint)):
            total += _ROW_BYTES
    return total
