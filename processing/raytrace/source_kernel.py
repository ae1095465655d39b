"""Light from sources in scalars, for Numba: what reaches a point, what the sky shows, and rays that set out."""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from processing.raytrace.scattering_kernel import any_axis, dot
from processing.raytrace.sources import AXIS, KIND, PLACE, S1, SIZE, STRENGTH, UPRIGHT, Kind

Floats = NDArray[np.float64]
Three = tuple[float, float, float]

_POINT, _PLANE, _GAUSSIAN, _SUN, _SKY = (
    int(kind) for kind in (Kind.POINT, Kind.PLANE, Kind.GAUSSIAN, Kind.SUN, Kind.SKY)
)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def unit(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Unit vector and length."""
    size = math.sqrt(x * x + y * y + z * z)
    if size == 0.0:
        return 0.0, 0.0, 1.0, 0.0
    return x / size, y / size, z / size, size


@numba.njit(cache=True, nogil=True, error_model="numpy")
def horizontal(ux: float, uy: float, uz: float, kx: float, ky: float, kz: float) -> Three:
    """Stokes axis of light along k from a source with that upright direction: ``up x k``."""
    x, y, z, size = unit(uy * kz - uz * ky, uz * kx - ux * kz, ux * ky - uy * kx)
    if size < 1e-12:
        return any_axis(kx, ky, kz)
    return x, y, z


@numba.njit(cache=True, nogil=True, error_model="numpy")
def intensity(row: Floats, kx: float, ky: float, kz: float) -> float:
    """Flux per sr of a lamp in a direction."""
    kind = int(row[KIND])
    if kind == _POINT:
        return float(row[STRENGTH])
    ax, ay, az = row[AXIS], row[AXIS + 1], row[AXIS + 2]
    cosine = dot(ax, ay, az, kx, ky, kz)
    if cosine <= 0.0:
        return 0.0
    ex, ey, ez = horizontal(row[UPRIGHT], row[UPRIGHT + 1], row[UPRIGHT + 2], ax, ay, az)
    fx, fy, fz = ay * ez - az * ey, az * ex - ax * ez, ax * ey - ay * ex
    p, q = dot(ex, ey, ez, kx, ky, kz) / cosine, dot(fx, fy, fz, kx, ky, kz) / cosine
    width = row[SIZE]
    if kind == _PLANE:
        density = 0.25 / (width * width) if abs(p) <= width and abs(q) <= width else 0.0
    else:
        density = math.exp(-0.5 * (p * p + q * q) / (width * width)) / (2.0 * math.pi * width * width)
    # Slopes to solid angle: dp dq = d omega / cos^3.
    return float(row[STRENGTH] * density / (cosine * cosine * cosine))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def in_disc(row: Floats, u: float, v: float) -> Three:
    """A direction towards a point of the sun's disc, evenly."""
    sx, sy, sz = row[PLACE], row[PLACE + 1], row[PLACE + 2]
    if row[SIZE] == 0.0:
        return sx, sy, sz
    half = math.sin(0.5 * row[SIZE])
    less = 2.0 * half * half * u  # 1 - cos
    sine, cosine = math.sqrt(less * (2.0 - less)), 1.0 - less
    angle = 2.0 * math.pi * v
    tx, ty, tz = any_axis(sx, sy, sz)
    bx, by, bz = sy * tz - sz * ty, sz * tx - sx * tz, sx * ty - sy * tx
    p, q = sine * math.cos(angle), sine * math.sin(angle)
    return cosine * sx + p * tx + q * bx, cosine * sy + p * ty + q * by, cosine * sz + p * tz + q * bz


@numba.njit(cache=True, nogil=True, error_model="numpy")
def disc_solid_angle(row: Floats) -> float:
    """Solid angle of the sun's disc, sr."""
    half = math.sin(0.5 * row[SIZE])
    return 4.0 * math.pi * half * half


@numba.njit(cache=True, nogil=True, error_model="numpy")
def disc_radiance(row: Floats) -> float:
    """Radiance of the sun's disc: irradiance over its projected solid angle."""
    sine = math.sin(row[SIZE])
    return float(row[STRENGTH] / (math.pi * sine * sine))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def towards(
    row: Floats, px: float, py: float, pz: float, u: float, v: float
) -> tuple[float, float, float, float, float, float]:
    """Unit vector to a source, its distance, the irradiance of one sample across it, and the sample's density (1/sr).

    A density of 0 is a source without extent. The sky is met by rays that escape and gives 0 here.
    """
    kind = int(row[KIND])
    if kind == _SKY:
        return 0.0, 0.0, 1.0, math.inf, 0.0, 0.0
    if kind == _SUN:
        x, y, z = in_disc(row, u, v)
        if row[SIZE] == 0.0:
            return x, y, z, math.inf, row[STRENGTH], 0.0
        solid = disc_solid_angle(row)
        return x, y, z, math.inf, disc_radiance(row) * solid, 1.0 / solid
    x, y, z, size = unit(row[PLACE] - px, row[PLACE + 1] - py, row[PLACE + 2] - pz)
    if size == 0.0:
        return x, y, z, 0.0, 0.0, 0.0
    return x, y, z, size, intensity(row, -x, -y, -z) / (size * size), 0.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def seen(row: Floats, x: float, y: float, z: float) -> tuple[float, float, float, float, float]:
    """Radiance of a sky or sun in a direction, the degree of its polarization along an axis, and that axis.

    For the sun the degree is 1 and the axis its horizontal one: its state is multiplied by the caller.
    """
    kind = int(row[KIND])
    cosine = dot(row[PLACE], row[PLACE + 1], row[PLACE + 2], x, y, z)
    if kind == _SUN and row[SIZE] > 0.0:
        half = math.sin(0.5 * row[SIZE])
        if 1.0 - cosine <= 2.0 * half * half:
            ax, ay, az = horizontal(row[UPRIGHT], row[UPRIGHT + 1], row[UPRIGHT + 2], -x, -y, -z)
            return disc_radiance(row), 1.0, ax, ay, az
    if kind == _SKY and z > 0.0:
        cos2 = min(cosine * cosine, 1.0)
        # Polarized across the plane of scattering.
        ax, ay, az = horizontal(row[PLACE], row[PLACE + 1], row[PLACE + 2], -x, -y, -z)
        return 0.75 * row[STRENGTH] * (1.0 + cos2), row[SIZE] * (1.0 - cos2) / (1.0 + cos2), ax, ay, az
    return 0.0, 0.0, 1.0, 0.0, 0.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def set_out(
    row: Floats, cx: float, cy: float, cz: float, radius: float, a: float, b: float, c: float, d: float
) -> tuple[float, float, float, float, float, float, float]:
    """A ray from a source: origin, direction and the flux it stands for (alone).

    Args:
        row: the source.
        cx, cy, cz, radius: a sphere that holds the scene; light that misses it is not sent.
        a, b, c, d: random numbers in [0, 1).
    """
    kind = int(row[KIND])
    if kind in (_SUN, _SKY):
        if kind == _SUN:
            x, y, z = in_disc(row, a, b)
            flux = row[STRENGTH]
        else:
            z = a  # evenly over the upper half
            sine = math.sqrt(1.0 - z * z)
            x, y = sine * math.cos(2.0 * math.pi * b), sine * math.sin(2.0 * math.pi * b)
            radiance, _, _, _, _ = seen(row, x, y, z)
            flux = radiance * 2.0 * math.pi
        tx, ty, tz = any_axis(x, y, z)
        bx, by, bz = y * tz - z * ty, z * tx - x * tz, x * ty - y * tx
        r, angle = radius * math.sqrt(c), 2.0 * math.pi * d
        p, q = r * math.cos(angle), r * math.sin(angle)
        far = 1.01 * radius
        return (
            cx + p * tx + q * bx + far * x,
            cy + p * ty + q * by + far * y,
            cz + p * tz + q * bz + far * z,
            -x,
            -y,
            -z,
            flux * math.pi * radius * radius,
        )
    ox, oy, oz = row[PLACE], row[PLACE + 1], row[PLACE + 2]
    if kind == _POINT:
        x, y, z, size = unit(cx - ox, cy - oy, cz - oz)
        # The cone that holds the scene; all around where the lamp stands in it.
        less = 1.0 - math.sqrt(max(1.0 - (radius / size) ** 2, 0.0)) if size > radius else 2.0
        cosine = 1.0 - less * a
        sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
        angle = 2.0 * math.pi * b
        tx, ty, tz = any_axis(x, y, z)
        bx, by, bz = y * tz - z * ty, z * tx - x * tz, x * ty - y * tx
        p, q = sine * math.cos(angle), sine * math.sin(angle)
        return (
            ox,
            oy,
            oz,
            cosine * x + p * tx + q * bx,
            cosine * y + p * ty + q * by,
            cosine * z + p * tz + q * bz,
            row[STRENGTH] * 2.0 * math.pi * less,
        )
    ax, ay, az = row[AXIS], row[AXIS + 1], row[AXIS + 2]
    ex, ey, ez = horizontal(row[UPRIGHT], row[UPRIGHT + 1], row[UPRIGHT + 2], ax, ay, az)
    fx, fy, fz = ay * ez - az * ey, az * ex - ax * ez, ax * ey - ay * ex
    if kind == _PLANE:
        p, q = row[SIZE] * (2.0 * a - 1.0), row[SIZE] * (2.0 * b - 1.0)
    else:
        r = row[SIZE] * math.sqrt(-2.0 * math.log1p(-a))
        p, q = r * math.cos(2.0 * math.pi * b), r * math.sin(2.0 * math.pi * b)
    x, y, z, _ = unit(ax + p * ex + q * fx, ay + p * ey + q * fy, az + p * ez + q * fz)
    return ox, oy, oz, x, y, z, row[STRENGTH]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def state(row: Floats, degree: float) -> tuple[float, float, float]:
    """S1, S2 and S3 over S0 in the source's axis: a lamp's own, or along the axis to that degree."""
    if int(row[KIND]) == _SKY:
        return degree, 0.0, 0.0
    return row[S1], row[S1 + 1], row[S1 + 2]
