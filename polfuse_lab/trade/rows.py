"""One measured setting, the front of those that nothing beats, and which of them a tolerance asks for."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from polfuse_lab.tolerances import TOLERANCES_DB

Result = TypeVar("Result")

EXACT_DB = -320.0
"""What stands for no error at all, dB: below what float64 tells apart."""


LONG_ENOUGH_S, MOST_ROUNDS = 0.1, 7
"""Processor time for which short work is repeated, and how often at most."""


@dataclass(frozen=True)
class Row:
    """One setting of one task."""

    task: str
    setting: str
    seconds: float
    """Processor time of one run on one core of this machine."""
    error_db: float
    """Root mean square error against the task's reference, dB below it; for storage the size over the raw size, dB."""
    predicted_error_db: float | None = None
    """As the planner expects it, where one plans this."""
    pareto: bool = False
    """Whether no other setting of the task is both faster and better."""
    chosen_for: tuple[str, ...] = ()
    """Tolerances by name for which it is the cheapest."""


def timed(work: Callable[[], Result], rounds: int = 3) -> tuple[float, Result]:
    """Least processor time of some rounds, after one that may compile, and what the work returned.

    Short work is done again until :data:`LONG_ENOUGH_S` have passed: caches fill, and other programs come and go.
    """
    result = work()
    seconds, passed, done = math.inf, 0.0, 0
    while done < rounds or (passed < LONG_ENOUGH_S and done < MOST_ROUNDS):
        begun = time.process_time()
        result = work()
        took = time.process_time() - begun
        seconds, passed, done = min(seconds, took), passed + took, done + 1
    return seconds, result


def relative_db(found: ArrayLike, true: ArrayLike) -> float:
    """Root mean square of what differs over that of the truth, dB; pixels undefined in either are left out."""
    a, b = np.asarray(found), np.asarray(true)
    defined = np.isfinite(a) & np.isfinite(b)
    difference = float(np.linalg.norm((a[defined].astype(np.complex128) - b[defined]).ravel()))
    scale = float(np.linalg.norm(b[defined].ravel()))
    return float(20 * np.log10(max(difference / max(scale, 1e-300), 10 ** (EXACT_DB / 20))))


def pareto(rows: Iterable[Row]) -> list[Row]:
    """All rows of one task, those marked that nothing beats in both time and error; ties go to the first."""
    given = list(rows)

    def beaten(one: Row, place: int) -> bool:
        return any(
            other.seconds <= one.seconds
            and other.error_db <= one.error_db
            and ((other.seconds, other.error_db) != (one.seconds, one.error_db) or n < place)
            for n, other in enumerate(given)
            if n != place
        )

    return [replace(row, pareto=not beaten(row, place)) for place, row in enumerate(given)]


def settle(rows: Iterable[Row], kind: str) -> list[Row]:
    """All rows of one task with the front marked and, for each tolerance, the cheapest row that keeps it."""
    marked = pareto(rows)
    chosen: dict[int, list[str]] = {}
    for name, limit in TOLERANCES_DB[kind].items():
        fitting = [n for n, row in enumerate(marked) if row.error_db <= limit]
        if fitting:
            chosen.setdefault(min(fitting, key=lambda n: marked[n].seconds), []).append(name)
    return [replace(row, chosen_for=tuple(chosen.get(n, ()))) for n, row in enumerate(marked)]


def as_json(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """Rows as plain values."""
    return [{**vars(row), "chosen_for": list(row.chosen_for)} for row in rows]
