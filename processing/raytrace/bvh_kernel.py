"""Rays through a tree of boxes, in scalars for Numba: the nearest triangle, or whether there is any.

Triangles are met as Woop, Benthin and Wald 2013 (JCGT 2(1)) propose: what an edge's sign is does not depend on which of
its two triangles asks, so no ray slips between them. Boxes are rounded outwards and their far sides widened by the
rounding of the test (Ize 2013, JCGT 2(2)).
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int32]

STACK = 96
"""Deepest tree that can be walked."""

_WIDER = 1.0 + 8 * 2.0**-53


@numba.njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _triangle(
    corners: Floats,
    i: int,
    ox: float,
    oy: float,
    oz: float,
    kx: int,
    ky: int,
    kz: int,
    sx: float,
    sy: float,
    sz: float,
) -> tuple[float, float, float]:
    """Distance, u and v of one triangle; infinite where it is missed."""
    px = ox if kx == 0 else (oy if kx == 1 else oz)
    py = ox if ky == 0 else (oy if ky == 1 else oz)
    pz = ox if kz == 0 else (oy if kz == 1 else oz)
    az, bz, cz = corners[i, kz] - pz, corners[i, 3 + kz] - pz, corners[i, 6 + kz] - pz
    ax, ay = corners[i, kx] - px - sx * az, corners[i, ky] - py - sy * az
    bx, by = corners[i, 3 + kx] - px - sx * bz, corners[i, 3 + ky] - py - sy * bz
    cx, cy = corners[i, 6 + kx] - px - sx * cz, corners[i, 6 + ky] - py - sy * cz
    u = cx * by - cy * bx
    v = ax * cy - ay * cx
    w = bx * ay - by * ax
    if (u < 0.0 or v < 0.0 or w < 0.0) and (u > 0.0 or v > 0.0 or w > 0.0):
        return math.inf, 0.0, 0.0
    total = u + v + w
    if total == 0.0:
        return math.inf, 0.0, 0.0
    return sz * (u * az + v * bz + w * cz) / total, v / total, w / total


@numba.njit(cache=True, nogil=True, error_model="numpy")
def nearest(
    boxes: NDArray[np.float32],
    children: Indices,
    corners: Floats,
    order: Indices,
    stack: Indices,
    entry: Floats,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    skip: int,
    farthest: float,
    first_only: bool,
) -> tuple[float, int, float, float]:
    """Distance, triangle (-1: none), u and v of the nearest hit before ``farthest``, or of any.

    Args:
        boxes, children, corners, order: of :class:`processing.raytrace.bvh.Tree`.
        stack, entry: scratch of this thread, (:data:`STACK`,).
        skip: triangle that does not count, -1 for none.
        first_only: any hit will do.
    """
    best, found, at_u, at_v = farthest, -1, 0.0, 0.0
    x, y, z = abs(dx), abs(dy), abs(dz)
    kz = 2
    main = dz
    if x >= y and x >= z:
        kz, main = 0, dx
    elif y >= z:
        kz, main = 1, dy
    # Rays of no direction, or with a NaN anywhere, meet nothing (and would walk the whole tree).
    if main == 0.0 or not math.isfinite(ox + oy + oz + dx + dy + dz):
        return best, found, at_u, at_v
    kx = kz + 1 if kz < 2 else 0
    ky = kx + 1 if kx < 2 else 0
    if main < 0.0:
        kx, ky = ky, kx
    sx = (dx if kx == 0 else (dy if kx == 1 else dz)) / main
    sy = (dx if ky == 0 else (dy if ky == 1 else dz)) / main
    sz = 1.0 / main
    ix = 1.0 / dx if dx != 0.0 else math.inf
    iy = 1.0 / dy if dy != 0.0 else math.inf
    iz = 1.0 / dz if dz != 0.0 else math.inf
    nx, ny, nz = (1 if ix < 0.0 else 0), (3 if iy < 0.0 else 2), (5 if iz < 0.0 else 4)
    fx, fy, fz = 1 - nx, 5 - ny, 9 - nz
    depth = 0
    node = 0
    while True:
        if node >= 0:
            # Both children; comparisons with a NaN (a ray in a side's plane) leave the interval as it is.
            near_l, far_l = 0.0, best
            near_r, far_r = 0.0, best
            t = (boxes[node, nx] - ox) * ix
            near_l = t if t > near_l else near_l
            t = (boxes[node, ny] - oy) * iy
            near_l = t if t > near_l else near_l
            t = (boxes[node, nz] - oz) * iz
            near_l = t if t > near_l else near_l
            t = (boxes[node, fx] - ox) * ix * _WIDER
            far_l = t if t < far_l else far_l
            t = (boxes[node, fy] - oy) * iy * _WIDER
            far_l = t if t < far_l else far_l
            t = (boxes[node, fz] - oz) * iz * _WIDER
            far_l = t if t < far_l else far_l
            t = (boxes[node, 6 + nx] - ox) * ix
            near_r = t if t > near_r else near_r
            t = (boxes[node, 6 + ny] - oy) * iy
            near_r = t if t > near_r else near_r
            t = (boxes[node, 6 + nz] - oz) * iz
            near_r = t if t > near_r else near_r
            t = (boxes[node, 6 + fx] - ox) * ix * _WIDER
            far_r = t if t < far_r else far_r
            t = (boxes[node, 6 + fy] - oy) * iy * _WIDER
            far_r = t if t < far_r else far_r
            t = (boxes[node, 6 + fz] - oz) * iz * _WIDER
            far_r = t if t < far_r else far_r
            left, right = near_l <= far_l, near_r <= far_r
            if left and right:
                if near_l <= near_r:
                    stack[depth], entry[depth] = children[node, 1], near_r
                    node = children[node, 0]
                else:
                    stack[depth], entry[depth] = children[node, 0], near_l
                    node = children[node, 1]
                depth += 1
                continue
            if left:
                node = children[node, 0]
                continue
            if right:
                node = children[node, 1]
                continue
        else:
            code = -node - 1
            begin, count = code >> 4, code & 15
            for i in range(begin, begin + count):
                t, u, v = _triangle(corners, i, ox, oy, oz, kx, ky, kz, sx, sy, sz)
                if t < best and t > 0.0 and order[i] != skip:
                    best, found, at_u, at_v = t, order[i], u, v
                    if first_only:
                        return best, found, at_u, at_v
        while True:
            if depth == 0:
                return best, found, at_u, at_v
            depth -= 1
            if entry[depth] <= best:
                node = stack[depth]
                break


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def nearest_of_many(
    boxes: NDArray[np.float32],
    children: Indices,
    corners: Floats,
    order: Indices,
    origin: Floats,
    direction: Floats,
    skip: NDArray[np.int64],
    distance: Floats,
    triangle: NDArray[np.int64],
    u: Floats,
    v: Floats,
    first_only: bool,
) -> None:
    """:func:`nearest` of many rays; ``distance`` holds the farthest on entry and the result on return.

    A miss leaves ``distance`` as it was and makes ``triangle`` -1.
    """
    count = len(distance)
    blocks = (count + 255) // 256
    for block in numba.prange(blocks):
        stack = np.empty(STACK, dtype=np.int32)
        entry = np.empty(STACK, dtype=np.float64)
        for i in range(256 * block, min(256 * block + 256, count)):
            t, found, at_u, at_v = nearest(
                boxes,
                children,
                corners,
                order,
                stack,
                entry,
                origin[i, 0],
                origin[i, 1],
                origin[i, 2],
                direction[i, 0],
                direction[i, 1],
                direction[i, 2],
                skip[i],
                distance[i],
                first_only,
            )
            distance[i], triangle[i], u[i], v[i] = t, found, at_u, at_v
