"""Core time of focusing, from a small table measured on one kind of core and a probe of the core at hand.

The table is in nanoseconds of a 2.5 GHz server core with 512-bit vectors. How much faster or slower another core is (or
this one, when others use it) is told by a short probe of the same kind of work: gathers and complex exponentials.
"""

from __future__ import annotations

import functools
import math
import os
import time

import numpy as np

BACKPROJECTION_NS = {
    "linear": (0.5, 0.65, 90.0),
    "cubic": (0.35, 0.92, 140.0),
    "lagrange4": (0.38, 0.96, 110.0),
    "sinc8": (0.2, 1.25, 150.0),
    "sinc16": (1.6, 0.85, 500.0),
}
"""Of back-projection: a pixel and pulse once, each channel of it, and each channel's bin and pulse (tables)."""

PATTERN_NS = 0.9
"""Of pattern compensation: a pixel and pulse."""

MIGRATION_NS = (45.0, 65.0)
"""Of range migration: a cell of the two-dimensional spectrum, once, and for each channel."""

RANGING_NS = 60.0
"""Of range compression: a channel's bin and pulse, whatever the method."""

REFERENCE_NS = 2500.0
"""Of plain float64 back-projection: a pixel and pulse of a channel."""

PROBE_SECONDS = 2.4e-3
"""The probe's time on the core that the table was measured on."""


def backprojection_seconds(
    interpolator: str, *, pixels: float, pulses: float, channels: int, bins: float, compensated: bool
) -> float:
    """Core time on the table's core; ``bins`` are those of one range profile."""
    once, each, table = BACKPROJECTION_NS[interpolator]
    pattern = PATTERN_NS if compensated else 0.0
    return 1e-9 * pulses * (pixels * (once + pattern + each * channels) + table * bins * channels)


def migration_seconds(
    *, wavelength_m: float, furthest_m: float, widest_rad: float, channels: int, bandwidth_share: float = 0.0
) -> float:
    """Core time on the table's core, from the size of the two-dimensional spectrum.

    Args:
        wavelength_m: of the centre frequency.
        furthest_m: end of the range profiles.
        widest_rad: largest angle from broadside in the image.
        channels: of the profiles.
        bandwidth_share: bandwidth over centre frequency.
    """
    k = 4 * math.pi / wavelength_m
    along = k * math.sin(widest_rad) * 2 * furthest_m / math.pi
    across = k * (1 - math.cos(widest_rad) * 0.8 + bandwidth_share) * 1.5 * furthest_m / (2 * math.pi)
    once, each = MIGRATION_NS
    return 1e-9 * along * across * (once + each * channels)


@functools.lru_cache(maxsize=1)
def machine_scale() -> float:
    """This core's time over that of the table's core, measured once in some 20 ms of core time."""
    x = np.linspace(0.0, 1000.0, 100_000)
    index = (x * 97).astype(np.int64) % 4096
    table = np.exp(1j * np.arange(4096.0))
    best = math.inf
    for _ in range(5):
        begun = time.thread_time()
        (table[index] * np.exp(1j * x)).sum()
        best = min(best, time.thread_time() - begun)
    return best / PROBE_SECONDS


def cores() -> int:
    """Cores that kernels may use."""
    from numba import get_num_threads

    return max(1, min(int(get_num_threads()), len(os.sched_getaffinity(0))))
