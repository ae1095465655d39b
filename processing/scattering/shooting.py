"""Shooting and bouncing rays: contributions of a target as one antenna place sees it, refined until they settle.

Waves are mirrored from plane to plane (geometrical optics) and every plane that they reach carries the current of
physical optics, which radiates to the antenna where the way is free. Sources: Ling, Chou and Lee 1989, IEEE TAP 37(2),
Shooting and bouncing rays; the current is taken at every bounce as in Knott, Shaeffer and Tuley, Radar Cross Section.
A plane that is no conductor carries the current that a conductor would need for the same reflection: right where it
mirrors, and nothing where nothing is reflected. Edges do not diffract.

Signs are those of :mod:`processing.calibration.physical_optics`: a plate's S at its normal is positive.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.scattering.contributions import Beam, Contributions
from processing.scattering.target import Target
from processing.scattering.tubes_kernel import shoot_tubes

Floats = NDArray[np.float64]

MOST_CELLS = 40_000_000
"""Cells of a window that are not begun with."""
GOLDEN = (3 - math.sqrt(5)) / 2
NARROWEST = math.cos(math.radians(75))
"""Cosine of the widest angle from the window's axis that rays are sent to."""


@dataclass(frozen=True)
class Density:
    """How finely and how far rays are followed."""

    cell_m: float
    """Edge of the cells at the reference point's distance, before any is split."""
    levels: int = 4
    """How often a cell is split in four at edges."""
    bounces: int = 3
    """Most bounces."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.cell_m) and self.cell_m > 0 and 0 <= self.levels <= 12 and 1 <= self.bounces <= 12):
            raise DataError(
                f"cells of {self.cell_m} m, {self.levels} levels and {self.bounces} bounces cannot be traced",
                "give a positive cell, 0 to 12 levels and 1 to 12 bounces",
            )


@dataclass(frozen=True)
class Shot:
    """What one antenna place lights up."""

    contributions: Contributions
    rays: int
    parted: float
    """Share of the footprints' area at edges, of which a middle ray decided."""
    curvature_rad: float
    """Largest phase by which a wavefront bends within a footprint, which is taken as flat (the near field's term)."""


@dataclass(frozen=True)
class Settled:
    """A target's scattering, refined until it changed by less than was asked for."""

    scattering: NDArray[np.complex128]
    """(F, 2, 2) S[rx, tx], sqrt(m^2)."""
    density: Density
    """That was needed."""
    change_db: float
    """Largest change of the last refinement, relative to the strongest element, dB (of finer rays)."""
    bounce_db: tuple[float, ...]
    """Largest element of each number of bounces over the strongest of the sum, dB; the last is what was left out
    next (the bounce after the last one kept)."""
    curvature_rad: float
    """Of the last shot."""
    rays: int
    """Of all shots."""
    reached: bool
    """Whether the change is below what was asked for."""


def shoot(target: Target, antenna_m: ArrayLike, reference_m: ArrayLike, density: Density) -> Shot:
    """Send rays from an antenna over all of a target.

    Args:
        target: the bodies.
        antenna_m: (3,) place of the antenna, m.
        reference_m: (3,) a point of the target, which the window faces.
        density: of rays.

    Raises:
        DataError: an antenna at the reference point, or so fine a density that it has no end.
    """
    antenna = np.ascontiguousarray(antenna_m, dtype=np.float64)
    window, columns, rows = _window(target, antenna, np.asarray(reference_m, dtype=np.float64), density.cell_m)
    capacity = 4 * columns * rows + 4096
    while True:
        places = np.empty((capacity, 6, 3))
        amplitudes = np.empty((capacity, 2, 2), dtype=np.complex128)
        kinds = np.empty((capacity, 3), dtype=np.int64)
        motions = np.empty((capacity if len(target.velocity) else 0, 2, 3))
        count, rays = shoot_tubes(
            target, antenna, window, 0, rows, columns, density.levels, density.bounces, places, amplitudes, kinds,
            motions,
        )  # fmt: skip
        if count <= capacity:
            break
        capacity = count
    places, amplitudes, kinds = places[:count].copy(), amplitudes[:count].copy(), kinds[:count]
    moves = motions[:count].copy() if len(motions) else None
    found = Contributions(places, amplitudes, kinds[:, 0].copy(), np.ones(count, dtype=bool), moves)
    area = np.linalg.norm(np.cross(places[:, 1], places[:, 2]), axis=1)
    parted = float(area[kinds[:, 2] == 0].sum() / area.sum()) if count else 0.0
    return Shot(found, int(rays), parted, _curvature(places, antenna, target.wavenumber))


def settle(
    target: Target,
    antenna_m: ArrayLike,
    reference_m: ArrayLike,
    wavelengths_m: ArrayLike,
    *,
    tolerance_db: float = 0.05,
    start: Density | None = None,
    beam: Beam | None = None,
    most_refinements: int = 5,
) -> Settled:
    """Scattering of a target with as many rays and bounces as change it by more than the tolerance.

    Cells begin at half a wavelength or a 64th of the window; while halving the finest cells changes the result by more
    than the tolerance it is done again, and so is a further bounce.

    Args:
        target, antenna_m, reference_m: as :func:`shoot`.
        wavelengths_m: (F,) m.
        tolerance_db: change, relative to the strongest element, that does not matter.
        start: density to begin with.
        beam: the antennas' pattern.
        most_refinements: where to stop, ``reached`` tells.

    Raises:
        DataError: as :func:`shoot`, or a tolerance that is not positive.
    """
    if not tolerance_db > 0:
        raise DataError(f"the tolerance is {tolerance_db} dB", "give one above 0")
    allowed = 10 ** (tolerance_db / 20) - 1
    antenna = np.asarray(antenna_m, dtype=np.float64)
    density = start or _start(target, antenna, np.asarray(reference_m, dtype=np.float64))
    rays = 0

    def look(how: Density) -> tuple[Shot, list[NDArray[np.complex128]]]:
        nonlocal rays
        shot = shoot(target, antenna, reference_m, replace(how, bounces=how.bounces + 1))
        rays += shot.rays
        parts = [
            shot.contributions.chosen(shot.contributions.bounces == b).scattering(
                antenna[None], wavelengths_m, reference_m, beam=beam
            )[0]
            for b in range(1, how.bounces + 2)
        ]
        return shot, parts

    shot, parts = look(density)
    change, settled = math.inf, False
    for _ in range(most_refinements):
        total = np.sum(parts[:-1], axis=0)
        level = max(float(np.abs(total).max()), 1e-300)
        if float(np.abs(parts[-1]).max()) > allowed * level and density.bounces < 11:
            density = replace(density, bounces=density.bounces + 1)
        finer = replace(density, cell_m=density.cell_m / 1.5, levels=min(density.levels + 1, 12))
        shot, parts = look(finer)
        now = np.sum(parts[:-1], axis=0)
        if len(parts) > density.bounces + 1:
            parts = parts[: density.bounces + 1]
        change = float(np.abs(now - total).max()) / max(float(np.abs(now).max()), 1e-300)
        density = finer
        settled = change <= allowed and float(np.abs(parts[-1]).max()) <= allowed * max(
            float(np.abs(now).max()), 1e-300
        )
        if settled:
            break
    total = np.sum(parts[:-1], axis=0)
    level = max(float(np.abs(total).max()), 1e-300)
    decibels = tuple(20 * math.log10(max(float(np.abs(part).max()) / level, 1e-15)) for part in parts)
    return Settled(total, density, 20 * math.log10(1 + change), decibels, shot.curvature_rad, rays, settled)


def _start(target: Target, antenna: Floats, reference: Floats) -> Density:
    _, (low, high) = _frame(target, antenna, reference)
    wide = float(np.max(high - low))
    return Density(max(wide / 64, min(np.pi / target.wavenumber, wide / 16)), levels=5, bounces=3)


def _frame(target: Target, antenna: Floats, reference: Floats) -> tuple[Floats, tuple[Floats, Floats]]:
    """Axes (right, up, forward) of a window at the reference point's distance, and its extent (2,) to (2,), m."""
    away = reference - antenna
    distance = float(np.linalg.norm(away))
    if not distance > 0:
        raise DataError("an antenna stands at the target's reference point", "move the target away from it")
    forward = away / distance
    right = np.array([forward[1], -forward[0], 0.0])
    right = right / np.linalg.norm(right) if np.linalg.norm(right) > 1e-12 else np.array([1.0, 0.0, 0.0])
    axes = np.stack([right, np.cross(right, forward), forward])
    seen = (target.corners_m.reshape(-1, 3) - antenna) @ axes.T
    # Directions beyond the widest, and those behind, end at the window's border.
    depth = np.maximum(seen[:, 2], NARROWEST * np.linalg.norm(seen, axis=1))
    flat = distance * seen[:, :2] / np.maximum(depth, 1e-300)[:, None]
    return axes, (flat.min(axis=0), flat.max(axis=0))


def _window(target: Target, antenna: Floats, reference: Floats, cell_m: float) -> tuple[Floats, int, int]:
    axes, (low, high) = _frame(target, antenna, reference)
    # Some room around, parted unevenly, so that opposite borders do not lie in their cells alike.
    counts = np.maximum(np.ceil((high - low) / cell_m + 0.2), 1)
    if not counts[0] * counts[1] <= MOST_CELLS:
        raise DataError(
            f"{counts[0]:.3g} x {counts[1]:.3g} cells of {cell_m:g} m are too many to trace",
            "make the cells larger, or the scene smaller",
        )
    first = low - GOLDEN * (counts * cell_m - (high - low))
    corner = reference + first[0] * axes[0] + first[1] * axes[1]
    return np.stack([corner, cell_m * axes[0], cell_m * axes[1]]), int(counts[0]), int(counts[1])


def _curvature(places: Floats, antenna: Floats, wavenumber: float) -> float:
    """Phase at a footprint's corners from both wavefronts' curvature: ``k (s / 2)^2 / 2 (1 / d1 + 1 / d2)``."""
    if not len(places):
        return 0.0
    half = (np.linalg.norm(places[:, 1], axis=1) ** 2 + np.linalg.norm(places[:, 2], axis=1) ** 2) / 4
    near = sum(1 / np.linalg.norm(places[:, row] - antenna, axis=1) for row in (0, 3))
    return float(np.max(wavenumber * half / 2 * near))
