"""Straight lines through noisy positions over time: where they break, and how well their slopes are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError, undefined_is_nan

_HUBER = 1.345  # 95 % efficiency on normal errors (Huber 1964)


@dataclass(frozen=True)
class Line:
    """``position = middle + slope (t - t_middle)``."""

    t_middle: float
    middle: float
    slope: float
    slope_sd: float
    """Standard deviation of the slope, from the residuals and their correlation; NaN below 3 points."""
    residual_sd: float

    def at(self, t: float) -> float:
        """Position at time t."""
        return self.middle + self.slope * (t - self.t_middle)


@undefined_is_nan
def robust_line(
    t: NDArray[np.float64], position: NDArray[np.float64], weight: NDArray[np.float64] | None = None
) -> Line:
    """Huber's line through points evenly spaced in time or nearly so.

    The slope's variance is that of Huber's estimate, ``E[psi^2] / E[psi']^2 / sum((t - t_middle)^2)``, times
    ``(1 + rho) / (1 - rho)`` for residuals whose neighbours correlate with rho (first-order autoregression): speckle of
    an extended target lasts several sweeps, so that points are fewer independent witnesses than their number.

    Raises:
        DataError: no points.
    """
    if not len(t):
        raise DataError("a line through no points", "give one point or more")
    base = np.ones_like(t) if weight is None else weight
    factor = np.ones_like(t)
    residual = np.zeros_like(t)
    t_middle = middle = slope = spread = 0.0
    for _ in range(20):
        w = base * factor
        t_middle = float((w * t).sum() / w.sum())
        middle = float((w * position).sum() / w.sum())
        lever = float((w * (t - t_middle) ** 2).sum())
        slope = float((w * (t - t_middle) * (position - middle)).sum() / lever) if lever > 0 else 0.0
        residual = position - middle - slope * (t - t_middle)
        spread = float(1.4826 * np.median(np.abs(residual)))
        if spread <= 0:
            break
        factor = np.minimum(1.0, _HUBER * spread / np.maximum(np.abs(residual), 1e-300))
    count = len(t)
    if count < 3 or lever <= 0:
        return Line(t_middle, middle, slope, float("nan"), float("nan"))
    # Variance of an M-estimate: E[psi^2] / E[psi']^2 over the lever (Huber 1981, section 7.6).
    psi = base * factor * residual
    kept = float((base * (factor >= 1.0)).mean())
    variance = float((psi**2).sum()) / (count - 2) / max(kept, 0.1) ** 2
    energy = float((psi**2).sum())
    rho = float((psi[:-1] * psi[1:]).sum()) / energy if energy > 0 else 0.0
    # The correlation of residuals about a fitted line is found too low by (2 + 4 rho) / n (Kendall 1954).
    rho = float(np.clip(rho + (2 + 4 * rho) / count, 0.0, 0.95)) if rho > 2 / np.sqrt(count) else max(rho, 0.0)
    spreading = float((base * (t - t_middle) ** 2).sum())
    slope_sd = np.sqrt(variance / spreading * (1 + rho) / (1 - rho))
    return Line(t_middle, middle, slope, float(slope_sd), float(np.sqrt(variance)))


def breaks(
    t: NDArray[np.float64], position: NDArray[np.float64], *, sd: float, penalty: float, shortest: int
) -> list[tuple[int, int]]:
    """Split points into the stretches of straight lines with the least total cost.

    The cost of a stretch is its squared residuals over ``sd``^2 plus ``penalty``; the best splitting is found exactly,
    by dynamic programming (Bellman 1961) on cumulative sums.

    Returns:
        Half-open index ranges that cover all points, each of at least ``shortest`` (one range if there are fewer).
    """
    count = len(t)
    shortest = max(shortest, 2)
    if count < 2 * shortest:
        return [(0, count)]
    x, y = t - t.mean(), position - position.mean()
    sums = [np.concatenate([[0.0], np.cumsum(v)]) for v in (x, y, x * x, x * y, y * y)]
    best = np.full(count + 1, np.inf)
    best[0] = -penalty
    before = np.zeros(count + 1, dtype=np.intp)
    for stop in range(shortest, count + 1):
        start = np.arange(0, stop - shortest + 1)
        n = stop - start
        sx, sy, sxx, sxy, syy = (s[stop] - s[start] for s in sums)
        cxx, cxy, cyy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
        squares = np.maximum(cyy - cxy**2 / np.maximum(cxx, 1e-300), 0.0)
        total = best[start] + squares / sd**2 + penalty
        pick = int(np.argmin(total))
        best[stop], before[stop] = total[pick], start[pick]
    ranges: list[tuple[int, int]] = []
    stop = count
    while stop > 0:
        ranges.append((int(before[stop]), stop))
        stop = int(before[stop])
    return ranges[::-1]
