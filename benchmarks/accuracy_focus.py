"""Error of exact back-projection: of its filters against the matched filter, and of its arithmetic near and far."""

from __future__ import annotations

import numpy as np

from benchmarks.focus_scene import airborne, error_db
from benchmarks.rows import Row
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.backprojection import backproject, backproject_reference
from processing.sar.grid import ImageGrid
from processing.sar.interpolation import tap_weights

FILTERS_DB = {"linear": -32.0, "cubic": -51.0, "lagrange4": -54.0, "sinc8": -94.0}
"""Error to be reached at four bins per cell on the thesis's rail."""

ARITHMETIC_DB = -90.0


def run(quick: bool) -> list[Row]:
    """Filters on the rail, arithmetic from 0.1 m to 1000 km, and an airborne image against the exact sum."""
    rows = [*_filters(), *(_arithmetic(range_m) for range_m in (0.1, 10.0, 1e3, 1e6))]
    collect = airborne(512, 40 if quick else 150)
    chosen = np.arange(7, 512, 41)
    truth = collect.exact(chosen, chosen)
    for name in FILTERS_DB:
        image = backproject(collect.profiles(4), collect.grid, interpolator=name)[0][np.ix_(chosen, chosen)]
        rows.append(_row(f"focus.airborne_{name}", error_db(image, truth), _worst_in_band_db(name)))
    return rows


def _worst_in_band_db(interpolator: str) -> float:
    """Error of a filter at the frequency of the band where it is worst, dB: no image errs by more, whatever is in it.

    The chosen pixels show side lobes, whose energy lies at the band's edges, where filters are worst.
    """
    fractions, cycles = np.linspace(0, 1, 65), np.linspace(-0.5, 0.5, 65) / 4
    weights = tap_weights(interpolator, fractions, 4)
    bins = np.arange(1 - weights.shape[1] // 2, weights.shape[1] // 2 + 1)
    error = weights @ np.exp(2j * np.pi * np.outer(bins, cycles)) - np.exp(2j * np.pi * np.outer(fractions, cycles))
    return float(np.round(20 * np.log10(np.sqrt(np.mean(np.abs(error) ** 2, axis=0)).max()), 1))


def _row(name: str, error: float, limit: float) -> Row:
    return Row(name, "", None, error < limit, f"below {limit:g} dB", error=round(error, 1))


def _filters() -> list[Row]:
    """Against ``sum S(f) exp(+j k R)`` in float64, unweighted, which fills the band to its edges."""
    light, centre, band, count = SPEED_OF_LIGHT_M_S, 2.4e9, 80e6, 256
    antenna = np.column_stack([(np.arange(61) - 30) * 0.0508, np.zeros((61, 2))])
    k = 4 * np.pi / light * (centre + band * ((np.arange(count) + 0.5) / count - 0.5))
    k0 = 4 * np.pi * centre / light
    targets = [(0.0, 10.0), (3, 10), (-5, 20), (0, 30), (8, 30), (-12, 40), (2, 5)]
    echo = sum(np.exp(-1j * k * np.hypot(x - antenna[:, :1], y)) for x, y in targets) / count
    grid = ImageGrid(np.arange(-16, 16, 0.6), np.arange(3, 45, 0.8), 0.0)
    truth = np.zeros(grid.shape, dtype=complex)
    for place, pulse in zip(antenna, echo, strict=True):
        away = np.hypot(grid.x_m - place[0], grid.y_m[:, None])
        truth += np.exp(1j * away[..., None] * k) @ pulse / len(antenna)
    axis = light / (2 * band) / 4 * np.arange(-40, 140)
    profiles = RangeProfiles(
        (echo @ np.exp(1j * np.outer(k - k0, axis)))[None], axis, antenna, ("HH",), centre, band, "rectangular", True
    )
    return [
        _row(f"focus.rail_{name}", error_db(backproject(profiles, grid, interpolator=name)[0], truth), limit + 0.5)
        for name, limit in FILTERS_DB.items()
    ]


def _arithmetic(range_m: float) -> Row:
    """Against float64 with the same filter, the worst of the four."""
    light, centre, band = SPEED_OF_LIGHT_M_S, 5e9, 0.5e9
    length = 0.05 if range_m < 1 else 0.03 * range_m
    antenna = np.column_stack([np.linspace(-length / 2, length / 2, 25), np.full(25, -range_m), np.zeros(25)])
    step = 0.002 if range_m < 1 else 0.05
    grid = ImageGrid(step * np.arange(-40, 41), step * np.arange(-32, 33) + 0.02, 0.0)
    away = np.hypot(antenna[:, 0] - 3.3 * step, antenna[:, 1] - 0.02)
    start = np.linalg.norm(antenna, axis=1)
    axis = light / (2 * band) / 4 * np.arange(-160, 160)
    turns = 2 * centre / light * away
    echo = np.sinc((axis + (start - away)[:, None]) * 2 * band / light)
    values = echo * np.exp(-2j * np.pi * (turns - np.rint(turns)))[:, None]
    profiles = RangeProfiles(values[None], axis, antenna, ("HH",), centre, band, "rectangular", True, start_m=start)
    worst = max(
        error_db(
            backproject(profiles, grid, interpolator=name)[0],
            backproject_reference(profiles, grid, interpolator=name)[0],
        )
        for name in FILTERS_DB
    )
    return _row(f"focus.arithmetic_{range_m:g}m", worst, ARITHMETIC_DB)
