"""Range migration: 600 positions of 768 bins to 1024 x 1024 pixels, on one core, turn by turn with its peers.

No package on PyPI does range migration from range profiles on a CPU (sarpy and sarkit read and write formats, fastsar
and torchbp back-project), so that the peers are the textbook's algorithm in NumPy and SciPy and our own exact
back-projection. Errors are taken on every eighth pixel of either axis against back-projection with sixteen taps, exact
to -135 dB. Times are the process's, one thread. The Stolt filters are compared by their error against float64 direct
sums and by the time of the whole image.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.range_migration_peer import textbook
from benchmarks.rows import Row
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.backprojection import backproject
from processing.sar.grid import ImageGrid
from processing.sar.peak_search import find_peaks
from processing.sar.range_migration import range_migration
from processing.sar.range_migration_reference import range_migration_reference
from processing.sar.stolt import FILTERS

LIMIT_S = 0.1
LIMIT_DB = -50.0
PEAK_CELLS = 0.05
COARSE = 8


@dataclass(frozen=True)
class Case:
    """A rail, its waveform and its image."""

    name: str
    centre_hz: float
    bandwidth_hz: float
    step_m: float
    bins_per_cell: int
    first_range_m: float
    x_m: tuple[float, float]
    y_m: tuple[float, float]
    height_m: float
    supported: bool = True
    """Whether it is within the swath that the limits are for."""


CASES = (
    Case("10 GHz, 4.5 m, 13 degrees", 10e9, 500e6, 0.0075, 4, 30.0, (-6, 6), (36, 80), 2.0),
    Case("15 GHz, 3.3 m, 29 degrees", 15e9, 750e6, 0.0055, 4, 8.0, (-4, 4), (10, 40), 1.0),
    Case("2.4 GHz, 30 m, 54 degrees", 2.4e9, 80e6, 0.0508, 8, 15.0, (-15, 15), (22, 120), 1.1),
    Case("2.4 GHz, 30 m, 72 degrees", 2.4e9, 80e6, 0.0508, 8, 0.0, (-15, 15), (10, 120), 1.1, supported=False),
)


def collect(case: Case, positions: int, bins: int, side: int, targets: int = 12) -> tuple[RangeProfiles, ImageGrid]:
    """Closed-form profiles of random point targets, unweighted, and the grid."""
    rng = np.random.default_rng(0)
    x = (np.arange(positions) - (positions - 1) / 2) * case.step_m
    antenna = np.column_stack([x, np.zeros((positions, 2))])
    cell = SPEED_OF_LIGHT_M_S / 2 / case.bandwidth_hz
    ranges = case.first_range_m + cell / case.bins_per_cell * np.arange(bins)
    grid = ImageGrid(np.linspace(*case.x_m, side), np.linspace(*case.y_m, side), -case.height_m)
    k = 4 * np.pi * case.centre_hz / SPEED_OF_LIGHT_M_S
    values = np.zeros((positions, bins), dtype=complex)
    near, far = case.y_m[0] * 1.05, case.y_m[1] * 0.97
    for a, b in zip(rng.uniform(*case.x_m, targets) * 0.9, rng.uniform(near, far, targets), strict=True):
        away = np.sqrt((a - x) ** 2 + b**2 + case.height_m**2)[:, None]
        values += np.sinc((ranges - away) / cell) * np.exp(-1j * k * away)
    profiles = RangeProfiles(
        values[None].astype(np.complex64), ranges, antenna, ("HH",), case.centre_hz, case.bandwidth_hz, "rectangular",
        True,
    )  # fmt: skip
    return profiles, grid


def error_db(image: NDArray[np.complexfloating], truth: NDArray[np.complexfloating]) -> float:
    """Root mean square error, dB, without any factor fitted, where both are defined."""
    use = np.isfinite(image) & np.isfinite(truth)
    return float(20 * np.log10(np.linalg.norm((image - truth)[use]) / np.linalg.norm(truth[use])))


def timed(tasks: dict[str, Callable[[], object]], rounds: int) -> dict[str, NDArray[np.float64]]:
    """Process seconds of tasks, turn by turn; the first turn does not count."""
    seconds: dict[str, list[float]] = {name: [] for name in tasks}
    for turn in range(rounds + 1):
        for name, task in tasks.items():
            begun = time.process_time()
            task()
            if turn:
                seconds[name].append(time.process_time() - begun)
    return {name: np.array(spent) for name, spent in seconds.items()}


def run(quick: bool) -> list[Row]:
    """Speed, error and peaks of each case; the textbook as peer; the filters."""
    import numba

    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        positions, bins, side = (150, 768, 256) if quick else (600, 768, 1024)
        rows = [row for case in CASES for row in _case(case, positions, bins, side, 3 if quick else 7, quick)]
        return [*rows, *_filters(quick)]
    finally:
        numba.set_num_threads(threads)


def _case(case: Case, positions: int, bins: int, side: int, rounds: int, quick: bool) -> list[Row]:
    profiles, grid = collect(case, positions, bins, side)
    coarse = ImageGrid(grid.x_m[::COARSE], grid.y_m[::COARSE], grid.z_m)
    exact = backproject(profiles, coarse, interpolator="sinc16")[0]
    image = range_migration(profiles, grid)[0]
    error = error_db(image[::COARSE, ::COARSE], exact)
    tasks: dict[str, Callable[[], object]] = {
        "ours": lambda: range_migration(profiles, grid), "bp": lambda: backproject(profiles, grid),
    }  # fmt: skip
    if case is CASES[0]:
        tasks["textbook"] = lambda: textbook(profiles, grid)
    seconds = timed(tasks, rounds)
    own = float(np.median(seconds["ours"]))
    told = f"{positions} x {bins} to {side} x {side}, {case.name}: {own:.3f} s"
    if not case.supported:
        told += " (outside of the swath that the limit is for)"
    good = error < LIMIT_DB and (own < LIMIT_S or not case.supported)
    wanted = f"below {LIMIT_S:g} s and {LIMIT_DB:g} dB"
    rows = [
        Row(
            f"speed.range_migration {told}", f"{LIMIT_S:g} s", own / LIMIT_S, bool(good), wanted,
            float(seconds["ours"].min()) / LIMIT_S, float(seconds["ours"].max()) / LIMIT_S, round(error, 1),
        )
    ]  # fmt: skip
    for peer, name in (("bp", "exact back-projection (ours)"), ("textbook", "textbook omega-k, NumPy and SciPy")):
        if peer not in seconds:
            continue
        ratios = seconds[peer] / seconds["ours"]
        theirs = None if peer == "bp" else round(error_db(textbook(profiles, coarse), exact), 1)
        rows.append(
            Row(
                f"speed.range_migration {case.name}", name, float(np.median(ratios)), bool(np.median(ratios) > 1),
                "times as fast", float(ratios.min()), float(ratios.max()), round(error, 1), theirs,
            )
        )  # fmt: skip
    rows.append(_peaks(case, profiles, grid, image))
    return rows


def _peaks(case: Case, profiles: RangeProfiles, grid: ImageGrid, image: NDArray[np.complexfloating]) -> Row:
    """The strongest peak against back-projection's around it, in cells of the narrower axis there."""
    peak = find_peaks(np.abs(image), grid, 1)[0]
    step = float(grid.x_m[1] - grid.x_m[0]), float(grid.y_m[1] - grid.y_m[0])
    reach = [max(24, round(3 * profiles.resolution_m / size)) for size in step]
    column, row = (int(np.argmin(np.abs(axis - at))) for axis, at in ((grid.x_m, peak.x_m), (grid.y_m, peak.y_m)))
    columns = slice(max(0, column - reach[0]), column + reach[0])
    rows = slice(max(0, row - reach[1]), row + reach[1])
    chip = ImageGrid(grid.x_m[columns], grid.y_m[rows], grid.z_m)
    found = [
        find_peaks(np.abs(part), chip, 1)[0]
        for part in (image[rows, columns], backproject(profiles, chip, interpolator="sinc16")[0])
    ]
    aperture = float(np.ptp(profiles.antenna_m[:, 0]))
    narrow = 0.886 * profiles.wavelength_m * np.hypot(peak.y_m, grid.z_m) / (2 * aperture)
    off = max(abs(found[0].x_m - found[1].x_m) / narrow, abs(found[0].y_m - found[1].y_m) / profiles.resolution_m)
    return Row(
        f"speed.range_migration peak, {case.name}", "back-projection", None, bool(off < PEAK_CELLS),
        f"within {PEAK_CELLS:g} cell", error=f"{off:.4f} cell",
    )  # fmt: skip


def _filters(quick: bool) -> list[Row]:
    """Error of each Stolt filter against direct float64 sums on a small image, and time of the large one."""
    profiles, _ = collect(CASES[1], 120, 384, 16)
    small = ImageGrid(np.linspace(-0.6, 0.6, 12), np.linspace(11.0, 15.0, 12), -1.0)
    plain = range_migration_reference(profiles, small)[0]
    large, grid = collect(CASES[1], *((150, 768, 256) if quick else (600, 768, 1024)))
    seconds = timed(
        {name: (lambda name=name: range_migration(large, grid, taps=name)) for name in FILTERS}, 3 if quick else 7
    )
    rows = []
    own = seconds["kaiser-bessel"]
    errors = {name: error_db(range_migration(profiles, small, taps=name)[0], plain) for name in FILTERS}
    for name, taps in FILTERS.items():
        ratios = seconds[name] / own
        rows.append(
            Row(
                f"speed.range_migration Stolt by {name}, {taps.taps} taps at {taps.oversampling:g} times the bins",
                "kaiser-bessel", float(np.median(ratios)), bool(errors["kaiser-bessel"] <= min(errors.values()) + 3),
                "the filter in use is the most exact for its time", float(ratios.min()), float(ratios.max()),
                round(errors[name], 1), round(errors["kaiser-bessel"], 1),
            )
        )  # fmt: skip
    return rows
