"""Paths from the sources, for Numba: each surface that a ray meets is connected with the camera (thesis 4.1, 4.3).

A path carries the 4 x 4 matrix P that brings Stokes vectors of the source (in its own axis) to light coming along the
ray, times the flux that the ray stands for.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from processing.raytrace.backward_kernel import SURE_BOUNCES
from processing.raytrace.bvh_kernel import STACK
from processing.raytrace.materials import CHOICE, SPECULAR
from processing.raytrace.random_numbers import path_key, uniform
from processing.raytrace.scattering_kernel import dot, evaluate, fresnel_parts, sample, shared_axis, turn
from processing.raytrace.source_kernel import horizontal, seen, set_out, state
from processing.raytrace.sources import KIND, UPRIGHT, Kind
from processing.raytrace.surface_kernel import blocked, next_surface
from processing.raytrace.world import World

Floats = NDArray[np.float64]

_SKY = int(Kind.SKY)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def leave_surface(p: Floats, ci: float, si: float, diffuse: float, a: float, b: float, c: float, d: float) -> None:
    """The surface's matrix times (turn from the ray's axis to the shared one) times P, in place."""
    for j in range(4):
        p0, p1, p2, p3 = p[0, j], ci * p[1, j] + si * p[2, j], ci * p[2, j] - si * p[1, j], p[3, j]
        p[0, j] = (diffuse + a) * p0 + b * p1
        p[1, j] = b * p0 + a * p1
        p[2, j] = c * p2 + d * p3
        p[3, j] = c * p3 - d * p2


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _to_camera(
    world: World,
    view: Floats,
    p: Floats,
    row: Floats,
    place: tuple[float, float, float],
    normal: tuple[float, float, float],
    ray: tuple[float, float, float],
    axis: tuple[float, float, float],
    skip: int,
    stack: NDArray[np.int32],
    entry: Floats,
    source: tuple[float, float, float],
    sums: Floats,
    squares: Floats,
) -> int:
    """Add what a lit point shows the camera; returns how many rays were traced for it."""
    px, py, pz = place
    nx, ny, nz = normal
    dx, dy, dz = ray
    wx, wy, wz = view[0] - px, view[1] - py, view[2] - pz
    far = math.sqrt(wx * wx + wy * wy + wz * wz)
    if far == 0.0:
        return 0
    wx, wy, wz = wx / far, wy / far, wz / far
    depth = -dot(view[3], view[4], view[5], wx, wy, wz)  # cosine from the view's axis
    if depth <= 0.0:
        return 0
    scale = view[12] / depth
    x = 0.5 * view[13] - scale * dot(view[6], view[7], view[8], wx, wy, wz)
    y = 0.5 * view[14] + scale * dot(view[9], view[10], view[11], wx, wy, wz)
    if not (0.0 <= x < view[13] and 0.0 <= y < view[14]):
        return 0
    diffuse, a, b, c, d, _ = evaluate(row, nx, ny, nz, -dx, -dy, -dz, wx, wy, wz)
    if diffuse + a <= 0.0:
        return 0
    if blocked(world, stack, entry, px, py, pz, wx, wy, wz, skip, far):
        return 1
    # Area of the point's surroundings in the picture, square pixels per m^2.
    share = dot(nx, ny, nz, wx, wy, wz) / (far * far) * view[12] * view[12] / (depth * depth * depth)
    sx, sy, sz = shared_axis(-dx, -dy, -dz, wx, wy, wz)
    ci, si = turn(dx, dy, dz, axis[0], axis[1], axis[2], sx, sy, sz)
    # The camera's axis: (direction seen along) x up, with direction -w.
    hx, hy, hz = wz * view[10] - wy * view[11], wx * view[11] - wz * view[9], wy * view[9] - wx * view[10]
    co, so = turn(wx, wy, wz, sx, sy, sz, hx, hy, hz)
    pixel = int(y) * int(view[13]) + int(x)
    components = sums.shape[1]
    columns = components // 4
    for j in range(columns):
        if columns == 1:
            p0 = p[0, 0] + source[0] * p[0, 1] + source[1] * p[0, 2] + source[2] * p[0, 3]
            p1 = p[1, 0] + source[0] * p[1, 1] + source[1] * p[1, 2] + source[2] * p[1, 3]
            p2 = p[2, 0] + source[0] * p[2, 1] + source[1] * p[2, 2] + source[2] * p[2, 3]
            p3 = p[3, 0] + source[0] * p[3, 1] + source[1] * p[3, 2] + source[2] * p[3, 3]
        else:
            p0, p1, p2, p3 = p[0, j], p[1, j], p[2, j], p[3, j]
        l1, l2 = ci * p1 + si * p2, ci * p2 - si * p1
        r0, r1 = (diffuse + a) * p0 + b * l1, b * p0 + a * l1
        r2, r3 = c * l2 + d * p3, c * p3 - d * l2
        for i in range(4):
            if i == 0:
                value = share * r0
            elif i == 1:
                value = share * (co * r1 + so * r2)
            elif i == 2:
                value = share * (co * r2 - so * r1)
            else:
                value = share * r3
            sums[pixel, columns * i + j] += value
            squares[pixel, columns * i + j] += value * value
    return 1


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def send(
    world: World,
    view: Floats,
    number: int,
    bounces: int,
    seed: int,
    first: int,
    count: int,
    sums: Floats,
    squares: Floats,
) -> int:
    """Send rays ``first`` to ``first + count`` of source ``number``; returns how many rays were traced.

    Args:
        world: the scene.
        view: row of :class:`processing.raytrace.view.View`.
        number: which source.
        bounces: most reflections.
        seed: of the picture.
        first, count: which rays.
        sums, squares: (blocks, pixels, 4 or 16), one for each block of rays.
    """
    blocks = len(sums)
    row = world.sources[number]
    traced = 0
    for block in numba.prange(blocks):
        stack = np.empty(STACK, dtype=np.int32)
        entry = np.empty(STACK, dtype=np.float64)
        p = np.empty((4, 4))
        rays = 0
        for one in range(first + count * block // blocks, first + count * (block + 1) // blocks):
            key = path_key(seed, number, one)
            ox, oy, oz, dx, dy, dz, flux = set_out(
                row,
                world.centre[0],
                world.centre[1],
                world.centre[2],
                world.radius,
                uniform(key, 0),
                uniform(key, 1),
                uniform(key, 2),
                uniform(key, 3),
            )
            if flux <= 0.0:
                continue
            degree = 1.0
            if int(row[KIND]) == _SKY:
                _, degree, xx, xy, xz = seen(row, -dx, -dy, -dz)
            else:
                xx, xy, xz = horizontal(row[UPRIGHT], row[UPRIGHT + 1], row[UPRIGHT + 2], dx, dy, dz)
            source = state(row, degree)
            p[:] = 0.0
            for i in range(4):
                p[i, i] = flux
            skip = -1
            for bounce in range(bounces):
                rays += 1
                triangle, ox, oy, oz, nx, ny, nz = next_surface(world, stack, entry, ox, oy, oz, dx, dy, dz, skip)
                if triangle < 0:
                    break
                surface = world.materials[world.material[triangle]]
                skip = triangle
                rays += _to_camera(
                    world,
                    view,
                    p,
                    surface,
                    (ox, oy, oz),
                    (nx, ny, nz),
                    (dx, dy, dz),
                    (xx, xy, xz),
                    skip,
                    stack,
                    entry,
                    source,
                    sums[block],
                    squares[block],
                )
                if bounce + 1 == bounces:
                    break
                place = 4 + 4 * bounce
                wx, wy, wz, smooth = sample(
                    surface,
                    nx,
                    ny,
                    nz,
                    -dx,
                    -dy,
                    -dz,
                    uniform(key, place),
                    uniform(key, place + 1),
                    uniform(key, place + 2),
                )
                cosine = dot(nx, ny, nz, wx, wy, wz)
                if cosine <= 0.0:
                    break
                if smooth:
                    a, b, c, d = fresnel_parts(surface, min(cosine, 1.0))
                    weight = surface[SPECULAR] / surface[CHOICE]
                    diffuse = 0.0
                else:
                    # The reflectance is the same both ways, and its density is that of the direction drawn.
                    diffuse, a, b, c, d, density = evaluate(surface, nx, ny, nz, wx, wy, wz, -dx, -dy, -dz)
                    if density <= 0.0:
                        break
                    weight = cosine / density
                if bounce + 1 >= SURE_BOUNCES:
                    gain = p[0, 0] + math.sqrt(p[0, 1] ** 2 + p[0, 2] ** 2 + p[0, 3] ** 2)
                    stay = min(gain / flux * weight * (diffuse + a + abs(b)), 0.95)
                    if uniform(key, place + 3) >= stay:
                        break
                    weight /= stay
                sx, sy, sz = shared_axis(-dx, -dy, -dz, wx, wy, wz)
                ci, si = turn(dx, dy, dz, xx, xy, xz, sx, sy, sz)
                leave_surface(p, ci, si, weight * diffuse, weight * a, weight * b, weight * c, weight * d)
                dx, dy, dz, xx, xy, xz = wx, wy, wz, sx, sy, sz
        traced += rays
    return traced
