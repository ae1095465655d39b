"""Why steps cannot be carried out with a rig: everything at once, before the first move."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from drivers.records import Channel
from polfuse_lab.plans.costs import pass_blocks
from polfuse_lab.plans.listing import planned
from polfuse_lab.plans.steps import (
    PASS_POSITIONS,
    AutoExpose,
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

LIMIT_TOLERANCE_M = 1e-6
ANGLE_TOLERANCE_RAD = 1e-6
SHORTEST_BLOCK_S = 0.1
PUSHED = ("by_hand", "encoder")
"""Drivers of trolleys that a person pushes."""
NO_FIXES_UNDER_WAY = ("by_hand",)
"""Drivers of trolleys that do not say where they are while they move."""


def outside_limits(rig: Rig, listed: Iterable[Step]) -> list[float]:
    """Places beyond the rail that the trolley is sent to, m, each once."""
    half = rig.trolley.length_m / 2
    places: set[float] = set()
    for step in listed:
        match step:
            case MoveTo():
                places.add(step.x_m)
            case RecordPass():
                places |= {step.x_from_m, step.x_to_m}
    return sorted(x_m for x_m in places if not abs(x_m) <= half + LIMIT_TOLERANCE_M)


def problems(rig: Rig, listed: tuple[Step, ...]) -> list[str]:
    """Why ``listed`` cannot be carried out with ``rig``, one sentence each; of equal ones the first."""
    found = []
    if outside := outside_limits(rig, listed):
        half = rig.trolley.length_m / 2
        found.append(
            f"{len(outside)} positions are beyond the rail's {-half:g} .. {half:g} m (farthest"
            f" {max(outside, key=abs):g} m): shorten aperture_m or correct trolley.length_m"
        )
    found += _missing_devices(rig, listed)
    seen: dict[str, tuple[int, int]] = {}
    for number, sentence in _by_step(rig, listed):
        first, count = seen.get(sentence, (number, 0))
        seen[sentence] = first, count + 1
    for sentence, (first, count) in seen.items():
        more = f" and {count - 1} more" if count > 1 else ""
        found.append(f"step {first}{more}: {sentence}")
    summed = planned(listed)
    if not summed.records and not summed.frames:
        found.append("the plan records nothing: it has no step that records the radar or takes a frame")
    return found


def _missing_devices(rig: Rig, listed: tuple[Step, ...]) -> Iterator[str]:
    needed = planned(listed).devices
    if "camera" in needed and rig.camera is None:
        yield "the plan takes camera frames and the rig has no camera and polarizer: add them or leave [optics] out"
    elif "polarizer" in needed and rig.polarizer is None:
        yield "the plan turns the polarizer and the rig has none: add [polarizer] to the rig file"
    if "source_polarizer" in needed and rig.source_polarizer is None:
        yield "the plan turns the light source's polarizer and the rig has none: add [source_polarizer] to the rig file"
    passes = [step for step in listed if isinstance(step, RecordPass)]
    driver = rig.trolley.driver
    if any(step.speed_m_s is not None for step in passes) and driver in PUSHED:
        yield f'the trolley is pushed by hand ({driver}) and cannot keep a speed: use drive = "encoder"'
    if any(step.speed_m_s is None for step in passes) and driver in NO_FIXES_UNDER_WAY:
        yield f"the trolley ({driver}) does not say where it is while it is pushed: use an encoder"


def _by_step(rig: Rig, listed: tuple[Step, ...]) -> Iterator[tuple[int, str]]:
    """Step number (from 1) and what is wrong with it."""
    channel: Channel | None = None
    x_m: float | None = None
    angle: float | None = None
    begun: float | None = None
    taken = _Taken()
    for number, step in enumerate(listed, start=1):
        for sentence in _numbers(step):
            yield number, sentence
        match step:
            case MoveTo():
                x_m = step.x_m
            case SelectChannel():
                channel = step.channel
            case RecordSweeps() | RecordSeconds() | RecordPass():
                if channel != step.channel:
                    stand = "have not been set" if channel is None else f"stand at {channel.name}"
                    yield number, f"records {step.channel.name} while the switches {stand}: select it before"
                if isinstance(step, RecordPass):
                    if x_m is None or abs(step.x_from_m - x_m) > LIMIT_TOLERANCE_M:
                        yield number, "a pass begins where the trolley does not stand: move it there before"
                    x_m = step.x_to_m
                    if step.first_position % PASS_POSITIONS or pass_blocks(rig, step) > PASS_POSITIONS:
                        yield number, f"a pass has at most {PASS_POSITIONS} records, numbered from a multiple of that"
                if not taken.add(step):
                    yield number, f"records {step.channel.name} a second time under the same position number"
            case StartTurn():
                begun = step.angle_rad
                angle = None
            case TurnPolarizer():
                if begun is not None and abs(begun - step.angle_rad) > ANGLE_TOLERANCE_RAD:
                    yield number, "the polarizer is sent elsewhere while it still turns: wait for the first turn"
                begun, angle = None, step.angle_rad
            case AutoExpose():
                begun = angle = None
            case Expose():
                if begun is not None:
                    yield number, "takes frames while the polarizer turns: wait for it with TurnPolarizer"
                elif angle is not None and abs(angle - step.angle_rad) > ANGLE_TOLERANCE_RAD:
                    yield (
                        number,
                        (
                            f"takes frames for {math.degrees(step.angle_rad):g} degrees while the polarizer stands at"
                            f" {math.degrees(angle):g}"
                        ),
                    )


class _Taken:
    """Position numbers of which a channel has been recorded; those of passes in whole blocks of numbers."""

    def __init__(self) -> None:
        self._positions: set[tuple[int, Channel]] = set()
        self._blocks: set[tuple[int, Channel]] = set()
        self._passes: set[tuple[int, Channel]] = set()

    def add(self, step: RecordSweeps | RecordSeconds | RecordPass) -> bool:
        """Take a record's numbers; whether they were free."""
        if isinstance(step, RecordPass):
            block = step.first_position // PASS_POSITIONS, step.channel
            free = block not in self._passes | self._blocks
            self._passes.add(block)
            return free
        block, place = (step.position // PASS_POSITIONS, step.channel), (step.position, step.channel)
        free = place not in self._positions and block not in self._passes
        self._positions.add(place)
        self._blocks.add(block)
        return free


def _numbers(step: Step) -> Iterator[str]:
    """Numbers that make no sense, whatever the rig."""
    match step:
        case RecordSweeps() if step.sweeps < 1:
            yield f"records {step.sweeps} sweeps: record at least one"
        case RecordSeconds() if step.seconds <= 0:
            yield f"records {step.seconds:g} s: record longer than 0 s"
        case RecordPass() if step.block_s < SHORTEST_BLOCK_S or (step.speed_m_s is not None and step.speed_m_s <= 0):
            yield (
                f"runs at {step.speed_m_s} m/s in blocks of {step.block_s:g} s: the speed is above 0 and a block lasts"
                f" {SHORTEST_BLOCK_S:g} s or longer"
            )
        case RecordPass() if step.x_from_m == step.x_to_m:
            yield "a pass ends where it begins: give it a length"
        case Settle() if step.seconds < 0:
            yield f"waits {step.seconds:g} s: wait 0 s or longer"
        case Expose() if step.frames < 1:
            yield f"takes {step.frames} frames: take at least one"
    if isinstance(step, (MoveTo, RecordSweeps, RecordSeconds)) and step.position < 0:
        yield f"has position number {step.position}: numbers begin at 0"
    if isinstance(step, TurnSource) and abs(step.angle_rad) > 4 * math.pi:
        yield "turns the source's polarizer by more than two turns: angles are in radians"
