"""A lorry on a road, seen by a polarimeter of division of time from 21 km, as in the thesis's simulations (Table
7.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from processing.optics.analyser import measurement_matrix
from processing.optics.camera_model import Pinhole

Floats = NDArray[np.float64]
ANGLES_RAD = np.radians([0.0, 45.0, 90.0, 135.0])
MATRIX = measurement_matrix(ANGLES_RAD)
SIZE_M = (24.0, 12.0)
"""The lorry along its way and across it."""


@dataclass(frozen=True)
class RoadScene:
    """Ground with fields of their own polarization, and a lorry on it."""

    velocity_m_s: tuple[float, float, float]
    time_s: Floats
    seed: int = 0
    counts: float = 20_000.0
    rows: int = 128
    columns: int = 160

    @property
    def camera(self) -> Pinhole:
        """Table 7.1's optics above the radar's flight, looking down by 45 degrees at the middle of the scene."""
        return Pinhole(1.110, 30e-6, self.columns, self.rows, (0.0, 0.0, 0.0), np.pi / 4)

    def stokes(self, time_s: float) -> Floats:
        """(3, rows, columns) true S0, S1, S2 at an instant, each pixel the mean of 3 x 3 rays."""
        total = np.zeros((3, self.rows, self.columns))
        column, row = np.meshgrid(np.arange(float(self.columns)), np.arange(float(self.rows)))
        for du in (-1 / 3, 0.0, 1 / 3):
            for dv in (-1 / 3, 0.0, 1 / 3):
                total += self._at(self.camera.on_plane(column + du, row + dv, -15_000.0), time_s)
        return total / 9

    def exposures(self, random: np.random.Generator) -> Floats:
        """(4, rows, columns) noisy counts behind the polarizer at each instant and angle; one electron a count."""
        light = np.stack([np.tensordot(m, self.stokes(t), 1) for m, t in zip(MATRIX, self.time_s, strict=True)])
        return np.asarray(random.poisson(light * self.counts) + random.normal(0, 5.0, light.shape))

    def _at(self, ground: Floats, time_s: float) -> Floats:
        random = np.random.default_rng(self.seed)
        place = ground[..., :2] - np.array([0.0, 15_000.0])
        waves = random.uniform(0.05, 0.35, (6, 2)) * random.choice([-1, 1], (6, 2))
        texture = sum(np.sin(place @ wave + random.uniform(0, 6)) for wave in waves) / 6
        road = np.abs(place[..., 1] - 0.9 * place[..., 0]) < 14
        s0 = np.where(road, 0.28, 0.42 + 0.15 * texture)
        dolp, angle = np.where(road, 0.18, 0.06 + 0.04 * texture), np.where(road, 0.1, 0.8)
        way = np.asarray(self.velocity_m_s[:2])
        ahead = way / np.linalg.norm(way)
        local = place - way * time_s
        along, across = local @ ahead, local @ np.array([-ahead[1], ahead[0]])
        lorry = (np.abs(along) < SIZE_M[0] / 2) & (np.abs(across) < SIZE_M[1] / 2)
        cab = lorry & (along > SIZE_M[0] / 4)
        s0 = np.where(lorry, np.where(cab, 0.75, 0.55 + 0.05 * np.sin(1.3 * along)), s0)
        dolp = np.where(lorry, np.where(cab, 0.45, 0.25), dolp)
        angle = np.where(lorry, np.where(cab, 0.5, -0.6), angle)
        return np.stack([s0, s0 * dolp * np.cos(2 * angle), s0 * dolp * np.sin(2 * angle)])


def dolp_of(light: Floats) -> Floats:
    """Degree of linear polarization by least squares, (rows, columns)."""
    s0, s1, s2 = np.tensordot(np.linalg.pinv(MATRIX), light, 1)
    return np.asarray(np.hypot(s1, s2) / s0)
