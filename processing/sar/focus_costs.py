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
    "sinc8": (0.35, 1.0, 150.0),
    "sinc16": (1.6, 0.85, 500.0),
}
"""Of back-projection: a pixel and pulse once, each channel of it, and each channel's bin and pulse (tables)."""

PATTERN_NS = 0.9
"""Of pattern compensation: a pixel and pulse."""

MIGRATION_NS = (40.0, 5.0, 11.0, 15.0)
"""Of range migration: a cell of the two-dimensional spectrum; a line and row; a sample of the rows' transforms (pixels
are among them); a bin and pulse; each for every channel."""

MIGRATION_SECONDS = 4e-3
"""Of range migration, whatever its size: many small steps."""

POLAR_NS = (70.0, 60.0, 60.0)
"""Of polar format: a pulse and wavenumber along the line of sight; a cell of the wavenumber plane; a pixel; each for
every channel."""

POLAR_SECONDS = 4e-3
"""Of polar format, whatever its size."""

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
    *, lines: float, across: float, rows: float, columns: float, pulses: float, bins: float, channels: int
) -> float:
    """Core time on the table's core.

    Args:
        lines: wavenumbers along the rail.
        across: wavenumbers across it, of each.
        rows: of the image.
        columns: samples of the transforms along the image's rows.
        pulses: positions.
        bins: of one range profile.
        channels: of the profiles.
    """
    cell, line, sample, bin_ns = MIGRATION_NS
    once = cell * lines * across + line * lines * rows + sample * rows * columns + bin_ns * bins * pulses
    return MIGRATION_SECONDS + 1e-9 * channels * once


def polar_seconds(*, along: float, across: float, pulses: float, pixels: float, channels: int) -> float:
    """Core time on the table's core.

    Args:
        along: wavenumbers along the mean line of sight.
        across: wavenumbers across it.
        pulses: of the aperture.
        pixels: of the image.
        channels: of the profiles.
    """
    pulse, cell, pixel = POLAR_NS
    return POLAR_SECONDS + 1e-9 * channels * (pulse * pulses * along + cell * along * across + pixel * pixels)


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
