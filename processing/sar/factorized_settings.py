"""Which settings factorized back-projection needs for a tolerance, what error they leave, and what they cost."""

from __future__ import annotations

import math
from dataclasses import dataclass

from processing.errors import DataError
from processing.sar.factorized_plan import (
    BASE_PULSES,
    BRANCHES,
    MERGE_NANOSECONDS,
    PULSE_NANOSECONDS,
    Settings,
)
from processing.sar.planner import backprojection_error_db

STAGE_ERROR_DB = {
    Settings(1.6, 1.8): -60.0,
    Settings(1.8, 2.0): -69.0,
    Settings(2.0, 2.2): -76.0,
    Settings(2.2, 2.4): -83.0,
}
"""Error that one merging adds, dB, unweighted point targets; cheapest first. The tests measure them again."""

SAMPLES_PER_PIXEL = 1.8
"""Samples of a level in a pixel of an image with 1.25 pixels a cell, with margins, at oversamplings of 1.6 and 1.8."""


FIXED_SECONDS = 15e-3
"""Of planning, of tables and of the many small steps, whatever the size."""


@dataclass(frozen=True)
class FactorizedChoice:
    """Settings of factorized back-projection, and the error expected of them."""

    settings: Settings
    predicted_error_db: float


def settings_for(tolerance_db: float, pulses: int, oversampling: float) -> FactorizedChoice:
    """The cheapest settings whose expected error stays within a tolerance; the most exact where none does.

    Args:
        tolerance_db: largest error, dB below the image (negative).
        pulses: of the aperture.
        oversampling: range bins per resolution cell, which the exact parts are read from.

    Raises:
        DataError: the tolerance is no negative number, or there is less than one bin per cell.
    """
    if not tolerance_db < 0:
        raise DataError(f"a tolerance of {tolerance_db:g} dB is no error below the image", "give a negative number")
    offered = [
        FactorizedChoice(settings, expected_error_db(settings, pulses, oversampling)) for settings in STAGE_ERROR_DB
    ]
    return next((choice for choice in offered if choice.predicted_error_db <= tolerance_db), offered[-1])


def expected_error_db(settings: Settings, pulses: int, oversampling: float) -> float:
    """Error of some of the settings in :data:`STAGE_ERROR_DB`, dB; arguments as in :func:`settings_for`.

    Each fourfold number of pulses adds a merging; the exact parts add the error of reading profiles.
    """
    merged = 1 + max(0.0, math.log(max(pulses, 1) / BASE_PULSES, BRANCHES))
    read = 10 ** (backprojection_error_db("sinc8", oversampling) / 10)
    return 10 * math.log10(merged * 10 ** (STAGE_ERROR_DB[settings] / 10) + read)


def predicted_seconds(choice: FactorizedChoice, pixels: int, pulses: int, channels: int) -> float:
    """Expected core time for a far scene whose pixels suit its resolution."""
    merged = max(0.0, math.log(max(pulses, 1) / BASE_PULSES, BRANCHES))
    dense = choice.settings.angle_oversampling * choice.settings.range_oversampling / (1.6 * 1.8)
    each = PULSE_NANOSECONDS * BASE_PULSES + MERGE_NANOSECONDS * BRANCHES * merged
    return FIXED_SECONDS + 1e-9 * pixels * channels * (SAMPLES_PER_PIXEL * dense * each + MERGE_NANOSECONDS * BRANCHES)
