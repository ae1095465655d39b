"""Points and weights for integrals over flat convex polygons."""

from __future__ import annotations

import itertools
import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Seven points of degree 5 on a triangle, in barycentric coordinates (Radon 1948).
_ROOT = math.sqrt(15)
_NEAR, _FAR = (6 - _ROOT) / 21, (6 + _ROOT) / 21
_POINTS = np.array(
    [[1 / 3] * 3] + [[1 - 2 * a if i == j else a for j in range(3)] for a in (_NEAR, _FAR) for i in range(3)]
)
_WEIGHTS = np.array([9 / 40] + [(155 - _ROOT) / 1200] * 3 + [(155 + _ROOT) / 1200] * 3)


def polygon_quadrature(corners_m: Floats, step_m: float) -> tuple[Floats, Floats]:
    """Points (N, 3) and weights (N,), in m and m^2, of a rule exact for polynomials of degree 5 on small triangles.

    Args:
        corners_m: (n, 3) convex, flat polygon.
        step_m: longest edge that the small triangles may have, about.
    """
    points, weights = [], []
    start = corners_m[0]
    for second, third in itertools.pairwise(corners_m[1:]):
        area = 0.5 * float(np.linalg.norm(cross_products(second - start, third - start)))
        if area == 0:
            continue
        longest = max(float(np.linalg.norm(edge)) for edge in (second - start, third - second, start - third))
        parts = max(math.ceil(longest / step_m), 1)
        barycentric = _small_triangles(parts)
        points.append(barycentric @ np.stack([start, second, third]))
        weights.append(np.tile(_WEIGHTS * (area / parts**2), parts**2))
    if not points:
        return np.empty((0, 3)), np.empty(0)
    return np.concatenate(points), np.concatenate(weights)


def cross_products(first: Floats, second: Floats) -> Floats:
    """Cross products along the last axis, (..., 3): ``np.cross``, several times faster for a few vectors."""
    ax, ay, az = first[..., 0], first[..., 1], first[..., 2]
    bx, by, bz = second[..., 0], second[..., 1], second[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


@lru_cache(maxsize=256)
def _small_triangles(parts: int) -> Floats:
    """Barycentric coordinates (7 parts^2, 3) of the rule on a triangle cut into ``parts``^2 equal ones."""
    i, j = np.meshgrid(np.arange(parts), np.arange(parts), indexing="ij")
    upright = (i + j < parts).ravel()
    turned = (i + j < parts - 1).ravel()
    low = np.stack([i.ravel(), j.ravel()], axis=-1).astype(np.float64)
    high = low + 1.0
    # The two kinds of small triangle have their right angle at (i, j) and at (i + 1, j + 1).
    inner = _POINTS[:, 1:]
    plane = np.concatenate(
        [(low[upright][:, None] + inner).reshape(-1, 2), (high[turned][:, None] - inner).reshape(-1, 2)]
    )
    plane /= parts
    found = np.column_stack([1 - plane.sum(axis=1), plane])
    found.setflags(write=False)
    return found
