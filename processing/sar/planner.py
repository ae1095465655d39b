"""Which method and interpolator to focus with: the cheapest whose measured error stays within the tolerance.

Errors are root mean square over the image, relative to the exact float64 matched filter, and were measured on the
thesis's rail (2.4 GHz, 80 MHz unweighted, 10 ft in 2 in steps, targets from 5 to 40 m); unweighted data fill their band
to its edges, which is the worst case. The tests measure every entry again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from processing.errors import DataError
from processing.sar.interpolation import taps_of

OVERSAMPLINGS = (1, 2, 4, 8, 16)
"""Range bins per resolution cell at which back-projection was measured."""

BACKPROJECTION_ERROR_DB = {
    "linear": (-9.5, -20.4, -32.1, -44.2, -56.2),
    "cubic": (-11.4, -30.4, -51.3, -71.0, -89.3),
    "lagrange4": (-11.4, -31.1, -54.1, -77.9, -101.9),
    "sinc8": (-16.4, -67.4, -93.7, -105.5, -114.1),
    "sinc16": (-21.0, -122.9, -136.8, -139.4, -139.7),
}
"""Error of the compiled kernel, dB, by interpolator and range oversampling; complex64 ends it at -140 dB."""

MIGRATION_ANGLES_DEG = (40.0, 71.0, 80.0, 90.0)
"""Largest angles from broadside at which range migration was measured; nothing is promised at grazing angles."""

MIGRATION_ERROR_DB = {False: (-65.0, -61.0, -55.0, 0.0), True: (-64.0, -50.0, -34.0, 0.0)}
"""Error of range migration against back-projection, dB, without and with compensation of the antennas' pattern."""

NANOSECONDS = {
    "linear": (9.0, 4.0),
    "cubic": (10.0, 4.5),
    "lagrange4": (10.0, 4.5),
    "sinc8": (13.0, 6.5),
    "sinc16": (19.0, 10.5),
}
"""Core time of back-projection for one pixel and pulse: once, and for each channel (2.5 GHz server core)."""

PATTERN_NANOSECONDS = 21.0
"""Core time of pattern compensation for one pixel and pulse."""

MIGRATION_NANOSECONDS = (190.0, 140.0)
"""Core time of range migration for one cell of the two-dimensional spectrum: once, and for each channel."""


@dataclass(frozen=True)
class Task:
    """What is to be focused, as far as the choice depends on it."""

    pixels: int
    pulses: int
    channels: int
    oversampling: float
    """Range bins per resolution cell."""
    wavelength_m: float
    furthest_m: float
    """Largest range in the image."""
    widest_rad: float
    """Largest angle from broadside in the image."""
    residual_m: float | None
    """Root mean square deviation from an even, straight rail; None where there is no such rail."""
    compensated: bool
    """Whether the antennas' pattern is compensated."""


@dataclass(frozen=True)
class Choice:
    """A way to focus, and why."""

    method: str
    """``"rma"`` (range migration), ``"bp"`` (back-projection) or ``"reference"``."""
    interpolator: str
    """Of back-projection; ``"sinc8"`` is range migration's own."""
    predicted_error_db: float
    seconds: float
    """Expected core time."""
    reason: str


def backprojection_error_db(interpolator: str, oversampling: float) -> float:
    """Expected error of back-projection, dB, between the measured oversamplings by interpolation.

    Raises:
        DataError: unknown interpolator, or less than one bin per cell.
    """
    taps_of(interpolator)
    if not oversampling >= 1 - 1e-9:
        raise DataError(f"{oversampling:g} range bins per cell lose information", "range with an oversampling of 2 up")
    octaves = np.log2(OVERSAMPLINGS)
    return float(np.interp(math.log2(max(oversampling, 1.0)), octaves, BACKPROJECTION_ERROR_DB[interpolator]))


def migration_error_db(task: Task) -> float:
    """Expected error of range migration, dB: its own by angle, and that of uneven positions (two-way phase)."""
    own = np.interp(math.degrees(task.widest_rad), MIGRATION_ANGLES_DEG, MIGRATION_ERROR_DB[task.compensated])
    uneven = 4 * math.pi / task.wavelength_m * (task.residual_m or 0.0)
    return float(10 * np.log10(10 ** (own / 10) + uneven**2))


def choices(task: Task) -> list[Choice]:
    """Everything that can be done, cheapest first."""
    offered = []
    for interpolator, (once, each) in NANOSECONDS.items():
        pattern = PATTERN_NANOSECONDS if task.compensated else 0.0
        seconds = 1e-9 * task.pixels * task.pulses * (once + pattern + each * task.channels)
        error = backprojection_error_db(interpolator, task.oversampling)
        offered.append(Choice("bp", interpolator, error, seconds, ""))
    if task.residual_m is not None:
        k = 4 * math.pi / task.wavelength_m
        along = k * math.sin(task.widest_rad) * 2 * task.furthest_m / math.pi
        across = k * (1 - math.cos(task.widest_rad) * 0.8) * 1.5 * task.furthest_m / (2 * math.pi)
        once, each = MIGRATION_NANOSECONDS
        seconds = 1e-9 * along * across * (once + each * task.channels)
        offered.append(Choice("rma", "sinc8", migration_error_db(task), seconds, ""))
    return sorted(offered, key=lambda choice: (choice.seconds, choice.predicted_error_db))


def choose(task: Task, tolerance_db: float, method: str = "auto") -> Choice:
    """The cheapest way whose predicted error is within the tolerance; the most exact where none is.

    Args:
        task: what is to be focused.
        tolerance_db: largest error, dB (negative).
        method: ``"auto"``, or the one to use: ``"rma"``, ``"bp"``, ``"reference"``.

    Raises:
        DataError: unknown method, a tolerance that is no negative number, or range migration without an even rail.
    """
    if method not in ("auto", "rma", "bp", "reference"):
        raise DataError(f"there is no focusing method {method!r}", "choose auto, rma, bp or reference")
    if not tolerance_db < 0:
        raise DataError(f"a tolerance of {tolerance_db:g} dB is no error below the image", "give a negative number")
    if method == "reference":
        error = backprojection_error_db("sinc16", task.oversampling)
        seconds = 2.5e-6 * task.pixels * task.pulses
        return Choice("reference", "sinc16", error, seconds, "asked for: plain float64 back-projection")
    offered = [choice for choice in choices(task) if method in ("auto", choice.method)]
    if not offered:
        raise DataError("positions are not even enough for range migration", "focus by back-projection")
    fitting = [choice for choice in offered if choice.predicted_error_db <= tolerance_db]
    if fitting:
        best, why = fitting[0], f"cheapest within {tolerance_db:g} dB"
    else:
        best = min(offered, key=lambda choice: choice.predicted_error_db)
        why = f"nothing on offer reaches {tolerance_db:g} dB at {task.oversampling:g} bins per cell: the most exact"
    asked = "" if method == "auto" else f"{method} asked for; "
    return Choice(best.method, best.interpolator, best.predicted_error_db, best.seconds, asked + why)
