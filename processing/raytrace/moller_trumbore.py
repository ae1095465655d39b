"""Where rays meet triangles, one by one: the definition, in float64 NumPy (thesis 4.1 to 4.3).

Moeller and Trumbore 1997, J. Graphics Tools 2(1). A ray through a point that two triangles share may be told to miss
both by rounding; :mod:`processing.raytrace.bvh_kernel` does not, and is fast.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


class Hits(NamedTuple):
    """Where rays met the mesh: each (N,)."""

    distance: Floats
    """In lengths of the direction; infinite for a miss."""
    triangle: NDArray[np.int64]
    """-1 for a miss."""
    u: Floats
    """Weight of the second corner (4.1)."""
    v: Floats
    """Weight of the third corner."""


def intersect(origin: ArrayLike, direction: ArrayLike, corners: ArrayLike) -> tuple[Floats, Floats, Floats]:
    """Solve 4.2 for rays and triangles that broadcast.

    Args:
        origin, direction: (..., 3).
        corners: (..., 3, 3), the points V0, V1, V2.

    Returns:
        t, u, v (...); NaN where the ray runs along the triangle's plane (4.3 has no solution).
    """
    o, d = np.asarray(origin, dtype=np.float64), np.asarray(direction, dtype=np.float64)
    points = np.asarray(corners, dtype=np.float64)
    e1, e2 = points[..., 1, :] - points[..., 0, :], points[..., 2, :] - points[..., 0, :]
    t = o - points[..., 0, :]
    p, q = np.cross(d, e2), np.cross(t, e1)
    with np.errstate(divide="ignore", invalid="ignore"):
        determinant = np.sum(p * e1, axis=-1)
        inverse = np.where(determinant != 0, 1 / determinant, np.nan)
        return tuple(inverse * np.sum(a * b, axis=-1) for a, b in ((q, e2), (p, t), (q, d)))


def closest(
    origin: ArrayLike, direction: ArrayLike, corners: ArrayLike, skip: ArrayLike | None = None, least: float = 0.0
) -> Hits:
    """The nearest triangle that each ray meets, edges included.

    Args:
        origin, direction: (N, 3).
        corners: (T, 3, 3).
        skip: (N,) index of a triangle that does not count, -1 for none.
        least: hits nearer than this do not count.
    """
    o, d = np.asarray(origin, dtype=np.float64), np.asarray(direction, dtype=np.float64)
    points = np.asarray(corners, dtype=np.float64)
    distance = np.full(len(o), np.inf)
    triangle = np.full(len(o), -1, dtype=np.int64)
    at_u, at_v = np.zeros(len(o)), np.zeros(len(o))
    skipped = np.full(len(o), -1) if skip is None else np.asarray(skip)
    for number, corner in enumerate(points):
        t, u, v = intersect(o, d, corner)
        nearer = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > least) & (t < distance) & (skipped != number)
        distance[nearer], at_u[nearer], at_v[nearer] = t[nearer], u[nearer], v[nearer]
        triangle[nearer] = number
    return Hits(distance, triangle, at_u, at_v)
