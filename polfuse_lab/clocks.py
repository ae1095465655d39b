"""Clocks: from pairs of readings to a line between a device's clock and the host's, and how well it holds."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STEP_S = 0.2
"""A step between two clocks, s, beyond which one of them has been set or begun anew."""
STEP_RATE = 2e-3
"""Drift that is still a drift: twice the worst that a sound card may have (1000 ppm)."""


@dataclass(frozen=True)
class ClockFit:
    """``t_host_ns = reference_host_ns + 1e9 * (offset_s + rate * (t_device_s - reference_device_s))``."""

    device: str
    reference_device_s: float
    reference_host_ns: int
    offset_s: float
    rate: float
    """Host seconds for one second of the device (1 + drift)."""
    residual_rms_s: float
    """The sync uncertainty: rms of the residuals over n - 2, or half the longest round trip for fewer than 4 pairs."""
    pairs: int
    rejected: int
    """Pairs left out as outliers."""

    def host_ns(self, t_device_s: float) -> int:
        """The host's monotonic nanoseconds at a reading of the device's clock."""
        return self.reference_host_ns + round(
            1e9 * (self.offset_s + self.rate * (t_device_s - self.reference_device_s))
        )

    @property
    def drift_ppm(self) -> float:
        """How much faster the host's clock runs than the device's, parts per million."""
        return (self.rate - 1) * 1e6


def fit_clock(
    device: str,
    t_device_s: NDArray[np.float64],
    t_host_ns: NDArray[np.int64],
    round_trip_ns: NDArray[np.int64],
) -> ClockFit | None:
    """Fit a line through pairs of clock readings, robustly.

    A straight line by least squares, each pair weighted by its round trip, after leaving out pairs further than 4
    robust standard deviations (1.4826 times the median absolute deviation) from the line of Theil and Sen.

    Args:
        device: its name.
        t_device_s: (n,) readings of the device's clock, s.
        t_host_ns: (n,) readings of the host's clock at the middle of each exchange, ns.
        round_trip_ns: (n,) length of each exchange, ns.

    Returns:
        The fit, or None without any pair. With fewer than 4 pairs (or no spread of times) the residuals say nothing,
        and the uncertainty is half the longest round trip.
    """
    n = len(t_device_s)
    if n == 0:
        return None
    x0, y0 = float(t_device_s[0]), int(t_host_ns[0])
    x: NDArray[np.float64] = np.subtract(t_device_s, x0, dtype=np.float64)
    y: NDArray[np.float64] = np.multiply(np.subtract(t_host_ns, y0), 1e-9, dtype=np.float64)
    half_trip = float(np.max(round_trip_ns)) * 0.5e-9
    if n < 2 or np.ptp(x) <= 0:
        return ClockFit(device, x0, y0, float(np.median(y - x)), 1.0, half_trip, n, 0)
    rate = _theil_sen(x, y)
    offset = float(np.median(y - rate * x))
    if n < 4:
        return ClockFit(device, x0, y0, offset, rate, half_trip, n, 0)
    residual = np.abs(y - offset - rate * x)
    scale = 1.4826 * float(np.median(residual))
    # Rounding of the readings keeps a perfect line from rejecting everything but its two ends.
    keep = residual <= max(4 * scale, 2e-9)
    if keep.sum() < 3 or np.ptp(x[keep]) <= 0:
        keep[:] = True
    weight = 1 / np.maximum(np.asarray(round_trip_ns, dtype=np.float64)[keep] * 1e-9, 1e-6)
    rate, offset = (float(value) for value in np.polyfit(x[keep], y[keep], 1, w=weight))
    left = y[keep] - offset - rate * x[keep]
    rms = float(np.sqrt(np.sum(left**2) / (keep.sum() - 2)))
    return ClockFit(device, x0, y0, offset, rate, rms, n, int(n - keep.sum()))


def _theil_sen(x: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    """Median slope of all pairs of points (at most 400 points are paired, evenly picked)."""
    if len(x) > 400:
        pick = np.linspace(0, len(x) - 1, 400).round().astype(int)
        x, y = x[pick], y[pick]
    i, j = np.triu_indices(len(x), 1)
    dx = x[j] - x[i]
    apart = dx != 0
    return float(np.median((y[j] - y[i])[apart] / dx[apart]))


def clock_runs(t_device_s: NDArray[np.float64], t_host_ns: NDArray[np.int64]) -> list[slice]:
    """Stretches of clock fixes within which the device's clock ran on.

    A device that was opened again begins to count anew, and a clock may be set: both show as a step between the clocks
    that no drift explains (:data:`STEP_S`, :data:`STEP_RATE`).
    """
    host_s = np.diff(t_host_ns) * 1e-9
    step_s = np.abs(np.diff(t_device_s) - host_s)
    borders = [0, *(np.flatnonzero(step_s > STEP_S + STEP_RATE * np.abs(host_s)) + 1).tolist(), len(t_device_s)]
    return [slice(a, b) for a, b in itertools.pairwise(borders) if b > a]


def fit_clocks(clocks: NDArray[np.void]) -> dict[str, ClockFit]:
    """One fit for each device in a session's table of clock fixes: that of the longest run of its clock."""
    return {name: max(fits, key=lambda fit: fit.pairs) for name, fits in _all_fits(clocks).items() if fits}


def sync_rms_s(clocks: NDArray[np.void]) -> float | None:
    """Sync uncertainty of a session, s: the largest over its devices and runs; None where no device has a clock."""
    fits = [fit for fits in _all_fits(clocks).values() for fit in fits]
    return max((fit.residual_rms_s for fit in fits), default=None)


def _all_fits(clocks: NDArray[np.void]) -> dict[str, list[ClockFit]]:
    """The fits of all runs of each device's clock."""
    found: dict[str, list[ClockFit]] = {}
    for name in np.unique(clocks["device"]):
        rows = clocks[clocks["device"] == name]
        fits = (
            fit_clock(name.decode(), rows["t_device_s"][run], rows["t_host_ns"][run], rows["round_trip_ns"][run])
            for run in clock_runs(rows["t_device_s"], rows["t_host_ns"])
        )
        found[name.decode()] = [fit for fit in fits if fit is not None]
    return found
