"""Focusing and ranging: points whose profiles, and whose image by the exact sum, have closed forms."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polfuse_lab.trade.rows import Row, relative_db, timed
from processing.radar.beat import TriangleFm, beat_of_ranges
from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.radar.ranging import Sweeps, compress, compress_reference
from processing.sar.aperture import widest_angle_rad
from processing.sar.backprojection import backproject, backproject_reference
from processing.sar.factorized import factorized
from processing.sar.grid import ImageGrid
from processing.sar.planner import Choice, Task, choices
from processing.sar.range_migration import range_migration
from processing.sar.straight_track import straight_track

MARGIN_CELLS = 24
"""Resolution cells by which profiles reach beyond the image."""
FACTORIZED_DB = (-40.0, -60.0, -80.0)
"""Tolerances that factorized back-projection is set by."""
OVERSAMPLINGS = (2, 4, 8)
REFERENCE_AT = 8
"""Bins per cell of the plain float64 sum with the same filter as the fast one."""


@dataclass(frozen=True)
class Size:
    """How much work: a straight track before a plane with points on it."""

    name: str
    positions: int
    step_m: float
    columns: int
    rows: int
    pixel_m: tuple[float, float]
    nearest_m: float
    centre_hz: float
    bandwidth_hz: float

    @property
    def antenna_m(self) -> NDArray[np.float64]:
        """(positions, 3)."""
        x = (np.arange(self.positions) - (self.positions - 1) / 2) * self.step_m
        return np.column_stack([x, np.zeros((self.positions, 2))])

    @property
    def grid(self) -> ImageGrid:
        """The image's pixels."""
        x = (np.arange(self.columns) - (self.columns - 1) / 2) * self.pixel_m[0]
        y = self.nearest_m + np.arange(self.rows) * self.pixel_m[1]
        return ImageGrid(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64), -1.0)


SIZES = (
    Size("small", 17, 0.0508, 48, 40, (0.15, 0.4), 4.0, 2.4e9, 80e6),
    Size("thesis", 61, 0.0508, 161, 86, (0.1, 0.2), 3.0, 2.4e9, 80e6),
    Size("airborne", 256, 0.5, 160, 160, (0.2, 0.15), 9_988.0, 10e9, 600e6),
)


class Points:
    """Points before a track: their profiles, and their exact image."""

    def __init__(self, size: Size, seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        self.size, self.antenna, self.grid = size, size.antenna_m, size.grid
        x, y = self.grid.x_m, self.grid.y_m
        self.targets = np.column_stack(
            [0.7 * rng.uniform(x[0], x[-1], 6), y[0] + np.ptp(y) * rng.uniform(0.15, 0.85, 6), np.full(6, -1.0)]
        )
        self.amplitudes = np.exp(2j * np.pi * rng.uniform(size=6)) * rng.uniform(0.5, 1.5, 6)
        self.cell = SPEED_OF_LIGHT_M_S / (2 * size.bandwidth_hz)
        self.turns_per_m = 2 * size.centre_hz / SPEED_OF_LIGHT_M_S
        corners = np.array([[a, b, -1.0] for a in (x[0], 0.0, x[-1]) for b in (y[0], y[-1])])
        away = np.linalg.norm(corners[:, None] - self.antenna, axis=2)
        self.near, self.far = float(away.min()), float(away.max())

    def profiles(self, oversampling: int) -> RangeProfiles:
        """At so many bins per resolution cell, complex64 as ranging makes them."""
        first = self.near - MARGIN_CELLS * self.cell
        last = self.far + MARGIN_CELLS * self.cell
        r = np.arange(first, last, self.cell / oversampling)
        values = np.zeros((len(self.antenna), len(r)), dtype=np.complex128)
        for target, amplitude in zip(self.targets, self.amplitudes, strict=True):
            at = np.linalg.norm(target - self.antenna, axis=1)[:, None]
            turns = self.turns_per_m * at
            values += amplitude * np.sinc((r - at) / self.cell) * np.exp(-2j * np.pi * (turns - np.rint(turns)))
        return RangeProfiles(
            values[None].astype(np.complex64), r, self.antenna, ("HH",), self.size.centre_hz, self.size.bandwidth_hz,
            "rectangular", True,
        )  # fmt: skip

    def exact(self) -> NDArray[np.complex128]:
        """The exact sum: all of the image, since side lobes alone would show filters where they are worst."""
        total = np.zeros(self.grid.shape, dtype=np.complex128)
        for row, y in enumerate(self.grid.y_m):
            away = np.sqrt((self.grid.x_m[:, None] - self.antenna[:, 0]) ** 2 + y**2 + self.grid.z_m**2)
            for target, amplitude in zip(self.targets, self.amplitudes, strict=True):
                further = away - np.linalg.norm(target - self.antenna, axis=1)
                seen = np.sinc(further / self.cell) * np.exp(2j * np.pi * self.turns_per_m * further)
                total[row] += amplitude * seen.mean(axis=-1)
        return total


def planned(points: Points) -> Task:
    """What the planner is told."""
    size = points.size
    wavelength = SPEED_OF_LIGHT_M_S / size.centre_hz
    return Task(
        pixels=size.rows * size.columns, pulses=size.positions, channels=1, oversampling=None, wavelength_m=wavelength,
        furthest_m=points.far, widest_rad=widest_angle_rad(points.antenna, points.grid),
        residual_m=straight_track(points.antenna, wavelength).residual_m, compensated=False,
        antenna_m=points.antenna, grid=points.grid, bandwidth_hz=size.bandwidth_hz,
        depth_m=points.far - points.near + 2 * MARGIN_CELLS * points.cell, oversamplings=OVERSAMPLINGS,
    )  # fmt: skip


def focus_rows(size: Size, rounds: int) -> Iterator[Row]:
    """Every method, filter and oversampling on one size of work."""
    points = Points(size)
    truth = points.exact()
    task, name = planned(points), f"focus.{size.name}"
    offered = choices(task, FACTORIZED_DB[0])
    profiles = {bins: points.profiles(bins) for bins in OVERSAMPLINGS}

    def row(setting: str, seconds: float, image: NDArray[np.complexfloating], expected: Choice | None) -> Row:
        error = relative_db(image[0], truth)
        return Row(name, setting, seconds, error, None if expected is None else expected.predicted_error_db)

    for choice in offered:
        bins = int(choice.oversampling)
        made = profiles[bins]
        if choice.method == "bp":
            seconds, image = timed(lambda: backproject(made, points.grid, interpolator=choice.interpolator), rounds)  # noqa: B023
            yield row(f"bp {choice.interpolator} x{bins}", seconds, image, choice)
        elif choice.method == "rma" and bins == OVERSAMPLINGS[0]:
            seconds, image = timed(lambda: range_migration(made, points.grid), rounds)  # noqa: B023
            yield row("rma", seconds, image, choice)
    for tolerance in FACTORIZED_DB:
        (expected, *_) = [c for c in choices(task, tolerance) if c.method == "ffbp" and c.oversampling == 4]
        seconds, image = timed(
            lambda: factorized(profiles[4], points.grid, tolerance_db=tolerance),  # noqa: B023
            rounds,
        )
        yield row(f"ffbp {tolerance:g} dB", seconds, image, expected)
    if size.positions * size.rows * size.columns < 2_000_000:
        seconds, plain = timed(lambda: backproject_reference(profiles[REFERENCE_AT], points.grid), 1)
        yield row(f"reference x{REFERENCE_AT}", seconds, plain, None)


def ranging_rows(rounds: int) -> Iterator[Row]:
    """Zero padding (level of a target half-way between bins), and windows (what leaks beyond four cells)."""
    cell = SPEED_OF_LIGHT_M_S / (2 * 80e6)
    for padding in (1, 2, 4, 8, 16):
        away = cell * (12 + 0.5 / padding)
        axis = _ranges(cell / padding, 40 * padding)
        sweeps = _one_target(away)
        seconds, made = timed(lambda: _profile(sweeps, axis), rounds)  # noqa: B023
        peak = compress_reference(sweeps, np.array([away]), centre_hz=2.4e9, bandwidth_hz=80e6)[0, 0]
        error = float(20 * np.log10(max(1 - np.abs(made).max() / abs(peak), 1e-16)))
        yield Row("ranging.padding", f"x{padding}", seconds, error)
    sweeps, axis = _one_target(12 * cell), _ranges(cell / 8, 40 * 8)
    for window in ("rectangular", "hann", "taylor"):
        seconds, made = timed(lambda: _profile(sweeps, axis, window), rounds)  # noqa: B023
        outside = np.abs(axis - 12 * cell) > 4 * cell
        leak = float(np.sqrt(np.mean(np.abs(made[outside]) ** 2)) / np.abs(made).max())
        yield Row("ranging.window", window, seconds, 20 * math.log10(leak))


def _ranges(step_m: float, count: int) -> NDArray[np.float64]:
    return np.asarray(step_m * np.arange(count), dtype=np.float64)


def _one_target(away_m: float) -> Sweeps:
    """A sweep of the thesis's radar at 48 kHz."""
    fm = TriangleFm(centre_hz=2.4e9, bandwidth_hz=80e6, ramp_up_s=0.02, period_s=0.04)
    rate, count = 48_000.0, 960
    frequency, slope = fm.frequency((np.arange(count) + 0.5) / rate)
    return Sweeps(
        beat_of_ranges(frequency, slope, [away_m], [1.0])[None], np.array([0.5]), float(count), rate, np.zeros(1)
    )


def _profile(sweeps: Sweeps, range_m: NDArray[np.float64], window: str = "hann") -> NDArray[np.complex128]:
    return np.asarray(compress(sweeps, range_m, centre_hz=2.4e9, bandwidth_hz=80e6, window=window)[0])
