"""Rough ground as points: random scatterers whose mean powers are those of its backscatter.

Their statistics are Freeman and Durden's (1998, IEEE TGRS 36(3)): a part that scatters once, in which HH and VV keep
step, and a part of randomly turned dipoles that makes up the cross-polarized power; amplitudes are complex normal, so
that resolution cells of several points show speckle.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from processing.errors import DataError
from processing.scattering.contributions import Contributions, of_points
from processing.scattering.surfaces import Backscatter, RadarSurface, rough_backscatter
from processing.scattering.target import Target

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

MOST_POINTS = 5_000_000


def rough_points(
    target: Target, surfaces: Sequence[RadarSurface], antenna_m: ArrayLike, per_m2: float, *, seed: int = 0
) -> Contributions:
    """Scatterers of all rough surfaces that an antenna sees.

    Args:
        target: the bodies.
        surfaces: what they are made of; smooth ones and conductors are left out.
        antenna_m: (3,) m.
        per_m2: points on a square metre: several in each resolution cell.
        seed: of places and amplitudes; a point has both wherever it is seen from.

    Raises:
        DataError: a density that is not positive, or more than :data:`MOST_POINTS` points.
    """
    if not (np.isfinite(per_m2) and per_m2 > 0):
        raise DataError(f"{per_m2} points on a square metre", "give a positive number")
    antenna = np.asarray(antenna_m, dtype=np.float64)
    corners = target.corners_m
    edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = np.linalg.norm(np.cross(*edges), axis=1) / 2
    rough = np.array([surface.height_sd_m > 0 and surface.permittivity is not None for surface in surfaces])
    area = np.where(rough[target.world.material], area, 0.0)
    wanted = float(area.sum()) * per_m2
    if wanted > MOST_POINTS:
        raise DataError(f"{wanted:.3g} points of rough ground are too many", "ask for fewer on a square metre")
    random = np.random.default_rng(seed)
    count = int(np.ceil(wanted))
    if not count:
        return of_points(np.zeros((0, 3)), np.zeros((0, 2, 2), dtype=np.complex128))
    triangle = random.choice(len(area), size=count, p=area / area.sum())
    u, v = random.random(count), random.random(count)
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = corners[triangle, 0] + u[:, None] * edges[0][triangle] + v[:, None] * edges[1][triangle]
    # Drawn for all points: each keeps its own wherever it is looked at from.
    dipoles, once, angle = _normal(random, count), _normal(random, count), random.uniform(0, np.pi, count)
    normals = target.world.normals[triangle]
    away = points - antenna
    way = away / np.linalg.norm(away, axis=1, keepdims=True)
    normals = normals * np.where(np.sum(normals * way, axis=1) > 0, -1.0, 1.0)[:, None]
    seen = visible(target, antenna, points + target.world.margin * normals, skip=triangle)
    points, normals, way, triangle = points[seen], normals[seen], way[seen], triangle[seen]
    dipoles, once, angle = dipoles[seen], once[seen], angle[seen]
    share = float(area.sum()) / count
    matrices = np.zeros((len(points), 2, 2), dtype=np.complex128)
    material = target.world.material[triangle]
    incidence = np.arccos(np.clip(-np.sum(normals * way, axis=1), 0.0, 1.0))
    for number in np.unique(material):
        chosen = material == number
        told = rough_backscatter(surfaces[number], incidence[chosen], 2 * np.pi / target.wavenumber)
        matrices[chosen] = np.sqrt(share) * _scattering(told, dipoles[chosen], once[chosen], angle[chosen])
    velocity = target.velocity[triangle] if len(target.velocity) else None
    return of_points(points, _turned(matrices, way, normals), velocity)


def visible(
    target: Target, antenna: Floats, points: Floats, skip: NDArray[np.int64] | None = None
) -> NDArray[np.bool_]:
    """Whether an antenna (3,) sees points (N, 3): no triangle but those to ``skip`` stands in between."""
    return ~target.world.tree.occluded(points, antenna - points, np.ones(len(points)), skip)


def _normal(random: np.random.Generator, count: int) -> Complexes:
    """Complex normal numbers of mean power 1."""
    return np.asarray((random.standard_normal(count) + 1j * random.standard_normal(count)) / np.sqrt(2))


def _scattering(told: Backscatter, dipoles: Complexes, once: Complexes, angle: Floats) -> Complexes:
    """Matrices (N, 2, 2) whose mean powers are those told, of random amplitudes (N,) and angles of dipoles."""
    # A dipole turned at random across the sight has co-polarized powers of 3/8 and a cross-polarized one of 1/8.
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    matrices = (np.sqrt(8 * told.hv) * dipoles)[:, None, None] * along[:, :, None] * along[:, None, :]
    matrices[:, 0, 0] += once * np.sqrt(np.maximum(told.hh - 3 * told.hv, 0))
    matrices[:, 1, 1] += once * np.sqrt(np.maximum(told.vv - 3 * told.hv, 0))
    return np.asarray(matrices)


def _turned(matrices: Complexes, way: Floats, normals: Floats) -> Complexes:
    """From the surfaces' own horizontal (across ray and normal) to the radar's (across ray and z)."""
    h = np.stack([way[:, 1], -way[:, 0], np.zeros(len(way))], axis=-1)
    h /= np.maximum(np.linalg.norm(h, axis=1, keepdims=True), 1e-12)
    v = np.cross(h, way)
    s = np.cross(way, normals)
    size = np.linalg.norm(s, axis=1)
    c = np.where(size > 1e-9, np.sum(s * h, axis=1) / np.maximum(size, 1e-300), 1.0)
    d = np.where(size > 1e-9, np.sum(s * v, axis=1) / np.maximum(size, 1e-300), 0.0)
    # Columns are the surface's s and p in (h, v).
    turn = np.stack([np.stack([c, -d], axis=-1), np.stack([d, c], axis=-1)], axis=-2)
    return np.asarray(turn @ matrices @ turn.transpose(0, 2, 1))
