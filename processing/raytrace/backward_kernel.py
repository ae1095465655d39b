"""Paths from the camera, for Numba: every pixel's samples, their sums and sums of squares.

A path carries the 4 x 4 matrix T that brings Stokes vectors of light coming along the ray (in the ray's axis) to the
camera. At each surface every lamp is looked at (and the sun, weighted with the chance of meeting its disc by following
the surface's own scattering: Veach and Guibas 1995, balance heuristic); then one direction is drawn, T multiplied, and
the ray goes on. The sky is what rays meet that leave the scene.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from processing.raytrace.bvh_kernel import STACK
from processing.raytrace.materials import CHOICE, SPECULAR
from processing.raytrace.random_numbers import path_key, uniform
from processing.raytrace.scattering_kernel import dot, evaluate, fresnel_parts, sample, shared_axis, turn
from processing.raytrace.source_kernel import disc_solid_angle, horizontal, seen, state, towards
from processing.raytrace.sources import KIND, UPRIGHT, Kind
from processing.raytrace.surface_kernel import blocked, next_surface
from processing.raytrace.world import World

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SUN, _SKY = int(Kind.SUN), int(Kind.SKY)

SURE_BOUNCES = 4
"""Paths may end by chance only after so many reflections."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def pass_surface(t: Floats, co: float, so: float, diffuse: float, a: float, b: float, c: float, d: float) -> None:
    """T times (turn from the shared axis to the ray's) times the surface's matrix, in place."""
    for i in range(4):
        t0, t1, t2, t3 = t[i, 0], t[i, 1] * co - t[i, 2] * so, t[i, 1] * so + t[i, 2] * co, t[i, 3]
        t[i, 0] = t0 * (diffuse + a) + t1 * b
        t[i, 1] = t0 * b + t1 * a
        t[i, 2] = t2 * c - t3 * d
        t[i, 3] = t2 * d + t3 * c


@numba.njit(cache=True, nogil=True, error_model="numpy")
def add_light(
    t: Floats,
    co: float,
    so: float,
    diffuse: float,
    a: float,
    b: float,
    c: float,
    d: float,
    ci: float,
    si: float,
    strength: float,
    q1: float,
    q2: float,
    q3: float,
    value: Floats,
) -> float:
    """Add light that a surface (parts as in ``evaluate``) sends along the path; returns what S0 gained.

    ``ci, si`` turn the source's axis to the shared one, ``co, so`` the shared one to the ray's. A value of four numbers
    is the Stokes vector for the source's state (1, q1, q2, q3); of sixteen, the Mueller matrix row by row.
    """
    columns = len(value) // 4
    gained = 0.0
    for j in range(columns):
        if columns == 1:
            i0, i1, i2, i3 = strength, strength * q1, strength * q2, strength * q3
        else:
            i0, i1 = strength * (j == 0), strength * (j == 1)
            i2, i3 = strength * (j == 2), strength * (j == 3)
        l1, l2 = ci * i1 + si * i2, ci * i2 - si * i1
        r0, r1 = (diffuse + a) * i0 + b * l1, b * i0 + a * l1
        r2, r3 = c * l2 + d * i3, c * i3 - d * l2
        o1, o2 = co * r1 + so * r2, co * r2 - so * r1
        for i in range(4):
            x = t[i, 0] * r0 + t[i, 1] * o1 + t[i, 2] * o2 + t[i, 3] * r3
            value[columns * i + j] += x
            if i == 0 and j == 0:
                gained = x
    return gained


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _escaped(
    world: World,
    wanted: Mask,
    bounce: int,
    t: Floats,
    dx: float,
    dy: float,
    dz: float,
    xx: float,
    xy: float,
    xz: float,
    density: float,
    value: Floats,
    shares: Floats,
) -> None:
    """What a ray that meets nothing sees after ``bounce`` reflections."""
    for number in range(len(world.sources)):
        row = world.sources[number]
        kind = int(row[KIND])
        if not wanted[bounce, number] or kind not in (_SKY, _SUN):
            continue
        radiance, degree, ax, ay, az = seen(row, dx, dy, dz)
        if radiance == 0.0:
            continue
        if kind == _SUN and density > 0.0:
            radiance *= density / (density + 1.0 / disc_solid_angle(row))
        q1, q2, q3 = state(row, degree)
        c, s = turn(-dx, -dy, -dz, ax, ay, az, xx, xy, xz)
        # No surface: the identity between the source's axis and the ray's.
        gained = add_light(t, 1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, c, s, radiance, q1, q2, q3, value)
        if len(shares):
            shares[bounce, number] += gained


@numba.njit(cache=True, nogil=True, error_model="numpy")
def follow(
    world: World,
    wanted: Mask,
    key: np.uint64,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    xx: float,
    xy: float,
    xz: float,
    t: Floats,
    stack: NDArray[np.int32],
    entry: Floats,
    value: Floats,
    shares: Floats,
) -> int:
    """Add what one ray from the camera sees to ``value``; returns how many rays were traced for it.

    Args:
        world: the scene.
        wanted: (bounces + 1, sources): whose light is looked for after how many reflections.
        key: of the path's random numbers.
        ox, oy, oz, dx, dy, dz: the ray; ``xx, xy, xz`` its Stokes axis.
        t, stack, entry: scratch.
        value: (4,) or (16,).
        shares: (bounces + 1, sources + 1) that takes S0 by reflections and source, and in its last column how often a
            ray went on after so many reflections; or (0, 0).
    """
    bounces = len(wanted) - 1
    count = len(world.sources)
    last, last_escape = -1, -1
    for bounce in range(bounces + 1):
        for number in range(count):
            if wanted[bounce, number]:
                last = bounce
                kind = int(world.sources[number, KIND])
                if kind in (_SKY, _SUN):
                    last_escape = bounce
    t[:] = 0.0
    for i in range(4):
        t[i, i] = 1.0
    skip = -1
    density = 0.0
    rays = 0
    for bounce in range(last + 1):
        rays += 1
        if len(shares):
            shares[bounce, count] += 1.0
        triangle, ox, oy, oz, nx, ny, nz = next_surface(world, stack, entry, ox, oy, oz, dx, dy, dz, skip)
        if triangle < 0:
            _escaped(world, wanted, bounce, t, dx, dy, dz, xx, xy, xz, density, value, shares)
            return rays
        if bounce == last:
            return rays
        row = world.materials[world.material[triangle]]
        skip = triangle
        reflections = bounce + 1
        place = 2 + (4 + 2 * count) * bounce
        for number in range(count):
            light = world.sources[number]
            if not wanted[reflections, number] or int(light[KIND]) == _SKY:
                continue
            first = place + 4 + 2 * number
            wx, wy, wz, far, strength, chance = towards(light, ox, oy, oz, uniform(key, first), uniform(key, first + 1))
            if strength <= 0.0:
                continue
            diffuse, a, b, c, d, own = evaluate(row, nx, ny, nz, wx, wy, wz, -dx, -dy, -dz)
            if diffuse + a <= 0.0:
                continue
            strength *= dot(nx, ny, nz, wx, wy, wz)
            if chance > 0.0:
                strength *= chance / (chance + own)
            rays += 1
            if blocked(world, stack, entry, ox, oy, oz, wx, wy, wz, skip, far):
                continue
            sx, sy, sz = shared_axis(wx, wy, wz, -dx, -dy, -dz)
            hx, hy, hz = horizontal(light[UPRIGHT], light[UPRIGHT + 1], light[UPRIGHT + 2], -wx, -wy, -wz)
            ci, si = turn(-wx, -wy, -wz, hx, hy, hz, sx, sy, sz)
            co, so = turn(-dx, -dy, -dz, sx, sy, sz, xx, xy, xz)
            q1, q2, q3 = state(light, 1.0)
            gained = add_light(t, co, so, diffuse, a, b, c, d, ci, si, strength, q1, q2, q3, value)
            if len(shares):
                shares[reflections, number] += gained
        if reflections == last and last_escape < last:
            return rays
        wx, wy, wz, smooth = sample(
            row,
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
            return rays
        if smooth:
            a, b, c, d = fresnel_parts(row, min(cosine, 1.0))
            weight = row[SPECULAR] / row[CHOICE]
            diffuse, density = 0.0, 0.0
        else:
            diffuse, a, b, c, d, density = evaluate(row, nx, ny, nz, wx, wy, wz, -dx, -dy, -dz)
            if density <= 0.0:
                return rays
            weight = cosine / density
        if reflections >= SURE_BOUNCES:
            # S0 can grow by no more than this from here.
            gain = t[0, 0] + math.sqrt(t[0, 1] ** 2 + t[0, 2] ** 2 + t[0, 3] ** 2)
            stay = min(gain * weight * (diffuse + a + abs(b)), 0.95)
            if uniform(key, place + 3) >= stay:
                return rays
            weight /= stay
        sx, sy, sz = shared_axis(wx, wy, wz, -dx, -dy, -dz)
        co, so = turn(-dx, -dy, -dz, sx, sy, sz, xx, xy, xz)
        pass_surface(t, co, so, weight * diffuse, weight * a, weight * b, weight * c, weight * d)
        dx, dy, dz, xx, xy, xz = wx, wy, wz, sx, sy, sz
    return rays


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def take_samples(
    world: World,
    view: Floats,
    wanted: Mask,
    seed: int,
    first_sample: int,
    samples: int,
    sums: Floats,
    squares: Floats,
    share_sums: Floats,
    share_squares: Floats,
) -> int:
    """Add ``samples`` samples to every pixel; returns how many rays were traced.

    Args:
        world: the scene.
        view: row of :class:`processing.raytrace.view.View`.
        wanted: as in :func:`follow`.
        seed: of the picture.
        first_sample: number of the first sample: those before have been taken.
        samples: how many to add.
        sums, squares: (pixels, 4 or 16).
        share_sums, share_squares: (pixels, bounces + 1, sources + 1) as in :func:`follow`, or no pixels.
    """
    columns = int(view[13])
    pixels = len(sums)
    components = sums.shape[1]
    block = 64
    blocks = (pixels + block - 1) // block
    traced = 0
    for number in numba.prange(blocks):
        stack = np.empty(STACK, dtype=np.int32)
        entry = np.empty(STACK, dtype=np.float64)
        t = np.empty((4, 4))
        value = np.empty(components)
        shares = np.zeros((len(wanted), wanted.shape[1] + 1)) if len(share_sums) else np.zeros((0, 0))
        rays = 0
        for pixel in range(number * block, min((number + 1) * block, pixels)):
            column, row = pixel % columns, pixel // columns
            for one in range(first_sample, first_sample + samples):
                key = path_key(seed, pixel, one)
                x = column + uniform(key, 0) - 0.5 * view[13]
                y = 0.5 * view[14] - row - uniform(key, 1)
                dx = view[12] * view[3] + x * view[6] + y * view[9]
                dy = view[12] * view[4] + x * view[7] + y * view[10]
                dz = view[12] * view[5] + x * view[8] + y * view[11]
                size = math.sqrt(dx * dx + dy * dy + dz * dz)
                dx, dy, dz = dx / size, dy / size, dz / size
                # Across the ray and upright: direction x up.
                hx, hy, hz = (
                    dy * view[11] - dz * view[10],
                    dz * view[9] - dx * view[11],
                    dx * view[10] - dy * view[9],
                )
                size = math.sqrt(hx * hx + hy * hy + hz * hz)
                value[:] = 0.0
                shares[:] = 0.0
                rays += follow(
                    world,
                    wanted,
                    key,
                    view[0],
                    view[1],
                    view[2],
                    dx,
                    dy,
                    dz,
                    hx / size,
                    hy / size,
                    hz / size,
                    t,
                    stack,
                    entry,
                    value,
                    shares,
                )
                for i in range(components):
                    sums[pixel, i] += value[i]
                    squares[pixel, i] += value[i] * value[i]
                if len(share_sums):
                    for i in range(shares.shape[0]):
                        for j in range(shares.shape[1]):
                            share_sums[pixel, i, j] += shares[i, j]
                            share_squares[pixel, i, j] += shares[i, j] * shares[i, j]
        traced += rays
    return traced
