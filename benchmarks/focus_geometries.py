"""Random collects of point targets whose profiles and exact images have closed forms."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.grid import ImageGrid
from processing.sar.resolution import point_resolution

SHIFTED = {"rectangular": ((0, 1.0),), "hann": ((0, 1.0), (-1, 0.5), (1, 0.5))}
"""Envelopes of the windows as sincs shifted by whole cells: (cells, amplitude)."""

MARGIN_CELLS = 24
"""Resolution cells by which profiles reach beyond the ranges of the image."""


@dataclass(frozen=True)
class Collect:
    """A track, a scene of points, and the grid to focus it on."""

    kind: str
    """``"rail"``, ``"bent rail"``, ``"circle"`` or ``"flight"``."""
    antenna_m: NDArray[np.float64]
    """(positions, 3)."""
    targets_m: NDArray[np.float64]
    """(targets, 3)."""
    amplitudes: NDArray[np.complex128]
    """(targets,)."""
    grid: ImageGrid
    centre_hz: float
    bandwidth_hz: float
    window: str

    @property
    def cell_m(self) -> float:
        """c / 2B."""
        return SPEED_OF_LIGHT_M_S / (2 * self.bandwidth_hz)

    def profiles(self, oversampling: float) -> RangeProfiles:
        """Closed form at ``oversampling`` bins per cell, complex64 as ranging makes them."""
        step = self.cell_m / oversampling
        places = np.stack([axis.ravel() for axis in self.grid.places_m()], axis=1)
        corners = places[[0, self.grid.shape[1] - 1, -self.grid.shape[1], -1, len(places) // 2]]
        away = np.linalg.norm(corners[:, None] - self.antenna_m, axis=2)
        near = self._nearest()
        r = np.arange(near - MARGIN_CELLS * self.cell_m, away.max() + MARGIN_CELLS * self.cell_m, step)
        values = np.zeros((len(self.antenna_m), len(r)), dtype=np.complex128)
        for target, amplitude in zip(self.targets_m, self.amplitudes, strict=True):
            at = np.linalg.norm(target - self.antenna_m, axis=1)[:, None]
            values += amplitude * self._envelope((r - at) / self.cell_m) * np.exp(-1j * self.k_rad_m * at)
        return RangeProfiles(
            values[None].astype(np.complex64), r, self.antenna_m, ("HH",), self.centre_hz, self.bandwidth_hz,
            self.window, True,
        )  # fmt: skip

    def image(self) -> NDArray[np.complex128]:
        """What exact back-projection gives, float64: ``1/P sum_n sum_t a w(R_n(p) - R_n(t)) exp(j k (...))``."""
        x, y, z = self.grid.places_m()
        total = np.zeros(self.grid.shape, dtype=np.complex128)
        for place in self.antenna_m:
            away = np.sqrt((x - place[0]) ** 2 + (y - place[1]) ** 2 + (z - place[2]) ** 2)
            for target, amplitude in zip(self.targets_m, self.amplitudes, strict=True):
                further = away - float(np.linalg.norm(target - place))
                total += amplitude * self._envelope(further / self.cell_m) * np.exp(1j * self.k_rad_m * further)
        return total / len(self.antenna_m)

    @property
    def k_rad_m(self) -> float:
        """4 pi centre / c."""
        return 4 * math.pi * self.centre_hz / SPEED_OF_LIGHT_M_S

    def _nearest(self) -> float:
        x, y = self.grid.x_m, self.grid.y_m
        beside = [np.maximum(np.maximum(axis.min() - a, a - axis.max()), 0.0)
                  for axis, a in ((x, self.antenna_m[:, 0]), (y, self.antenna_m[:, 1]))]  # fmt: skip
        return float(np.sqrt(beside[0] ** 2 + beside[1] ** 2 + (self.grid.z_m - self.antenna_m[:, 2]) ** 2).min())

    def _envelope(self, cells: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(sum(weight * np.sinc(cells - shift) for shift, weight in SHIFTED[self.window]))


def random_collect(seed: int, *, kinds: tuple[str, ...] = ("rail", "bent rail", "circle", "flight")) -> Collect:
    """A collect drawn from rails of some metres to flights of kilometres: wavelength, band, track, scene, window."""
    rng = np.random.default_rng(seed)
    kind = str(rng.choice(kinds))
    window = str(rng.choice(list(SHIFTED)))
    centre = float(10 ** rng.uniform(9.2, 10.2))
    wavelength = SPEED_OF_LIGHT_M_S / centre
    bandwidth = centre * float(rng.uniform(0.02, 0.12))
    cell = SPEED_OF_LIGHT_M_S / (2 * bandwidth)
    positions = int(rng.integers(40, 160))
    near = cell * float(rng.uniform(4, 20))
    if kind in ("rail", "bent rail"):
        step = wavelength * float(rng.uniform(0.2, 0.45))
        antenna = np.zeros((positions, 3))
        antenna[:, 0] = (np.arange(positions) - (positions - 1) / 2) * step
        if kind == "bent rail":
            bend = float(rng.uniform(0.2, 2.0)) * wavelength
            antenna[:, 1] = bend * (2 * antenna[:, 0] / np.ptp(antenna[:, 0])) ** 2
        middle, z = np.array([antenna[-1, 0] * float(rng.uniform(-1, 1)), near + 6 * cell]), -float(rng.uniform(0.5, 3))
    elif kind == "circle":
        radius, turn = near + 10 * cell, float(rng.uniform(0.1, 0.6))
        angle = np.linspace(-turn, turn, positions)
        antenna = np.stack([radius * np.sin(angle), -radius * np.cos(angle), np.full(positions, 0.3 * radius)], axis=1)
        middle, z = np.zeros(2), 0.0
    else:
        away = float(10 ** rng.uniform(3, 4.5))
        length = away * wavelength / (2 * cell * float(rng.uniform(0.6, 1.5)))
        squint = float(rng.uniform(-0.4, 0.4))
        antenna = np.zeros((positions, 3))
        antenna[:, 0] = np.linspace(-0.5, 0.5, positions) * length + away * math.sin(squint)
        antenna[:, 1:] = -0.9 * away * math.cos(squint), 0.4 * away
        middle, z = np.zeros(2), 0.0
    centre_place = (float(middle[0]), float(middle[1]), z)
    found = point_resolution(antenna, centre_place, centre_hz=centre, bandwidth_hz=bandwidth)
    steps = [min(size, 2 * cell) / 3 for size in (found.x_m, found.y_m)]
    pixels = [int(rng.integers(36, 60)) for _ in range(2)]
    axes = [at + step * (np.arange(n) - n / 2) for at, step, n in zip(middle, steps, pixels, strict=True)]
    if kind in ("rail", "bent rail"):
        axes[1] = axes[1] + max(0.0, near - float(axes[1][0]))
    count = int(rng.integers(3, 7))
    spans = [axis[0] + (axis[-1] - axis[0]) * rng.uniform(0.15, 0.85, count) for axis in axes]
    targets = np.column_stack([*spans, np.full(count, z)])
    amplitudes = rng.uniform(0.3, 1.0, count) * np.exp(2j * np.pi * rng.uniform(size=count))
    return Collect(kind, antenna, targets, amplitudes, ImageGrid(axes[0], axes[1], z), centre, bandwidth, window)


def relative_error_db(image: NDArray[np.complexfloating], truth: NDArray[np.complexfloating]) -> float:
    """Root mean square error over the image's defined pixels relative to the truth's, dB."""
    use = np.isfinite(image) & np.isfinite(truth)
    return float(20 * np.log10(np.linalg.norm((image - truth)[use]) / np.linalg.norm(truth[use])))
