"""Frequency over time: spectrogram, S-method and pseudo-Wigner distribution, and the straight line of a chirp in them.

The S-method (Stankovic 1994, IEEE Trans. Signal Processing 42(1) 225) adds products of neighbouring bins of a
short-time Fourier transform F,

    SM(t, f) = |F(t, f)|^2 + 2 sum_{i=1..L} Re F(t, f + i) F*(t, f - i),

and so goes from the spectrogram (L = 0) to the pseudo-Wigner distribution (L = half the bins): as sharp along a chirp
as the latter without its cross terms between components further apart than 2 L bins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class TimeFrequency:
    """A distribution over time and frequency."""

    power: Floats
    """(times, frequencies); the Wigner kinds have negative values too."""
    time_s: Floats
    frequency_hz: Floats
    """Ascending."""


@dataclass(frozen=True)
class ChirpLine:
    """A straight line in a time-frequency distribution."""

    frequency_hz: float
    """At time 0."""
    rate_hz_s: float
    contrast: float
    """Mean along the line over the distribution's mean."""


def time_frequency(
    signal: ArrayLike, step_s: float, *, start_s: float = 0.0, window: int = 64, hop: int | None = None, width: int = 0
) -> TimeFrequency:
    """Distribution of a complex signal behind a Hann window, padded to twice its length.

    Args:
        signal: (n,) evenly spaced.
        step_s: time between samples.
        start_s: time of the first sample.
        window: samples, even, at most n.
        hop: samples from one time to the next; an eighth of the window if left out.
        width: L of the S-method; 0 is the spectrogram, ``window`` the pseudo-Wigner distribution.

    Raises:
        DataError: no such window or width, or an undefined signal.
    """
    values = np.asarray(signal, dtype=np.complex128)
    hop = max(window // 8, 1) if hop is None else hop
    if values.ndim != 1 or not np.isfinite(values).all():
        raise DataError(f"a signal of shape {values.shape}", "give one row of defined samples")
    if not (4 <= window <= len(values) and window % 2 == 0 and hop >= 1 and 0 <= width <= window and step_s > 0):
        raise DataError(
            f"a window of {window}, a hop of {hop} and a width of {width} for {len(values)} samples",
            "take an even window of 4 samples or more that fits, a hop of 1 or more and a width up to the window",
        )
    size = 2 * window
    shape = np.sin(np.pi * (np.arange(window) + 0.5) / window) ** 2
    pieces = np.lib.stride_tricks.sliding_window_view(values, window)[::hop] * (shape / shape.sum())
    # Phases are counted from the window's middle, so that the products below hold the chirp's and not the window's.
    padded = np.zeros((len(pieces), size), dtype=np.complex128)
    padded[:, : window // 2], padded[:, size - window // 2 :] = pieces[:, window // 2 :], pieces[:, : window // 2]
    spectrum = np.fft.fftshift(np.fft.fft(padded, axis=1), axes=1)
    power = np.asarray(np.abs(spectrum) ** 2, dtype=np.float64)
    for i in range(1, width + 1):
        inner = slice(i, size - i)
        power[:, inner] += 2 * np.real(spectrum[:, 2 * i :] * np.conj(spectrum[:, : size - 2 * i]))
    time = np.asarray(start_s + (np.arange(len(pieces)) * hop + window / 2) * step_s, dtype=np.float64)
    return TimeFrequency(power, time, np.asarray(np.fft.fftshift(np.fft.fftfreq(size, step_s)), dtype=np.float64))


def chirp_line(
    distribution: TimeFrequency, *, max_rate_hz_s: float, rates: int = 161, max_offset_hz: float | None = None
) -> ChirpLine:
    """The line with the largest mean: the Radon transform of the distribution, over frequency offsets and rates.

    Args:
        distribution: see :func:`time_frequency`.
        max_rate_hz_s: rates are looked for from minus to plus this.
        rates: how many.
        max_offset_hz: frequencies at time 0 up to this; half the band if left out.

    Raises:
        DataError: nothing to look through.
    """
    tf = distribution
    step = float(tf.frequency_hz[1] - tf.frequency_hz[0])
    band = len(tf.frequency_hz) * step
    reach = band / 2 if max_offset_hz is None else max_offset_hz
    if rates < 2 or not (max_rate_hz_s > 0 and 0 < reach <= band / 2):
        raise DataError("no rates or frequencies to look through", "give positive limits within the band")
    offsets = np.arange(-reach, reach + step / 2, step)
    mean = float(np.mean(np.abs(tf.power))) or 1.0
    grid = np.linspace(-max_rate_hz_s, max_rate_hz_s, rates)
    totals = np.empty((rates, len(offsets)))
    for row, rate in enumerate(grid):
        place = (offsets + rate * tf.time_s[:, None] - tf.frequency_hz[0]) / step
        low = np.floor(place).astype(np.intp)
        share = place - low
        inside = (low >= 0) & (low + 1 < len(tf.frequency_hz))
        low = np.where(inside, low, 0)
        when = np.arange(len(tf.time_s))[:, None]
        values = (1 - share) * tf.power[when, low] + share * tf.power[when, low + 1]
        totals[row] = np.where(inside, values, 0.0).mean(axis=0)
    k, i = np.unravel_index(int(np.argmax(totals)), totals.shape)
    return ChirpLine(float(offsets[i]), float(grid[k]), float(totals[k, i] / mean))
