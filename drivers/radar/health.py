"""What a piece of stereo audio says about the radar that it comes from: levels, and what is wrong with it.

Which channel carries the sync is measured here roughly, from this piece alone: a sync stands at one of two levels
nearly all the time and rises in a steady rhythm. Clipping, offset and hum are judged on the beat only, since a sync is
clipped by design.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.records import Level

Floats = NDArray[np.float64]

SILENCE = 2e-4
"""Peak to peak, fraction of full scale, below which a channel is dead: a few counts of 16 bits."""
IDENTICAL = 0.999
"""Correlation above which both channels carry one signal."""
CLIPPED = 0.002
"""Share of the beat's samples at full scale above which it counts as clipped."""
FULL = 0.999
"""Fraction of full scale from which a sample is at full scale."""
WEAK = 3e-4
"""Rms of the beat, fraction of full scale, below which it counts as missing (10 counts of int16)."""
OFFSET = 0.05
"""Mean of the beat, fraction of full scale, above which it takes room that the beat needs."""
HUM = 0.003
"""Amplitude of a mains line in the beat, fraction of full scale, above which it counts as hum."""
MAINS_HZ = (50.0, 60.0)
PERIOD_TOLERANCE = 0.02
"""Deviation of the sweep period from the nominal one that is told."""
PERIOD_FACTOR = 1.6
"""Ratio to the nominal sweep period beyond which the rhythm is not that of the sweeps."""


class Trouble(enum.Enum):
    """What can be wrong with the signal."""

    SILENT = "silent"
    DEAD_CHANNEL = "dead channel"
    IDENTICAL = "identical channels"
    NO_SYNC = "no sync"
    WRONG_PERIOD = "wrong period"
    CLIPPED = "beat clipped"
    WEAK = "beat weak"
    OFFSET = "beat offset"
    HUM = "mains hum"
    PERIOD_OFF = "period off nominal"
    SWAPPED = "channels swapped"
    INVERTED = "sync inverted"


class Severity(enum.IntEnum):
    """How bad it is."""

    NOTE = 0
    """Worth knowing; processing measures it and needs nothing."""
    WARNING = 1
    """Records are usable but worse than they could be."""
    ERROR = 2
    """Records cannot be used."""


@dataclass(frozen=True)
class SignalFinding:
    """One thing that is wrong, in a sentence, and how to mend it."""

    trouble: Trouble
    severity: Severity
    what: str
    advice: str
    measured: str = ""
    """The number behind it, in words."""

    @property
    def sentence(self) -> str:
        """What is wrong, with its number."""
        return f"{self.what} ({self.measured})" if self.measured else self.what


@dataclass(frozen=True)
class SignalHealth:
    """What was measured, and what is wrong. Lengths in seconds, amplitudes as fractions of full scale."""

    level: Level
    sync_channel: int | None
    """Channel of the sync; None where no channel is one."""
    sync_inverted: bool | None
    """Whether the sync is low during the up-ramp; None where the piece does not tell."""
    sweep_period_s: float
    """Median time between the sync's rises, s; NaN without sync."""
    beat_offset: float
    """Mean of the beat; NaN without sync."""
    beat_clipped: float
    """Share of the beat's samples at full scale; NaN without sync."""
    hum_hz: float
    """Frequency of the strongest mains line in the beat; NaN where there is none."""
    hum: float
    """Its amplitude; 0 where there is none, NaN where the piece is too short to tell mains from sweeps."""
    findings: tuple[SignalFinding, ...]
    """The worst first."""

    @property
    def error(self) -> SignalFinding | None:
        """The first finding that makes the signal unusable, if any does."""
        return next((finding for finding in self.findings if finding.severity is Severity.ERROR), None)


@dataclass(frozen=True)
class SyncMeasure:
    """What is known of a piece's sync."""

    channel: int
    period_s: float
    """Sweep period (up and down), s."""
    high_share: float
    """Share of the period for which the sync is high."""


def fractions(samples: NDArray[Any]) -> Floats:
    """Samples (frames, channels) of any sample type as fractions of full scale."""
    scale = 1.0 if samples.dtype.kind == "f" else 1.0 / (np.iinfo(samples.dtype).max + 1.0)
    return samples.astype(np.float64) * scale


def level_of(samples: NDArray[Any]) -> Level:
    """Peak and rms of each channel of (frames, channels) samples, as fractions of full scale."""
    return _level(fractions(samples))


def examine_signal(
    samples: NDArray[Any],
    sample_rate_hz: float,
    *,
    nominal_period_s: float | None = None,
    ramp_up_s: float | None = None,
    sync_channel: int | None = None,
    sync: SyncMeasure | None = None,
) -> SignalHealth:
    """Measure a piece of audio and name what is wrong with it.

    Mains hum is told from the sweeps' own lines (all multiples of the sweep rate) only where they are far enough apart
    for the length of the piece: 2 s tell 60 Hz from 40 ms sweeps; 50 Hz is told when the sweeps are not exactly 40 ms.

    Args:
        samples: (frames, 2), any sample type; two sweeps or more.
        sample_rate_hz: sample rate, Hz.
        nominal_period_s: expected sweep period (up and down), s, if known.
        ramp_up_s: expected length of the up-ramp, s, if known; it tells the sync's polarity.
        sync_channel: channel on which the sync is expected, if any is.
        sync: the sync, where it has been measured better than here.

    Raises:
        ValueError: not stereo, or no samples.
    """
    if samples.ndim != 2 or samples.shape[1] != 2 or not len(samples):
        raise ValueError(f"found samples of shape {samples.shape}, allowed: (frames, 2) with at least one frame")
    values = fractions(samples)
    level = _level(values)
    found = _dead(values)
    if sync is None and not found:
        sync = _find_sync(values, sample_rate_hz)
    if sync is None or found:
        found = found or [
            SignalFinding(
                Trouble.NO_SYNC,
                Severity.ERROR,
                "neither channel carries a sync",
                "plug the radar's sync output into one channel of a line input and check that the radar sweeps",
            )
        ]
        nan = math.nan
        return SignalHealth(level, None, None, nan, nan, nan, nan, nan, tuple(found))
    beat = values[:, 1 - sync.channel]
    offset = float(np.mean(beat))
    clipped = float(np.mean(np.abs(beat) >= FULL))
    hum_hz, hum = _hum(beat - offset, sample_rate_hz, sync.period_s)
    inverted = _inverted(sync, ramp_up_s)
    found += _period_findings(sync, nominal_period_s)
    found += _beat_findings(clipped, float(np.std(beat)), offset, hum_hz, hum)
    if sync_channel is not None and sync.channel != sync_channel:
        found.append(
            SignalFinding(
                Trouble.SWAPPED,
                Severity.NOTE,
                f"the sync is on channel {sync.channel} and the beat on channel {1 - sync.channel}: they are swapped",
                "nothing needs to be done: which channel is which is measured",
            )
        )
    if inverted:
        found.append(
            SignalFinding(
                Trouble.INVERTED,
                Severity.NOTE,
                "the sync is inverted: it is low during the up-ramp",
                "nothing needs to be done: its polarity is measured",
            )
        )
    found.sort(key=lambda finding: -finding.severity)
    return SignalHealth(level, sync.channel, inverted, sync.period_s, offset, clipped, hum_hz, hum, tuple(found))


def _level(values: Floats) -> Level:
    peak, rms = np.abs(values).max(axis=0), np.sqrt(np.mean(values**2, axis=0))
    return Level(peak=tuple(map(float, peak)), rms=tuple(map(float, rms)))


def _dead(values: Floats) -> list[SignalFinding]:
    """Signals that cannot be a beat and a sync."""
    swing = np.ptp(values, axis=0)
    silent = swing < SILENCE
    if silent.all():
        what, advice = "both channels are silent", "check the cable, the radar's power and the input's volume"
        return [SignalFinding(Trouble.SILENT, Severity.ERROR, what, advice)]
    if silent.any():
        what = f"channel {int(np.argmin(swing))} is silent"
        advice = "check that both plugs are in: use a stereo cable and a stereo line input"
        return [SignalFinding(Trouble.DEAD_CHANNEL, Severity.ERROR, what, advice)]
    centred = values - values.mean(axis=0)
    first, second = centred.T
    if first @ second > IDENTICAL * math.sqrt(float(first @ first) * float(second @ second)):
        what, advice = "both channels carry the same signal", "use a stereo line input, not a microphone input"
        return [SignalFinding(Trouble.IDENTICAL, Severity.ERROR, what, advice)]
    return []


def _find_sync(values: Floats, rate: float) -> SyncMeasure | None:
    """The channel that is a sync; the one that keeps closer to two levels where both look like one."""
    best: tuple[float, SyncMeasure] | None = None
    for channel in (0, 1):
        signal = values[:, channel]
        low, high = np.percentile(signal, (5, 95))
        span = high - low
        if span < SILENCE:
            continue
        near = float(np.mean((np.abs(signal - low) < 0.25 * span) | (np.abs(signal - high) < 0.25 * span)))
        state = _schmitt(signal, low + 0.25 * span, high - 0.25 * span)
        rises = np.flatnonzero(np.diff(state) > 0)
        # A sine is near its extremes for two thirds of its time.
        if near < 0.8 or len(rises) < 2:
            continue
        periods = np.diff(rises)
        period = float(np.median(periods))
        if np.mean(np.abs(periods - period) <= max(0.05 * period, 2)) < 0.7:
            continue
        whole = state[rises[0] + 1 : rises[-1] + 1]
        measure = SyncMeasure(channel, period / rate, float(np.mean(whole > 0)))
        if best is None or near > best[0]:
            best = (near, measure)
    return None if best is None else best[1]


def _schmitt(signal: Floats, low: float, high: float) -> NDArray[np.int8]:
    """-1 or +1 for each sample: the side of the band from ``low`` to ``high`` on which the signal was last."""
    state = np.where(signal >= high, 1, np.where(signal <= low, -1, 0)).astype(np.int8)
    known = np.where(state != 0, np.arange(len(state)), -1)
    last = np.maximum.accumulate(known)
    first = int(np.argmax(state != 0))
    return state[np.where(last < 0, first, last)]


def _inverted(sync: SyncMeasure, ramp_up_s: float | None) -> bool | None:
    """Whether the sync's low part is the up-ramp: told by which of both lengths fits the ramp; None where both do."""
    if ramp_up_s is None:
        return None
    share = ramp_up_s / sync.period_s
    as_high, as_low = abs(sync.high_share - share), abs(1 - sync.high_share - share)
    return None if abs(as_high - as_low) < 0.1 else as_low < as_high


def _period_findings(sync: SyncMeasure, nominal_s: float | None) -> list[SignalFinding]:
    if nominal_s is None:
        return []
    ratio = sync.period_s / nominal_s
    measured = f"{sync.period_s * 1e3:.2f} ms, nominal {nominal_s * 1e3:g} ms"
    if not 1 / PERIOD_FACTOR <= ratio <= PERIOD_FACTOR:
        advice = "set waveform.sweep_period_s to the radar's sweep period (up and down), or mend the ramp generator"
        return [
            SignalFinding(
                Trouble.WRONG_PERIOD, Severity.ERROR, "the sync's rhythm is not the sweeps'", advice, measured
            )
        ]
    if abs(ratio - 1) > PERIOD_TOLERANCE:
        advice = "nothing needs to be done: the measured period is used; trim the ramp generator if ranges matter"
        return [
            SignalFinding(Trouble.PERIOD_OFF, Severity.NOTE, "the sweep period is off its nominal", advice, measured)
        ]
    return []


def _beat_findings(clipped: float, rms: float, offset: float, hum_hz: float, hum: float) -> list[SignalFinding]:
    found: list[tuple[Trouble, str, str, str]] = []
    if clipped > CLIPPED:
        advice = "lower the input level, or move the target further away"
        found.append((Trouble.CLIPPED, "the beat is clipped", advice, f"{100 * clipped:.1f} % of its samples"))
    elif rms < WEAK:
        advice = "check the beat's cable and raise the input level"
        found.append((Trouble.WEAK, "the beat is very weak", advice, _full_scale_db(rms)))
    if abs(offset) > OFFSET:
        advice = "use an input that blocks direct current, or a capacitor in the line"
        found.append((Trouble.OFFSET, "the beat has an offset", advice, f"{100 * offset:.0f} % of full scale"))
    if hum > HUM:
        advice = "run the computer on its battery, or break the ground loop with a transformer"
        found.append((Trouble.HUM, "the beat carries mains hum", advice, f"{hum_hz:g} Hz, {_full_scale_db(hum)}"))
    return [SignalFinding(trouble, Severity.WARNING, *words) for trouble, *words in found]


def _full_scale_db(amplitude: float) -> str:
    return f"{20 * math.log10(max(amplitude, 1e-9)):.0f} dB of full scale"


def _hum(beat: Floats, rate: float, period_s: float) -> tuple[float, float]:
    """Frequency and amplitude of the strongest mains line; (NaN, 0) without any, (NaN, NaN) where none can be told."""
    # Means over groups leave some 2 kHz of bandwidth, far above the lines that matter.
    group = max(int(rate // 2000), 1)
    coarse = beat[: len(beat) // group * group].reshape(-1, group).mean(axis=1)
    count, coarse_rate = len(coarse), rate / group
    if count < 16:
        return math.nan, math.nan
    t = np.arange(count) / coarse_rate
    # Four-term Blackman-Harris: side lobes of -92 dB, main lobe 4 bins to either side (Harris 1978).
    turn = 2 * np.pi * np.arange(count) / count
    window = 0.35875 - 0.48829 * np.cos(turn) + 0.14128 * np.cos(2 * turn) - 0.01168 * np.cos(3 * turn)
    weighted = coarse * window * (2 / window.sum())
    reach = 4 * coarse_rate / count

    def amplitude(f: float) -> float:
        return float(abs(np.exp(-2j * np.pi * f * t) @ weighted))

    judged, best = False, (math.nan, 0.0)
    for f in (mains * harmonic for mains in MAINS_HZ for harmonic in range(1, 5)):
        from_sweeps = abs(f - round(f * period_s) / period_s)
        if from_sweeps < 2 * reach or f < 2 * reach or f > coarse_rate / 4:
            continue
        judged = True
        a = amplitude(f)
        # A line, not the flank or the floor of something else.
        if a > best[1] and a > 4 * max(amplitude(f - reach), amplitude(f + reach)):
            best = (f, a)
    return best if judged else (math.nan, math.nan)
