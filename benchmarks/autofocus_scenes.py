"""Rails with errors that are known: points and clutter seen from places, or with phases, other than those told."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from processing.radar.profiles import SPEED_OF_LIGHT_M_S, RangeProfiles
from processing.sar.autofocus import Autofocus
from processing.sar.autofocus_gradient import without_shift
from processing.sar.grid import ImageGrid

CENTRE_HZ, BANDWIDTH_HZ = 2.4e9, 80e6
CELL_M = SPEED_OF_LIGHT_M_S / (2 * BANDWIDTH_HZ)
K_RAD_M = 4 * np.pi * CENTRE_HZ / SPEED_OF_LIGHT_M_S
STEP_M = 0.0508
GROUND_M = -1.069
ERRORS = ("none", "slow phase", "random phase", "trolley")


@dataclass(frozen=True)
class Scene:
    """Profiles with an error, and the truth."""

    error: str
    profiles: RangeProfiles
    grid: ImageGrid
    targets_m: NDArray[np.float64]
    """(targets, 3) points that stand out."""
    true_antenna_m: NDArray[np.float64]
    """(positions, 3)."""
    phase_rad: NDArray[np.float64]
    """(positions,) that the profiles were turned by."""

    def residual_rad(self, found: Autofocus | None = None) -> float:
        """Phase error left at the points after a correction, rms, without each point's mean and linear part."""
        antenna, phase = self.profiles.antenna_m, self.phase_rad
        if found is not None and found.applied:
            antenna = antenna + found.shift_m[:, None] * np.asarray(found.axis)
            phase = phase + found.phase_rad
        left = []
        for target in self.targets_m:
            thought, true = (np.linalg.norm(target - place, axis=1) for place in (antenna, self.true_antenna_m))
            left.append(without_shift(phase + K_RAD_M * (thought - true), self.profiles.antenna_m))
        return float(np.sqrt(np.mean(np.square(left))))


def random_scene(seed: int, error: str, *, positions: int = 61, clutter: float = 0.02, noise: float = 0.02) -> Scene:
    """Points of different strength in weak clutter and noise, on the thesis's rail.

    Args:
        seed: of everything random.
        error: one of ``ERRORS``.
        positions: of the trolley, 2 in apart.
        clutter: amplitude of each of 60 weak scatterers, relative to the strongest point.
        noise: amplitude of a bin's noise, likewise.
    """
    rng = np.random.default_rng(seed)
    grid = ImageGrid(np.arange(-6, 6.01, 0.1), np.arange(4, 19, 0.35), GROUND_M)
    slots = [(x, y) for y in (6.5, 11.0, 15.5) for x in (-4.0, -1.3, 1.4, 4.1)]
    chosen = rng.permutation(len(slots))[: int(rng.integers(5, 9))]
    targets = np.array([[*slots[i], GROUND_M] for i in chosen])
    targets[:, :2] += rng.uniform(-0.6, 0.6, (len(targets), 2))
    strong = rng.uniform(0.4, 1.0, len(targets)) * np.exp(2j * np.pi * rng.uniform(size=len(targets)))
    weak = np.column_stack([rng.uniform(-6, 6, 60), rng.uniform(4, 19, 60), np.full(60, GROUND_M)])
    speckle = clutter * (rng.normal(size=60) + 1j * rng.normal(size=60))
    told = np.column_stack([(np.arange(positions) - (positions - 1) / 2) * STEP_M, np.zeros((positions, 2))])
    true, phase = told.copy(), np.zeros(positions)
    part = np.linspace(0, 1, positions)
    a, b, c = rng.uniform(0.6, 1.0), rng.uniform(0, 2 * np.pi), rng.uniform(0.8, 2.0)
    if error == "slow phase":
        phase = 2.0 * a * np.sin(2 * np.pi * c * part + b) + 5 * a * (2 * part - 1) ** 2
    elif error == "random phase":
        phase = 0.8 * rng.normal(size=positions)
    elif error == "trolley":
        true[:, 0] += 0.05 * a * np.sin(2 * np.pi * c * part + b)
    r = np.arange(-8 * 8, int(40 / CELL_M * 8)) * CELL_M / 8
    values = np.zeros((positions, len(r)), dtype=np.complex128)
    for place, amplitude in zip([*targets, *weak], [*strong, *speckle], strict=True):
        away = np.linalg.norm(place - true, axis=1)[:, None]
        near = (r - away) / CELL_M
        envelope = np.sinc(near) + 0.5 * (np.sinc(near - 1) + np.sinc(near + 1))
        values += amplitude * envelope * np.exp(-1j * K_RAD_M * away)
    values = values * np.exp(1j * phase)[:, None]
    values += noise * (rng.normal(size=values.shape) + 1j * rng.normal(size=values.shape))
    profiles = RangeProfiles(
        values[None].astype(np.complex64), r, told, ("HH",), CENTRE_HZ, BANDWIDTH_HZ, "hann", range_compensated=True
    )
    return Scene(error, profiles, grid, targets, true, phase)


def without_points(scene: Scene, seed: int) -> Scene:
    """The same grid and track with nothing but noise."""
    rng = np.random.default_rng(seed)
    shape = scene.profiles.values.shape
    values = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    return replace(scene, error="noise", profiles=replace(scene.profiles, values=values))
