"""What steps cost: time, bytes, audio frames, changes of the switches."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from drivers.records import Channel
from polfuse_lab.plans.steps import (
    Ask,
    AutoExpose,
    Checkpoint,
    Expose,
    MoveTo,
    RecordPass,
    RecordSeconds,
    RecordSweeps,
    SelectChannel,
    Settle,
    StartTurn,
    Step,
    TurnPolarizer,
    TurnSource,
)
from polfuse_lab.rig import Rig

PERIOD_MARGIN = 1.06
"""True sweep periods are up to 5 % off nominal; a record is made long enough for that."""
EDGE_FRAMES = 64
"""An edge of the sync is measured from samples on both sides of it, which must be in the record too."""

# What a step costs besides what the rig file says: exchanges with the device, guard time of the audio port, turning.
_EXCHANGE_S = 0.03
_AUDIO_GUARD_S = 0.1
_FRAME_S = 0.05
_TURN_S = 0.6
_AUTO_FRAMES = 8
FILE_BYTES = 500_000
"""Of a file's own tables, at most."""
_ROW_BYTES = 400
_STEP_BYTES = 120
"""A step in the file's own list of steps."""
_FIXES_HZ = 50.0
"""Trolley fixes kept in a pass, 1/s, at most."""
_ITEM_BYTES = {"uint8": 1, "uint16": 2, "int16": 2, "int32": 4, "float32": 4}


def record_frames(rig: Rig, sweeps: int, sample_rate_hz: float) -> int:
    """Audio frames that hold ``sweeps`` whole up-ramps wherever the record begins, for periods up to 6 % too long."""
    return math.ceil((sweeps + 1) * rig.waveform.sweep_period_s * PERIOD_MARGIN * sample_rate_hz) + EDGE_FRAMES


def pass_seconds(rig: Rig, step: RecordPass) -> float:
    """Expected duration of a run along the rail, s; at the rig file's speed where somebody pushes the trolley."""
    return abs(step.x_to_m - step.x_from_m) / (step.speed_m_s or rig.trolley.speed_m_s)


def pass_blocks(rig: Rig, step: RecordPass) -> int:
    """Records that a run along the rail is expected to be cut into."""
    return max(1, math.ceil(pass_seconds(rig, step) / step.block_s - 1e-9)) if step.block_s > 0 else 1


def audio_frames(rig: Rig, step: Step) -> int:
    """Audio frames that a step is expected to record, at the rig file's sample rate."""
    rate = rig.radar.sample_rate_hz
    match step:
        case RecordSweeps():
            return record_frames(rig, step.sweeps, rate)
        case RecordSeconds():
            return math.ceil(step.seconds * rate)
        case RecordPass():
            return math.ceil(pass_seconds(rig, step) * rate)
        case _:
            return 0


def largest_record_frames(rig: Rig, listed: Iterable[Step], sample_rate_hz: float) -> int:
    """Audio frames of the longest record among ``listed``, which becomes one block of the file; at least one."""
    longest = 1
    for step in listed:
        match step:
            case RecordSweeps():
                longest = max(longest, record_frames(rig, step.sweeps, sample_rate_hz))
            case RecordSeconds():
                longest = max(longest, math.ceil(step.seconds * sample_rate_hz))
            case RecordPass():
                longest = max(longest, math.ceil(step.block_s * sample_rate_hz))
    return longest


def step_seconds(rig: Rig, listed: Iterable[Step]) -> Iterator[float]:
    """Expected duration of each step, s; an operator is taken to answer at once."""
    x_m = 0.0
    exposure_s = rig.camera.exposure_s if rig.camera else 0.0
    turning_s = 0.0
    """What is left of a turn that has been begun."""
    for step in listed:
        spent = _EXCHANGE_S
        match step:
            case MoveTo():
                spent = abs(step.x_m - x_m) / rig.trolley.speed_m_s + _EXCHANGE_S
                x_m = step.x_m
            case SelectChannel():
                spent = rig.switches.settle_s + _EXCHANGE_S
            case Settle():
                spent = step.seconds
            case RecordSweeps() | RecordSeconds():
                spent = audio_frames(rig, step) / rig.radar.sample_rate_hz + _AUDIO_GUARD_S
            case RecordPass():
                spent = pass_seconds(rig, step) + _AUDIO_GUARD_S
                x_m = step.x_to_m
            case TurnPolarizer():
                spent = turning_s if turning_s else _TURN_S
                turning_s = 0.0
            case TurnSource():
                spent = _TURN_S
            case AutoExpose():
                spent = len(step.angles_rad) * _TURN_S + _AUTO_FRAMES * (exposure_s + _FRAME_S)
            case Expose():
                spent = step.frames * frame_pace_s(rig)
            case Checkpoint() | Ask():
                pass
        yield spent
        if isinstance(step, StartTurn):
            turning_s = _TURN_S
        elif turning_s:
            turning_s = max(turning_s - spent, _EXCHANGE_S)


def item_bytes(rig: Rig) -> int:
    """Bytes of one input's audio sample."""
    return _ITEM_BYTES.get(str(rig.radar.options.get("sample_format", "int16")), 4)


def frame_pace_s(rig: Rig) -> float:
    """Time from one camera frame to the next, s."""
    return (rig.camera.exposure_s if rig.camera else 0.0) + _FRAME_S


def file_bytes(rig: Rig, listed: Iterable[Step]) -> int:
    """Upper bound of the session file's size (as if nothing could be compressed), bytes."""
    item = item_bytes(rig)
    total = FILE_BYTES
    for step in listed:
        total += 2 * item * audio_frames(rig, step) + _STEP_BYTES
        if isinstance(step, Expose) and rig.camera is not None:
            pixel = _ITEM_BYTES[rig.camera.counts_dtype]
            total += step.frames * (rig.camera.width_px * rig.camera.height_px * pixel + _ROW_BYTES)
        elif isinstance(step, RecordPass):
            seconds = pass_seconds(rig, step)
            total += math.ceil((seconds * _FIXES_HZ + pass_blocks(rig, step)) * _ROW_BYTES)
        elif not isinstance(step, (Settle, Checkpoint)):
            total += _ROW_BYTES
    return total


def switch_cycles(listed: Iterable[Step]) -> int:
    """How often the two transfer switches change together (each wears with every change); the first settings count."""
    cycles = 0
    now: Channel | None = None
    for step in listed:
        if isinstance(step, SelectChannel):
            cycles += int(now is None or now.transmit != step.channel.transmit)
            cycles += int(now is None or now.receive != step.channel.receive)
            now = step.channel
    return cycles
