"""Find an exposure that uses the sensor well and saturates at none of the polarizer's angles, and keep it.

The search is a generator that asks for looks and is told what they showed, so that whoever drives it, a script or a
scheduler that can be aborted, takes the frames and turns the polarizer in its own way. It relies on counts above black
being proportional to the exposure: an unsaturated look at each angle tells the brightest, and the rest confirms it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.contracts import Camera, ExposureControl
from drivers.errors import DeviceTimeout

LARGEST_STEP = 32.0
"""The exposure changes by no more than this factor between two looks: far extrapolation amplifies noise."""
SATURATED_STEP = 4.0
"""A saturated look tells only that the exposure is too long."""
FAINT = 0.02
"""Below this part of the range a look is too faint to extrapolate from with confidence."""
MOST_LOOKS = 40


@dataclass(frozen=True)
class ExposureGoal:
    """What is looked for. Levels are parts of the range between black and saturation."""

    limits_s: tuple[float, float]
    """Shortest and longest exposure, s."""
    saturation_counts: int
    """Counts at and above which a pixel is saturated."""
    black_level_counts: float = 0.0
    """Counts without light."""
    target: float = 0.75
    """Level that the brightest pixel of the brightest angle is brought to."""
    tolerance: float = 0.15
    """How far from the target it may end."""

    def __post_init__(self) -> None:
        low, high = self.limits_s
        if not 0 < low <= high < float("inf"):
            raise ValueError(f"limits_s: found {self.limits_s}, allowed: two positive times, the shorter one first")
        if not 0 <= self.black_level_counts < self.saturation_counts:
            raise ValueError(f"black_level_counts: found {self.black_level_counts}, allowed: below saturation_counts")
        if not (0 < self.tolerance < self.target and self.target + self.tolerance < 1):
            raise ValueError(f"target: found {self.target} +- {self.tolerance}, allowed: between 0 and 1")

    def level(self, image: NDArray[np.unsignedinteger]) -> float | None:
        """Level of a frame's brightest pixel; None when it is saturated."""
        peak = float(image.max())
        if peak >= self.saturation_counts:
            return None
        return (peak - self.black_level_counts) / (self.saturation_counts - self.black_level_counts)


@dataclass(frozen=True)
class Look:
    """A frame to be taken: at which angle (an index), with what exposure."""

    angle: int
    exposure_s: float


@dataclass(frozen=True)
class Seen:
    """What a look showed."""

    exposure_s: float
    """What the camera made of the exposure asked for, s."""
    level: float | None
    """Level of the brightest pixel; None when it was saturated."""


@dataclass(frozen=True)
class ExposureFound:
    """How a search ended. The camera stands at ``exposure_s``."""

    exposure_s: float
    level: float | None
    """Level at the brightest angle; None when it is saturated even so."""
    looks: int
    problem: str = ""
    """Why the goal was not reached, in one sentence; empty when it was."""


def search(goal: ExposureGoal, start_s: float, angles: int) -> Generator[Look, Seen, ExposureFound]:
    """Look for the exposure: yields looks, is sent what they showed, returns what was found.

    Args:
        goal: what is looked for.
        start_s: exposure to begin with, s.
        angles: number of polarizer angles (1 for a camera that sees them all at once).

    Raises:
        ValueError: no angle.
    """
    if angles < 1:
        raise ValueError(f"angles: found {angles}, allowed: 1 or more")
    low, high = goal.limits_s
    exposure_s = min(max(start_s, low), high)
    rates = [0.0] * angles
    looks = 0
    seen = Seen(exposure_s, None)

    # Once round all angles. The exposure found at one is kept for the next; only saturation and faintness change it.
    for angle in range(angles):
        while True:
            seen = yield Look(angle, exposure_s)
            looks += 1
            if seen.level is None:
                if seen.exposure_s <= low * 1.01 or looks >= MOST_LOOKS:
                    return _too_bright(seen, looks)
                exposure_s = max(seen.exposure_s / SATURATED_STEP, low)
            elif seen.level < FAINT and seen.exposure_s < high * 0.99 and max(rates) == 0.0 and looks < MOST_LOOKS:
                # Fainter than an angle before is as it should be; the first must show something.
                exposure_s = min(seen.exposure_s * LARGEST_STEP / 2, high)
            else:
                rates[angle] = max(seen.level, 0.0) / seen.exposure_s
                exposure_s = seen.exposure_s
                break

    brightest = max(range(angles), key=rates.__getitem__)
    while looks < MOST_LOOKS:
        wanted = goal.target / rates[brightest] if rates[brightest] > 0 else high
        step = min(max(wanted / exposure_s, 1 / LARGEST_STEP), LARGEST_STEP)
        exposure_s = min(max(exposure_s * step, low), high)
        seen = yield Look(brightest, exposure_s)
        looks += 1
        if seen.level is None:
            if seen.exposure_s <= low * 1.01:
                return _too_bright(seen, looks)
            # Brighter than it was, or not proportional: begin again below.
            rates[brightest] = max(rates[brightest], 1.0 / seen.exposure_s) * 2
            continue
        if abs(seen.level - goal.target) <= goal.tolerance:
            return ExposureFound(seen.exposure_s, seen.level, looks)
        if seen.level < goal.target and seen.exposure_s >= high * 0.99:
            return ExposureFound(
                seen.exposure_s,
                seen.level,
                looks,
                f"too dark: the brightest pixel reaches {100 * seen.level:.0f} % of the range with the longest exposure"
                f" ({seen.exposure_s:g} s): open the iris, add light or gain",
            )
        if seen.level > goal.target and seen.exposure_s <= low * 1.01:
            return ExposureFound(
                seen.exposure_s,
                seen.level,
                looks,
                f"nearly too bright: {100 * seen.level:.0f} % of the range with the shortest exposure"
                f" ({seen.exposure_s:g} s): close the iris or add a neutral-density filter",
            )
        rates[brightest] = max(seen.level, 1e-6) / seen.exposure_s
        exposure_s = seen.exposure_s
    return ExposureFound(
        seen.exposure_s, seen.level, looks, f"the light does not stand still: no exposure held in {looks} frames"
    )


def auto_exposure(
    camera: Camera,
    control: ExposureControl,
    goal: ExposureGoal,
    angles_rad: Sequence[float] = (),
    *,
    start_s: float,
    turn: Callable[[float], None] = lambda angle_rad: None,
    timeout_s: float = 10.0,
) -> ExposureFound:
    """Find an exposure with a camera and something that turns the polarizer; blocks until it is found.

    Args:
        camera: an open camera.
        control: the same camera's exposure.
        goal: what is looked for; its limits must be within the camera's.
        angles_rad: polarizer angles; none for a camera that sees them all at once.
        start_s: exposure to begin with, s.
        turn: turns the polarizer to an angle and returns when it stands.
        timeout_s: longest wait for one frame beyond its exposure, s.

    Raises:
        DeviceError: camera or polarizer failed.
    """
    asking = search(goal, start_s, max(len(angles_rad), 1))
    at: int | None = None
    seen: Seen | None = None
    while True:
        try:
            look = next(asking) if seen is None else asking.send(seen)
        except StopIteration as end:
            found: ExposureFound = end.value
            return found
        if angles_rad and look.angle != at:
            turn(angles_rad[look.angle])
            at = look.angle
        exposure_s = control.set_exposure(look.exposure_s)
        camera.trigger()
        deadline = time.monotonic() + exposure_s + timeout_s
        while (frame := camera.poll()) is None:
            if time.monotonic() > deadline:
                raise DeviceTimeout("delivered no frame", where="camera", advice="check its cable and trigger")
            time.sleep(0.001)
        seen = Seen(exposure_s, goal.level(frame.image))


def _too_bright(seen: Seen, looks: int) -> ExposureFound:
    return ExposureFound(
        seen.exposure_s,
        None,
        looks,
        f"too bright: saturated even with an exposure of {seen.exposure_s:g} s: close the iris or add a neutral-density"
        " filter",
    )
