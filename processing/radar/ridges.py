"""The best path through a range-time picture, by dynamic programming over range and speed.

Track-before-detect (Barniv 1985): a state is (range bin, speed); from one sweep to the next the range changes by the
speed and the speed by at most one step, which costs ``TURN_COST``. A path may begin and end anywhere, so that its total
is the largest sum of scores over any such path.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError

TURN_COST = 3.0
"""Cost of a change of speed by one step from sweep to sweep, in the score's units."""

_BEGIN = -1


@dataclass(frozen=True)
class Path:
    """A path: one bin in each of consecutive sweeps, and the sum of their scores less the cost of turns."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    total: float


def best_path(score: NDArray[np.float64], speeds: NDArray[np.float64]) -> Path:
    """Path with the largest total.

    Args:
        score: (sweeps, bins) score of each cell, negative where there is nothing.
        speeds: (speeds,) ascending, evenly spaced, bins per sweep.

    Raises:
        DataError: no sweeps, bins or speeds.
    """
    if not score.size or not len(speeds):
        raise DataError(f"a path through scores {score.shape} at {len(speeds)} speeds", "give one or more of each")
    choice, total, end = _forward(np.ascontiguousarray(score, dtype=np.float64), _moves(speeds, len(score)))
    return _trace(choice, _moves(speeds, len(score)), total, end)


def best_path_reference(score: NDArray[np.float64], speeds: NDArray[np.float64]) -> Path:
    """The definition of :func:`best_path` in plain NumPy."""
    count, bins = score.shape
    moves = _moves(speeds, count)
    column = np.arange(bins)
    total = np.zeros((len(speeds), bins))
    choice = np.empty((count, len(speeds), bins), dtype=np.int8)
    best, end = -np.inf, (0, 0, 0)
    nothing = np.full((1, bins), -np.inf)
    for row in range(count):
        options = np.stack(
            [
                total,
                np.concatenate([nothing, total[:-1]]) - TURN_COST,
                np.concatenate([total[1:], nothing]) - TURN_COST,
            ]
        )
        turn = np.argmax(options, axis=0)
        source = column - moves[row][:, None]
        index = np.clip(source, 0, bins - 1)
        come = np.take_along_axis(options.max(axis=0), index, axis=1)
        begin = (source != index) | (come <= 0) | (row == 0)
        choice[row] = np.where(begin, _BEGIN, np.take_along_axis(turn, index, axis=1))
        total = score[row] + np.where(begin, 0.0, come)
        top = int(np.argmax(total))
        if total.flat[top] > best:
            best, end = float(total.flat[top]), (row, *divmod(top, bins))
    return _trace(choice, moves, best, end)


def _moves(speeds: NDArray[np.float64], count: int) -> NDArray[np.int64]:
    """(sweeps, speeds): bins to go from the sweep before to each sweep, so that fractions add up."""
    places = np.round(np.arange(-1, count)[:, None] * speeds)
    return np.diff(places, axis=0).astype(np.int64)


@numba.njit(cache=True)
def _forward(
    score: NDArray[np.float64], moves: NDArray[np.int64]
) -> tuple[NDArray[np.int8], float, tuple[int, int, int]]:
    count, bins = score.shape
    speeds = moves.shape[1]
    choice = np.empty((count, speeds, bins), dtype=np.int8)
    before, total = np.zeros((speeds, bins)), np.zeros((speeds, bins))
    best, end = -np.inf, (0, 0, 0)
    for row in range(count):
        before, total = total, before
        for speed in range(speeds):
            move = moves[row, speed]
            for column in range(bins):
                source = column - move
                value, turn = 0.0, -1
                if row > 0 and 0 <= source < bins:
                    value, turn = before[speed, source], 0
                    if speed > 0 and before[speed - 1, source] - TURN_COST > value:
                        value, turn = before[speed - 1, source] - TURN_COST, 1
                    if speed < speeds - 1 and before[speed + 1, source] - TURN_COST > value:
                        value, turn = before[speed + 1, source] - TURN_COST, 2
                    if value <= 0:
                        value, turn = 0.0, -1
                choice[row, speed, column] = turn
                value += score[row, column]
                total[speed, column] = value
                if value > best:
                    best, end = value, (row, speed, column)
    return choice, best, end


def _trace(choice: NDArray[np.int8], moves: NDArray[np.int64], total: float, end: tuple[int, int, int]) -> Path:
    row, speed, column = end
    rows, columns = [row], [column]
    while (turn := int(choice[row, speed, column])) != _BEGIN:
        column -= int(moves[row, speed])
        speed += (0, -1, 1)[turn]
        row -= 1
        rows.append(row)
        columns.append(column)
    return Path(np.array(rows[::-1], dtype=np.intp), np.array(columns[::-1], dtype=np.intp), float(total))
