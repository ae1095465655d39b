"""Memory that focusing takes at its peak, over that of profiles and image; the fixed part is told apart.

Taken from the process' own peak of resident memory (Linux), which counts what compiled kernels take as well.
"""

from __future__ import annotations

import ctypes
import gc
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row
from benchmarks.speed_factorized import OVERSAMPLING, PIXEL_M, scene
from benchmarks.speed_range_migration import CASES, collect
from processing.radar.phase_history import history_profiles
from processing.radar.profiles import RangeProfiles
from processing.sar.backprojection import backproject
from processing.sar.factorized import factorized
from processing.sar.grid import ImageGrid
from processing.sar.polar_format import polar_format
from processing.sar.range_migration import range_migration

Method = Callable[[RangeProfiles, ImageGrid], NDArray[np.complex64]]

TIMES = 3.0
"""Of image and profiles together, at most, besides the fixed part."""

FIXED_BYTES = 24e6
"""What does not grow with the task: tables of a block of pulses (16 MB), numbers of a part's grid, threads' own."""

METHODS: dict[str, tuple[Method, tuple[tuple[int, int], ...]]] = {
    "backprojection": (backproject, ((128, 150), (512, 600), (2048, 2400))),
    "factorized": (factorized, ((128, 150), (512, 600), (2048, 2400))),
    "polar format": (polar_format, ((128, 150), (512, 600), (1024, 1200))),
    "range migration": (range_migration, ((512, 300), (1024, 600), (2048, 1200))),
}
"""Methods, and sides of images and pulses: polar format takes no larger scene, range migration's is 8 m x 30 m."""

_STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def _kilobytes(name: str) -> int:
    line = next(line for line in _STATUS.read_text().splitlines() if line.startswith(name))
    return int(line.split()[1])


def peak_bytes(work: Callable[[], object]) -> float:
    """Resident memory that a call adds at its peak, what it returns included.

    Raises:
        OSError: the system does not tell.
    """
    # What earlier work freed but the allocator holds would serve this one without being counted.
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(0)
    _CLEAR.write_text("5")
    before = _kilobytes("VmRSS")
    kept = work()
    peak = _kilobytes("VmHWM")
    del kept
    return 1024.0 * max(peak - before, 0)


def measure(side: int, pulses: int, method: Method) -> tuple[float, float]:
    """Peak, profiles included, and image and profiles together, bytes."""
    history, _ = scene(side, pulses, targets=1)
    profiles = history_profiles(history, window="rectangular", oversampling=OVERSAMPLING[-50.0])
    del history
    axis = (np.arange(side) - side / 2) * PIXEL_M
    grid = ImageGrid(axis, axis, 0.0)
    needed = float(profiles.values.nbytes + 8 * side * side)
    return profiles.values.nbytes + peak_bytes(lambda: method(profiles, grid)), needed


def measure_migration(side: int, pulses: int, method: Method = range_migration) -> tuple[float, float]:
    """As :func:`measure` on a rail that sees its scene under 29 degrees."""
    profiles, grid = collect(CASES[1], pulses, 768, side, targets=1)
    needed = float(profiles.values.nbytes + 8 * side * side)
    return profiles.values.nbytes + peak_bytes(lambda: method(profiles, grid)), needed


def run(quick: bool) -> list[Row]:
    """Small and large images by every method."""
    rows = []
    for name, (method, sizes) in METHODS.items():
        sized = measure_migration if method is range_migration else measure
        try:
            sized(64, 64, method)  # what is compiled or loaded the first time is not the task's
            for side, pulses in sizes[:2] if quick else sizes:
                peak, needed = sized(side, pulses, method)
                rows.append(
                    Row(
                        f"speed.focus_memory {name} {side} x {side} x {pulses}", "image and profiles",
                        peak / needed, peak < TIMES * needed + FIXED_BYTES,
                        f"below {TIMES:g} times and {FIXED_BYTES / 1e6:g} MB; beyond {TIMES:g} times: "
                        f"{max(peak - TIMES * needed, 0) / 1e6:.1f} MB",
                        error=f"{peak / 1e6:.1f} MB for {needed / 1e6:.1f} MB",
                    )
                )  # fmt: skip
        except OSError as error:
            rows.append(Row(f"speed.focus_memory {name}", "", None, True, f"not measured: {error}"))
    return rows
