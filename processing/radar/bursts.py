"""Bursts of sweeps in a recording whose radar was switched off in between (stop-and-go along a rail, by hand).

What tells a radar that is on from one that is off is not how loud a channel is (hum and clicks are loud as well, and
the sync idles at any level) but its clock: two steep edges of one height in a steady rhythm. So edges are sought, their
least height is taken from those edges that keep time, and silence is where none of them do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from processing.errors import DataError
from processing.radar.sync import Sync, find_sync

_PERIOD_FACTOR = 1.6  # measured over nominal period, as in find_sync
_RHYTHM = 0.01  # of a period: how exactly an edge keeps time
_LEAST_EDGES = 6  # that must keep time in a channel for it to be a clock
_LEAST_SHARE = 0.4  # of the edges of a level that must keep time for it to be the clock's level
_HEIGHTS = 0.9 * 2.0 ** (-np.arange(0.0, 7.0, 0.25))  # of the highest step, candidates for the least height
_LEAST_STEP = 1e-3  # of full range: lower steps are noise
_PAD = 32  # samples kept before the first and behind the last edge: find_sync measures the levels there


@dataclass(frozen=True)
class Burst:
    """Samples ``start`` to ``stop`` of a recording, during which the radar was on."""

    start: int
    stop: int
    edges: int
    """Edges of the sync that keep time."""
    interruptions: int = 0
    """Places at which the rhythm was lost for less than the shortest silence."""

    @property
    def samples(self) -> int:
        """Length, samples."""
        return self.stop - self.start


@dataclass(frozen=True)
class Bursts:
    """All bursts of a recording, in order, and the clock that they share."""

    bursts: tuple[Burst, ...]
    sync: Sync
    """Of the longest burst: its channel and polarity; instants count from that burst's first sample."""
    step: float
    """Height of the sync's edges, in units of the samples."""


def find_bursts(
    samples: NDArray[np.generic],
    sample_rate_hz: float,
    *,
    nominal_period_s: float = 0.040,
    shortest_silence_s: float = 0.16,
) -> Bursts:
    """Split a stereo recording where its sync is silent.

    The step at each sample is the difference of the means of 1/64 period after and before it. For falling thresholds,
    steps that alternate and come back after one period to within 1 % are counted; the highest threshold at which
    enough of all edges do so gives the clock's own step, and half of that is the least height of an edge. Of two
    channels that keep time (the beat may leak) the one that :func:`processing.radar.sync.find_sync` takes is the sync.

    Args:
        samples: (n, 2) samples of any real type.
        sample_rate_hz: sample rate, Hz.
        nominal_period_s: expected time from up-ramp to up-ramp, s; the true one may differ by a factor of 1.6.
        shortest_silence_s: bursts that are nearer to each other are one.

    Raises:
        DataError: not a stereo recording, undefined samples, or no channel with a steady clock.
    """
    samples = np.asarray(samples)
    if samples.ndim != 2 or samples.shape[1] != 2:
        raise DataError(
            f"the recording has shape {samples.shape} and not two channels", "record beat and sync together in stereo"
        )
    if not (np.isfinite(sample_rate_hz) and sample_rate_hz > 0 and nominal_period_s > 0 and shortest_silence_s >= 0):
        raise DataError(
            f"sample rate {sample_rate_hz} Hz, period {nominal_period_s} s and silence {shortest_silence_s} s",
            "give positive ones",
        )
    if samples.dtype.kind == "f" and not np.isfinite(samples).all():
        raise DataError("the recording contains undefined samples (NaN or infinite)", "export it again")
    nominal = nominal_period_s * sample_rate_hz
    problem: DataError | None = None
    for clock in sorted(
        (clock for column in (0, 1) if (clock := _clock(samples[:, column], column, nominal)) is not None),
        key=lambda clock: -int(clock.in_time.sum()),
    ):
        bursts = _split(clock, shortest_silence_s * sample_rate_hz, len(samples))
        if not bursts:
            continue
        longest = max(bursts, key=lambda burst: burst.edges)
        try:
            sync = find_sync(samples[longest.start : longest.stop], sample_rate_hz, nominal_period_s=nominal_period_s)
        except DataError as error:
            problem = error
            continue
        if sync.channel == clock.column:
            return Bursts(tuple(bursts), sync, clock.step)
    # Why there is no clock (too short, silent, identical channels) is best said of the whole recording.
    if problem is None:
        find_sync(samples, sample_rate_hz, nominal_period_s=nominal_period_s)
    raise problem or DataError("its sync keeps no steady time", "check that the sync output was recorded")


@dataclass(frozen=True)
class _Clock:
    """Edges of one channel."""

    column: int
    at: NDArray[np.intp]
    rising: NDArray[np.bool_]
    in_time: NDArray[np.bool_]
    """Edges that begin or end a run of the right length."""
    joined: NDArray[np.bool_]
    """(edges - 1,) whether the run from an edge to the next is a whole ramp."""
    step: float


def _clock(signal: NDArray[np.generic], column: int, nominal: float) -> _Clock | None:
    width = max(int(nominal / 64), 4)
    if len(signal) < 4 * width:
        return None
    total = np.concatenate([[0.0], np.cumsum(signal, dtype=np.float64)])
    step = (total[2 * width :] - 2 * total[width:-width] + total[: -2 * width]) / width
    full = 2.0 ** (8 * signal.dtype.itemsize) if signal.dtype.kind in "iu" else 2.0
    size = np.abs(step)
    peaks, _ = find_peaks(size, height=max(_LEAST_STEP * full, float(size.max()) * _HEIGHTS[-1] / 2), distance=width)
    heights, rising, at = size[peaks], step[peaks] > 0, peaks + width
    if len(peaks) < _LEAST_EDGES:
        return None
    top = float(heights.max())
    for threshold in _HEIGHTS * top:
        chosen = _without_glitches(at, rising, heights > threshold, nominal)
        joined = _whole_runs(at[chosen], rising[chosen], nominal)
        in_time = _touched(joined)
        if in_time.sum() < _LEAST_EDGES or in_time.mean() < _LEAST_SHARE:
            continue
        # What keeps time tells the height; half of it separates edges from whatever else there is.
        height = float(np.median(heights[chosen][in_time]))
        chosen = _without_glitches(at, rising, heights > height / 2, nominal)
        joined = _whole_runs(at[chosen], rising[chosen], nominal)
        return _Clock(column, at[chosen], rising[chosen], _touched(joined), joined, height)
    return None


def _without_glitches(
    at: NDArray[np.intp], rising: NDArray[np.bool_], chosen: NDArray[np.bool_], nominal: float
) -> NDArray[np.intp]:
    """Indices of the chosen edges without pairs of opposite ones that are nearer than a tenth of a period: clicks."""
    kept: list[int] = []
    for index in np.flatnonzero(chosen).tolist():
        if kept and at[index] - at[kept[-1]] < nominal / 10 and rising[index] != rising[kept[-1]]:
            kept.pop()
        else:
            kept.append(index)
    return np.array(kept, dtype=np.intp)


def _whole_runs(at: NDArray[np.intp], rising: NDArray[np.bool_], nominal: float) -> NDArray[np.bool_]:
    """(edges - 1,) runs between opposite edges that are as long as the clock's high or low run."""
    if len(at) < 3:
        return np.zeros(max(len(at) - 1, 0), dtype=np.bool_)
    runs = np.diff(at).astype(np.float64)
    alternate = rising[1:] != rising[:-1]
    periods = runs[:-1] + runs[1:]
    possible = alternate[:-1] & alternate[1:]
    possible &= (periods > nominal / _PERIOD_FACTOR) & (periods < nominal * _PERIOD_FACTOR)
    if not possible.any():
        return np.zeros(len(runs), dtype=np.bool_)
    period = float(np.median(periods[possible]))
    within = max(_RHYTHM * period, 3.0)
    steady = possible & (np.abs(periods - period) < within)
    whole = np.zeros(len(runs), dtype=np.bool_)
    for level in (True, False):
        of_level = rising[:-1] == level
        inside = of_level & np.concatenate([steady, [False]])
        if not inside.any():
            return np.zeros(len(runs), dtype=np.bool_)
        whole |= of_level & alternate & (np.abs(runs - np.median(runs[inside])) < within)
    return whole


def _touched(joined: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Edges at either end of a whole run."""
    touched = np.zeros(len(joined) + 1, dtype=np.bool_)
    touched[:-1] |= joined
    touched[1:] |= joined
    return touched


def _split(clock: _Clock, silence: float, length: int) -> list[Burst]:
    """Chains of edges joined by whole runs; chains that are near each other are one burst with an interruption."""
    bursts: list[Burst] = []
    borders = np.flatnonzero(~clock.joined)
    firsts, lasts = np.concatenate([[0], borders + 1]), np.concatenate([borders, [len(clock.at) - 1]])
    for first, last in zip(firsts.tolist(), lasts.tolist(), strict=True):
        edges = last - first + 1
        if edges < 3:
            continue
        start, stop = max(int(clock.at[first]) - _PAD, 0), min(int(clock.at[last]) + _PAD, length)
        if bursts and start - bursts[-1].stop < silence:
            before = bursts.pop()
            bursts.append(Burst(before.start, stop, before.edges + edges, before.interruptions + 1))
        else:
            bursts.append(Burst(start, stop, edges))
    return bursts
