"""The sweep clock inside a stereo recording: which channel carries it, its polarity, its period and its edges.

Nothing about the recording is assumed that can be measured. What cannot be measured is said: when the high and the
low level last equally long, a recording of a static scene does not tell which of them is the up-ramp (the beat of the
down-ramp is the mirrored beat of the up-ramp), and the convention "high is up" is used; ``Sync.polarity_from`` says so.

Edge instants are multiples of 2^-16 sample and come from samples near the edge alone, so that the same sweep gives
the same numbers wherever in a recording it stands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from processing.errors import DataError

Polarity = Literal["auto", "high", "low"]
PolaritySource = Literal["given", "duration", "convention", "motion"]

_TICKS = 65_536.0  # edge instants are multiples of 1/_TICKS sample: sums and differences of them are exact
_SILENT = 5e-5  # peak-to-peak over full range below which a channel carries nothing (3 counts of int16)
_IDENTICAL = 0.999  # correlation above which both channels carry one signal
_PERIOD_FACTOR = 1.6  # measured over nominal period
_REGULAR = 0.05  # deviation from the median length at which a run is still a ramp
_BILEVEL = 0.8  # share of a sync's samples that stand near one of its two levels


@dataclass(frozen=True, eq=False)
class Sync:
    """The sweep clock of a recording. All instants and lengths are in samples, fractional."""

    channel: int
    """Column of the sync."""
    inverted: bool
    """Whether the up-ramp is the sync's low level."""
    polarity_from: PolaritySource
    """How ``inverted`` is known."""
    sample_rate_hz: float
    """Sample rate of the recording, Hz."""
    starts: NDArray[np.float64]
    """(sweeps,) starts of the whole up-ramps."""
    ends: NDArray[np.float64]
    """(sweeps,) their ends."""
    edges: NDArray[np.float64]
    """All instants at which an up-ramp starts, whole or not."""
    clipped_fraction: float
    """Share of the sync's samples at its extreme values (clipping is normal for a sync)."""

    @property
    def beat_channel(self) -> int:
        """Column of the beat."""
        return 1 - self.channel

    @property
    def period_samples(self) -> float:
        """Median time from one up-ramp's start to the next, samples."""
        return float(np.median(_periods(self.edges)))

    @property
    def ramp_samples(self) -> float:
        """Median length of the up-ramps, samples."""
        return float(np.median(self.ends - self.starts))

    @property
    def jitter_samples(self) -> float:
        """Robust standard deviation of the period (1.4826 median absolute deviation), samples; NaN below 3 periods."""
        periods = _periods(self.edges)
        if len(periods) < 3:
            return float("nan")
        return float(1.4826 * np.median(np.abs(periods - np.median(periods))))

    @property
    def period_s(self) -> float:
        """Sweep period, s."""
        return self.period_samples / self.sample_rate_hz

    @property
    def ramp_s(self) -> float:
        """Length of the up-ramp, s."""
        return self.ramp_samples / self.sample_rate_hz


def find_sync(
    samples: NDArray[np.generic],
    sample_rate_hz: float,
    *,
    nominal_period_s: float = 0.040,
    ramp_up_s: float | None = None,
    polarity: Polarity = "auto",
) -> Sync:
    """Find the sync in a stereo recording and measure it.

    A sync is a channel that stands at one of two levels nearly all the time and changes between them in a steady
    rhythm, whose period is within a factor of 1.6 of the nominal one. Edges are the crossings of the middle between
    the levels beside the edge, interpolated linearly between samples; a hysteresis of a quarter of the step and a
    shortest run of a tenth of a period keep noise from making edges.

    Polarity ``"auto"``: where the two levels last unequally long (by more than a tenth), the up-ramp is the one whose
    length is nearer to ``ramp_up_s`` if that is given, else the longer one; where they last equally long, the high one.

    Args:
        samples: (n, 2) samples of any real type, at least one whole up-ramp and two up-ramp starts.
        sample_rate_hz: sample rate, Hz.
        nominal_period_s: expected time from up-ramp to up-ramp, s.
        ramp_up_s: expected length of the up-ramp, s, if known.
        polarity: ``"high"`` or ``"low"`` where it is known which level is the up-ramp.

    Raises:
        DataError: not a stereo recording, undefined samples, silent channels, identical channels, too short, no sync.
    """
    samples = np.asarray(samples)
    if samples.ndim != 2 or samples.shape[1] != 2:
        raise DataError(
            f"the recording has shape {samples.shape} and not two channels", "record beat and sync together in stereo"
        )
    if not (np.isfinite(sample_rate_hz) and sample_rate_hz > 0 and nominal_period_s > 0):
        raise DataError(f"sample rate {sample_rate_hz} Hz and period {nominal_period_s} s are not both positive",
                        "give the recording's true sample rate and the radar's sweep period")  # fmt: skip
    if not len(samples):
        raise DataError("the recording is empty", "record at least three sweep periods")
    values = samples.astype(np.float64)
    if not np.isfinite(values).all():
        raise DataError("the recording contains undefined samples (NaN or infinite)", "export it again")
    _check_channels(samples, values)
    nominal = nominal_period_s * sample_rate_hz
    if len(values) < 1.5 * nominal:
        raise DataError(
            f"the recording is too short: {len(values) / sample_rate_hz:.3f} s hold less than two sweeps "
            f"of {nominal_period_s:.3f} s", "record at least three sweep periods")  # fmt: skip
    found = [(column, ramps) for column in (0, 1) if (ramps := _square_wave(values[:, column], nominal)) is not None]
    if not found:
        raise DataError(
            f"no sync: neither channel switches between two levels about every {nominal_period_s * 1e3:.0f} ms",
            "check that the sync output is connected and that the nominal sweep period is right")  # fmt: skip
    column, ramps = max(found, key=lambda item: item[1].bilevel)
    inverted, source = _polarity(ramps, polarity, None if ramp_up_s is None else ramp_up_s * sample_rate_hz)
    return _sync(values[:, column], column, ramps, inverted, source, sample_rate_hz)


def opposite(sync: Sync) -> Sync | None:
    """The sweep clock of the other level: each of its runs lasts from the end of an up-ramp to the next one's start.

    None where the record holds no such run, or where they are shorter than a quarter of the up-ramps (a saw-tooth).
    """
    following = np.searchsorted(sync.edges, sync.ends)
    inside = following < len(sync.edges)
    starts, ends = sync.ends[inside], sync.edges[following[inside]]
    expected = sync.period_samples - sync.ramp_samples
    good = np.abs(ends - starts - expected) < _REGULAR * sync.period_samples
    if not good.any() or expected < sync.ramp_samples / 4:
        return None
    return replace(sync, inverted=not sync.inverted, starts=starts[good], ends=ends[good], edges=sync.ends)


@dataclass(frozen=True)
class _Ramps:
    """Edges of a square wave: instants, whether each rises, and the lengths of its high and low runs."""

    instants: NDArray[np.float64]
    rising: NDArray[np.bool_]
    high: float
    low: float
    bilevel: float


def _check_channels(samples: NDArray[np.generic], values: NDArray[np.float64]) -> None:
    full_range = 2.0
    if samples.dtype.kind in "iu":
        full_range = 2.0 ** (8 * samples.dtype.itemsize)
    silent = [int(i) for i in range(2) if np.ptp(values[:, i]) <= _SILENT * full_range]
    if len(silent) == 2:
        raise DataError("both channels are silent", "check the radar's power, the cables and the input level")
    if silent:
        raise DataError(f"channel {silent[0]} is silent", "check the cable of that channel and the input level")
    centred = values - values.mean(axis=0)
    power = (centred**2).sum(axis=0)
    correlation = float((centred[:, 0] * centred[:, 1]).sum() / np.sqrt(power[0] * power[1]))
    if abs(correlation) > _IDENTICAL:
        kind = "identical" if correlation > 0 else "mirror images of each other"
        raise DataError(
            f"both channels are {kind}", "use a stereo line input: a mono microphone input gives beat or sync alone"
        )


def _square_wave(signal: NDArray[np.float64], nominal: float) -> _Ramps | None:
    """Edges of a channel that is a sync, else None."""
    bottom, top = np.percentile(signal, (2.0, 98.0))
    middle = (bottom + top) / 2
    above = signal > middle
    if not above.any() or above.all():
        return None
    high, low = np.median(signal[above]), np.median(signal[~above])
    step = high - low
    # Coarse thresholds, so that the same sweep has the same edges whatever else the recording holds.
    grain = 2.0 ** (np.floor(np.log2(step)) - 5)
    middle, step = np.round((high + low) / 2 / grain) * grain, np.round(step / grain) * grain
    near = np.minimum(np.abs(signal - high), np.abs(signal - low)) < 0.2 * step
    bilevel = float(near.mean())
    if bilevel < _BILEVEL:
        return None
    changes = _hysteresis(signal, middle - step / 4, middle + step / 4)
    if len(changes) > 40 * len(signal) / nominal:
        return None
    changes = _without_short_runs(changes, nominal / 10)
    gap, width = _level_window(nominal)
    # Both windows beside an edge must lie in the recording.
    changes = changes[(changes > gap + width) & (changes + gap + width <= len(signal))]
    if len(changes) < 3:
        return None
    instants = np.array([_crossing(signal, int(i), nominal) for i in changes])
    rising = signal[changes] > middle
    runs = np.diff(instants)
    is_high = rising[:-1]
    if not is_high.any() or is_high.all():
        return None
    lengths = float(np.median(runs[is_high])), float(np.median(runs[~is_high]))
    period = sum(lengths)
    if not nominal / _PERIOD_FACTOR < period < nominal * _PERIOD_FACTOR:
        return None
    expected = np.where(is_high, *lengths)
    if np.mean(np.abs(runs - expected) < _REGULAR * period) < 0.75:
        return None
    return _Ramps(instants, rising, *lengths, bilevel)


def _hysteresis(signal: NDArray[np.float64], lower: float, upper: float) -> NDArray[np.intp]:
    """Indices at which the signal has reached the other level (first sample beyond the far threshold)."""
    side = np.where(signal > upper, 1, np.where(signal < lower, -1, 0))
    decided = np.flatnonzero(side)
    changed: NDArray[np.intp] = decided[1:][np.diff(side[decided]) != 0]
    return changed


def _without_short_runs(changes: NDArray[np.intp], shortest: float) -> NDArray[np.intp]:
    """Drop pairs of changes that enclose a run shorter than ``shortest``: glitches, not ramps."""
    kept = list(changes)
    while len(kept) > 1:
        runs = np.diff(kept)
        index = int(np.argmin(runs))
        if runs[index] >= shortest:
            break
        del kept[index : index + 2]
    return np.array(kept, dtype=np.intp)


def _level_window(nominal: float) -> tuple[int, int]:
    """Distance from an edge and width of the windows in which the levels beside it are measured, samples."""
    return 4, min(16, max(int(nominal / 16), 1))


def _crossing(signal: NDArray[np.float64], index: int, nominal: float) -> float:
    """Instant of the edge that has reached its new level at ``index``.

    The levels are medians of a few samples on both sides. Of several crossings (noise on a slow edge) the mean counts.
    The instant is a multiple of 1/65536 sample.
    """
    gap, width = _level_window(nominal)
    before, after = signal[index - 1 - gap - width : index - 1 - gap], signal[index + gap : index + gap + width]
    first = index - 1 - gap
    piece = signal[first : index + 2] - (np.median(before) + np.median(after)) / 2
    at = np.flatnonzero((piece[:-1] < 0) != (piece[1:] < 0))
    if not len(at):
        return float(index)
    instants = at + piece[at] / (piece[at] - piece[at + 1])
    return first + float(np.round(instants.mean() * _TICKS) / _TICKS)


def _polarity(ramps: _Ramps, polarity: Polarity, ramp_up: float | None) -> tuple[bool, PolaritySource]:
    if polarity != "auto":
        return polarity == "low", "given"
    if abs(ramps.high - ramps.low) <= 0.1 * (ramps.high + ramps.low):
        return False, "convention"
    if ramp_up is None:
        return ramps.low > ramps.high, "duration"
    return abs(ramps.low - ramp_up) < abs(ramps.high - ramp_up), "duration"


def _sync(
    signal: NDArray[np.float64], column: int, ramps: _Ramps, inverted: bool, source: PolaritySource, rate: float
) -> Sync:
    begins = ramps.rising != inverted
    whole = begins[:-1] & ~begins[1:]
    starts, ends = ramps.instants[:-1][whole], ramps.instants[1:][whole]
    expected = ramps.low if inverted else ramps.high
    # A ramp that was interrupted (samples lost, radar switched) is no whole ramp.
    good = np.abs(ends - starts - expected) < _REGULAR * (ramps.high + ramps.low)
    if not good.any() or begins.sum() < 2:
        raise DataError("the recording is too short: it holds no whole up-ramp", "record at least three sweep periods")
    margin = np.ptp(signal) / 32_768
    extreme = (signal >= signal.max() - margin) | (signal <= signal.min() + margin)
    return Sync(
        channel=column,
        inverted=inverted,
        polarity_from=source,
        sample_rate_hz=float(rate),
        starts=starts[good],
        ends=ends[good],
        edges=ramps.instants[begins],
        clipped_fraction=float(extreme.mean()),
    )


def _periods(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Periods between starts, without those that span an interruption."""
    periods = np.diff(edges)
    typical = np.median(periods)
    return periods[np.abs(periods - typical) < 2 * _REGULAR * typical]
