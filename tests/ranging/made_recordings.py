"""Recordings computed from the closed form of the beat, independent of the code under test.

``v(t) = Re{conj(M) exp(j (2 pi tau(t) f(t) - pi K tau(t)^2))}`` with tau(t) = 2 R(t) / c, f(t) the triangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

C = 299_792_458.0


@dataclass(frozen=True)
class Point:
    range_m: float
    speed_m_s: float = 0.0
    amplitude: complex = 0.1


def edge(t, at, width):
    """0 before, 1 after, linear over ``width`` samples centred at ``at``: linear interpolation is exact on it."""
    return np.clip((t - at) / width + 0.5, 0.0, 1.0)


def recording(
    points,
    *,
    seconds=0.5,
    rate=48_000.0,
    period=1920.5,
    ramp=960.25,
    start=100.3,
    centre=2.4e9,
    bandwidth=80e6,
    noise=0.0,
    sync_noise=0.0,
    jitter=0.0,
    sync_level=0.8,
    edge_width=3.0,
    inverted=False,
    swapped=False,
    dtype=np.float64,
    seed=1,
):
    """(n, 2) samples, and the true starts and ends of the up-ramps in samples."""
    rng = np.random.default_rng(seed)
    count = round(seconds * rate)
    n = np.arange(count, dtype=np.float64)
    sweeps = np.arange(-2, int(count / period) + 3)
    starts = start + sweeps * period + jitter * rng.normal(size=len(sweeps))
    ends = starts + ramp
    which = np.searchsorted(starts, n, side="right") - 1
    since = n - starts[which]
    length = np.where(since < ramp, ramp, period - ramp) / rate
    slope = np.where(since < ramp, bandwidth, -bandwidth) / length
    middle = np.where(since < ramp, ramp / 2, (period + ramp) / 2)
    frequency = centre + slope * (since - middle) / rate
    beat = noise * rng.normal(size=count)
    for point in points:
        tau = 2 * (point.range_m + point.speed_m_s * n / rate) / C
        phase = 2 * np.pi * tau * frequency - np.pi * slope * tau**2
        beat += (np.conj(point.amplitude) * np.exp(1j * phase)).real
    sync = np.zeros(count)
    for begin, stop in zip(starts, ends, strict=True):
        sync += edge(n, begin, edge_width) - edge(n, stop, edge_width)
    sync = sync_level * (2 * sync - 1) * (-1 if inverted else 1) + sync_noise * rng.normal(size=count)
    samples = np.stack([sync, beat] if swapped else [beat, sync], axis=1)
    if np.dtype(dtype).kind == "i":
        full = 2.0 ** (8 * np.dtype(dtype).itemsize - 1)
        samples = np.clip(np.round(samples * full), -full, full - 1)
    return samples.astype(dtype), starts, ends
