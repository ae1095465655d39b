"""What every planner does with a tolerance: refuse what is none, take the cheapest that keeps it, and say so."""

from __future__ import annotations

import math
from collections.abc import Sequence

from processing.errors import DataError

EQUAL_DB = 0.5
"""Where nothing keeps the tolerance: what is gained by less than that is not worth its time."""


def check_tolerance(tolerance_db: float, below: str) -> None:
    """Raise :class:`DataError` for a tolerance that is no negative number of dB; ``below`` says what it is held to."""
    if not (tolerance_db < 0 and math.isfinite(tolerance_db)):
        raise DataError(f"a tolerance of {tolerance_db:g} dB is no error below the {below}", "give a negative number")


def cheapest_within(errors_db: Sequence[float], tolerance_db: float, safety_db: float) -> int:
    """Index of what is to be taken of expected errors, cheapest first, dB.

    It is the first that stays below the tolerance by the safety; where none does, the first of those that are as good
    as the best (:data:`EQUAL_DB`).
    """
    limit = tolerance_db - safety_db
    if not any(error <= limit for error in errors_db):
        limit = min(errors_db) + EQUAL_DB
    return next(index for index, error in enumerate(errors_db) if error <= limit)


def reason(error_db: float, errors_db: Sequence[float], tolerance_db: float, *, kept: bool) -> str:
    """Why one with this expected error was taken, in a few words."""
    if kept:
        return f"the cheapest within {tolerance_db:g} dB"
    if error_db > min(errors_db):
        return f"nothing on offer keeps {tolerance_db:g} dB; none is better by {EQUAL_DB:g} dB"
    return f"nothing on offer keeps {tolerance_db:g} dB: the most exact"
