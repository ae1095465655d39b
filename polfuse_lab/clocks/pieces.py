"""Where a device's clock did not run on: it was set, wrapped round, began anew, or the host slept."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

STEP_S = 0.2
"""A step between two clocks, s, beyond which one of them has been set or begun anew, whatever the pairs around say."""
STEP_RATE = 2e-3
"""Drift that is still a drift: twice the worst that a sound card may have (1000 ppm)."""
LEAST_JUMP_S = 2e-3
"""Smallest jump that is looked for, s; less is noise of the readings."""
WINDOW = 8
"""Pairs on each side by which a jump is judged."""
LEAST_GOOD = 0.5
"""Share of the pairs on each side that must agree; two of them at least."""
LEAST_BETWEEN = 4
"""Fewest pairs between two jumps."""
LEAST_APART_S = 1e-12
"""Readings of a device's clock that are no further apart are one instant: no slope between them means anything."""

_LATE = 4.0
"""A pair whose round trip is so many times the median says nothing of jumps."""


def clock_runs(t_device_s: NDArray[np.float64], t_host_ns: NDArray[np.int64]) -> list[slice]:
    """Stretches of clock fixes within which the device's clock ran on, as far as two neighbours can tell.

    A device that was opened again begins to count anew, a counter wraps round, and a clock may be set: these show as a
    step between the clocks that no drift explains (:data:`STEP_S`, :data:`STEP_RATE`).
    """
    host_s = np.diff(t_host_ns) * 1e-9
    step_s = np.abs(np.diff(t_device_s) - host_s)
    borders = [0, *(np.flatnonzero(step_s > STEP_S + STEP_RATE * np.abs(host_s)) + 1).tolist(), len(t_device_s)]
    return [slice(a, b) for a, b in itertools.pairwise(borders) if b > a]


def clock_pieces(
    t_device_s: NDArray[np.float64], t_host_ns: NDArray[np.int64], round_trip_ns: NDArray[np.int64]
) -> list[slice]:
    """Stretches of clock fixes that one straight line describes, apart from outliers; fixes in order of time.

    Within the runs of :func:`clock_runs` smaller jumps are found: places where two lines of one slope, one before and
    one after, leave so much less of the nearest :data:`WINDOW` pairs on each side than one line does, that more than
    one pair turns from an outlier into a good one. A single pair away from all others is no jump.
    """
    found = []
    for run in clock_runs(t_device_s, t_host_ns):
        x = t_device_s[run] - t_device_s[run][0]
        y = (t_host_ns[run] - t_host_ns[run][0]) * 1e-9
        # What differs between neighbours is small, so that nothing is lost by differences of large numbers.
        borders = [0, *_jumps(x, y - x, np.asarray(round_trip_ns[run] * 1e-9, dtype=np.float64)), len(x)]
        found += [slice(run.start + a, run.start + b) for a, b in itertools.pairwise(borders)]
    return found


def _jumps(x: NDArray[np.float64], y: NDArray[np.float64], trip: NDArray[np.float64]) -> list[int]:
    """Indices of the first pair after each jump; ``y`` is the host's time less the device's, s."""
    telling = np.flatnonzero(trip <= max(_LATE * float(np.median(trip)), float(np.min(trip)) + 1e-3))
    if len(telling) < 4:
        return []
    x, y = x[telling], y[telling]
    steps, spans = np.diff(y), np.diff(x)
    on = spans > LEAST_APART_S
    rate = float(np.median(steps[on] / spans[on])) if on.any() else 0.0
    steps = np.abs(steps - rate * spans)
    least = max(4 * 1.4826 * float(np.median(steps)), LEAST_JUMP_S)
    jumps: list[int] = []

    def holds(at: int) -> bool:
        before = max((jump for jump in jumps if jump < at), default=0)
        after = min((jump for jump in jumps if jump > at), default=len(x))
        return _is_jump(x, y, max(before, at - WINDOW), at, min(after, at + WINDOW))

    for at in (np.argsort(-steps)[: int(np.count_nonzero(steps > least))] + 1).tolist():
        if holds(at):
            jumps.append(at)  # noqa: PERF401 - holds() looks at them
    # Two jumps within seconds are rarer than two outliers that agree.
    for first, second in itertools.pairwise(sorted(jumps)):
        if second - first < LEAST_BETWEEN and {first, second} <= set(jumps):
            jumps.remove(min(first, second, key=lambda at: float(steps[at - 1])))
    # What was taken for a jump for an outlier beside a true one does not hold once that is known.
    for at in list(jumps):
        if not holds(at):
            jumps.remove(at)
    return [int(telling[jump]) for jump in sorted(jumps)]


def _is_jump(x: NDArray[np.float64], y: NDArray[np.float64], first: int, at: int, end: int) -> bool:
    """Whether pairs ``first`` to ``end`` are better described by two parallel lines, parted before ``at``."""
    if at - first < 2 or end - at < 2:
        return False
    sides = slice(first, at), slice(at, end)
    slopes = np.concatenate([_slopes(x[side], y[side]) for side in sides])
    rate = float(np.median(slopes)) if len(slopes) else 0.0
    levels = [float(np.median(y[side] - rate * x[side])) for side in sides]
    apart = np.concatenate([y[side] - rate * x[side] - level for side, level in zip(sides, levels, strict=True)])
    scale = 1.4826 * float(np.median(np.abs(apart)))
    cap = max(4 * scale, LEAST_JUMP_S)
    # The level of few pairs is not known so well.
    if abs(levels[1] - levels[0]) < cap * (1 + 2 / min(at - first, end - at)):
        return False
    whole = slice(first, end)
    all_slopes = _slopes(x[whole], y[whole])
    line = y[whole] - (float(np.median(all_slopes)) if len(all_slopes) else 0.0) * x[whole]
    together = line - float(np.median(line))
    gain = np.minimum(np.abs(together), cap).sum() - np.minimum(np.abs(apart), cap).sum()
    # Outliers side by side must not make a level of their own.
    near = np.abs(apart) < cap
    agree = [side for side in (near[: at - first], near[at - first :]) if side.sum() >= max(2, LEAST_GOOD * len(side))]
    return bool(gain > 1.5 * cap and len(agree) == 2)


def _slopes(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slopes between all pairs of points at different places."""
    i, j = np.triu_indices(len(x), 1)
    dx = x[j] - x[i]
    apart = np.abs(dx) > LEAST_APART_S
    slopes: NDArray[np.float64] = (y[j] - y[i])[apart] / dx[apart]
    return slopes
