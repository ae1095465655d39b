"""Where a ray meets a world's surfaces, and whether the way to a lamp or the camera is free, for Numba."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from processing.raytrace.bvh_kernel import nearest
from processing.raytrace.scattering_kernel import dot
from processing.raytrace.world import World

Floats = NDArray[np.float64]
Stack = NDArray[np.int32]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def next_surface(
    world: World,
    stack: Stack,
    entry: Floats,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    skip: int,
) -> tuple[int, float, float, float, float, float, float]:  # fmt: skip
    """Triangle that a ray meets first (-1: none), a point just in front of it, and its normal towards the ray's origin.

    Args:
        world: the scene.
        stack, entry: scratch of this thread.
        ox, oy, oz, dx, dy, dz: the ray.
        skip: triangle that does not count, -1 for none.
    """
    _, triangle, u, v = nearest(
        world.boxes, world.children, world.sorted_corners, world.order, stack, entry, ox, oy, oz, dx, dy, dz, skip,
        math.inf, False,
    )  # fmt: skip
    if triangle < 0:
        return -1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    p = world.corners[triangle]
    w = 1.0 - u - v
    nx, ny, nz = world.normals[triangle, 0], world.normals[triangle, 1], world.normals[triangle, 2]
    if dot(nx, ny, nz, dx, dy, dz) > 0.0:
        nx, ny, nz = -nx, -ny, -nz
    return (
        triangle,
        w * p[0] + u * p[3] + v * p[6] + world.margin * nx,
        w * p[1] + u * p[4] + v * p[7] + world.margin * ny,
        w * p[2] + u * p[5] + v * p[8] + world.margin * nz,
        nx,
        ny,
        nz,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def blocked(
    world: World, stack: Stack, entry: Floats, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float,
    skip: int, far: float,
) -> bool:  # fmt: skip
    """Whether anything stands on a ray before ``far``; other arguments as in :func:`next_surface`."""
    _, triangle, _, _ = nearest(
        world.boxes, world.children, world.sorted_corners, world.order, stack, entry, ox, oy, oz, dx, dy, dz, skip,
        far, True,
    )  # fmt: skip
    return triangle >= 0
