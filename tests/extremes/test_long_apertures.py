"""Apertures of a hundred thousand positions and small images: no warning, the float64 sum, memory that is bounded."""

from __future__ import annotations

import math
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.backprojection import backproject, backproject_reference
from processing.sar.factorized import factorized
from processing.sar.grid import ImageGrid
from processing.sar.range_migration import range_migration

POSITIONS = 100_000
CENTRE_HZ, BANDWIDTH_HZ = 1e9, 50e6
CELL_M = SPEED_OF_LIGHT_M_S / (2 * BANDWIDTH_HZ)
AWAY_M, STEP_M = 20_000.0, 0.05
TARGET = (37.0, AWAY_M + 4.0)
TURNS_PER_M = 2 * CENTRE_HZ / SPEED_OF_LIGHT_M_S


def collect(bins_per_cell: int) -> RangeProfiles:
    """A point seen from 5 km of straight track: profiles of 64 cells, 50 to 100 MB."""
    x = (np.arange(POSITIONS) - (POSITIONS - 1) / 2) * STEP_M
    antenna = np.column_stack([x, np.zeros((POSITIONS, 2))])
    r = AWAY_M - 10 * CELL_M + CELL_M / bins_per_cell * np.arange(70 * bins_per_cell)
    values = np.empty((1, POSITIONS, len(r)), dtype=np.complex64)
    for part in np.array_split(np.arange(POSITIONS), 50):
        away = np.hypot(TARGET[0] - x[part], TARGET[1])[:, None]
        turns = TURNS_PER_M * away
        values[0, part] = np.sinc((r - away) / CELL_M) * np.exp(-2j * np.pi * (turns - np.rint(turns)))
    return RangeProfiles(values, r, antenna, ("HH",), CENTRE_HZ, BANDWIDTH_HZ, "rectangular", True)


@pytest.fixture(scope="module")
def profiles() -> RangeProfiles:
    return collect(2)


GRID = ImageGrid(TARGET[0] + np.linspace(-2.0, 2.0, 5), TARGET[1] + np.linspace(-3.0, 3.0, 3), 0.0)


def relative_db(found: np.ndarray, true: np.ndarray) -> float:
    assert np.all(np.isfinite(found))
    return float(20 * np.log10(np.linalg.norm(found - true) / np.linalg.norm(true)))


def exact(antenna: np.ndarray) -> np.ndarray:
    """The image in closed form, summed in float64: what the matched filter of all positions gives."""
    total = np.empty(GRID.shape, dtype=np.complex128)
    target = np.hypot(TARGET[0] - antenna[:, 0], TARGET[1])
    for row, y in enumerate(GRID.y_m):
        for column, x in enumerate(GRID.x_m):
            further = np.hypot(x - antenna[:, 0], y) - target
            total[row, column] = np.mean(np.sinc(further / CELL_M) * np.exp(2j * np.pi * TURNS_PER_M * further))
    return total


def test_sums_of_a_hundred_thousand_positions(profiles: RangeProfiles) -> None:
    """Sums in float32 err by the root of their terms: -136 dB a pixel. The filter of 16 taps leaves -122.9 dB."""
    tracemalloc.start()
    image = backproject(profiles, GRID, interpolator="sinc16")[0]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert relative_db(image, exact(profiles.antenna_m)) < -100
    # Beside the profiles nothing grows with positions times pixels.
    assert peak < 2 * profiles.values.nbytes


def test_factorized_sums_are_within_their_tolerance(profiles: RangeProfiles) -> None:
    """Of the middle's positions: all of them take half a minute, with the same result."""
    part = slice(POSITIONS // 2 - 2000, POSITIONS // 2 + 2000)
    some = replace(profiles, values=profiles.values[:, part], antenna_m=profiles.antenna_m[part])
    quick = factorized(some, GRID, tolerance_db=-40.0)[0]
    assert relative_db(quick, exact(some.antenna_m)) < -40


def test_range_migration_of_a_long_rail(profiles: RangeProfiles) -> None:
    tracemalloc.start()
    migrated = range_migration(profiles, GRID)[0]
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert relative_db(migrated, exact(profiles.antenna_m)) < -50
    assert peak < 12 * profiles.values.nbytes


def test_two_hundred_decibels_beside_each_other() -> None:
    """A point a tenth of a millionth of a millionth in power of its neighbour, where that has no side lobes.

    The strong one's profiles end before the weak one's begin: what float32 sums lose of the strong must not be felt.
    """
    count, weak = 64, 1e-10
    x = (np.arange(count) - (count - 1) / 2) * 0.05
    antenna = np.column_stack([x, np.zeros((count, 2))])
    r = 10.0 + CELL_M / 4 * np.arange(200)
    places, values = ((0.0, 10.0 + 10 * CELL_M), (0.0, 10.0 + 40 * CELL_M)), np.zeros((1, count, 200), np.complex64)
    for (px, py), amplitude in zip(places, (1.0, weak), strict=True):
        away = np.hypot(px - x, py)[:, None]
        near = np.abs(r - away) < 6 * CELL_M
        values[0] += np.where(
            near, amplitude * np.sinc((r - away) / CELL_M) * np.exp(-2j * np.pi * TURNS_PER_M * away), 0
        )
    profiles = RangeProfiles(values, r, antenna, ("HH",), CENTRE_HZ, BANDWIDTH_HZ, "rectangular", True)
    grid = ImageGrid(np.array([0.0]), np.array([py for _, py in places]), 0.0)
    for image in (backproject(profiles, grid), backproject_reference(profiles, grid)):
        strong, faint = (float(abs(value)) for value in image[0, :, 0])
        assert strong == pytest.approx(1.0, abs=2e-3)
        assert faint == pytest.approx(weak, rel=2e-3)
        assert 20 * math.log10(faint / strong) == pytest.approx(-200, abs=0.05)
