"""Scattering in scalars, for Numba: the functions of :mod:`processing.raytrace.scattering`, one ray at a time.

Vectors are three numbers each, so that nothing is allocated.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from processing.optics.fresnel import amplitudes_kernel
from processing.raytrace.materials import (
    CHOICE,
    DIFFUSE,
    FILM_K,
    FILM_N,
    FILM_THICKNESS,
    LOBE,
    ROUGHNESS,
    SAMPLED,
    SHADOWING,
    SPECULAR,
    K,
    Lobe,
    N,
    Shadowing,
)
from processing.raytrace.scattering import GRAZING

Floats = NDArray[np.float64]
Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]

_NONE, _HALF, _THESIS, _BOUNDED = (
    int(Lobe.NONE),
    int(Lobe.WARD_HALF_VECTOR),
    int(Lobe.WARD_THESIS),
    int(Lobe.WARD_BOUNDED),
)
_FACETS, _SMOOTH = int(Lobe.MICROFACETS), int(Lobe.SMOOTH)
_SMITH, _FIT = int(Shadowing.SMITH), int(Shadowing.SMITH_RATIONAL)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def dot(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> float:
    """Inner product."""
    return ax * bx + ay * by + az * bz


@numba.njit(cache=True, nogil=True, error_model="numpy")
def any_axis(x: float, y: float, z: float) -> Three:
    """A unit vector across a direction."""
    sign = 1.0 if z >= 0.0 else -1.0
    a = -1.0 / (sign + z)
    return 1.0 + sign * x * x * a, sign * x * y * a, -sign * x


@numba.njit(cache=True, nogil=True, error_model="numpy")
def shared_axis(ix: float, iy: float, iz: float, ox: float, oy: float, oz: float) -> Three:
    """Unit vector across the plane of two rays (``out x in``); any across them where they coincide."""
    x, y, z = oy * iz - oz * iy, oz * ix - ox * iz, ox * iy - oy * ix
    size = math.sqrt(x * x + y * y + z * z)
    if size > 1e-10:
        return x / size, y / size, z / size
    return any_axis(ox, oy, oz)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def turn(
    kx: float, ky: float, kz: float, ax: float, ay: float, az: float, bx: float, by: float, bz: float
) -> tuple[float, float]:
    """Cosine and sine of twice the angle from axis a to axis b about the propagation k."""
    cosine = ax * bx + ay * by + az * bz
    sine = (ky * az - kz * ay) * bx + (kz * ax - kx * az) * by + (kx * ay - ky * ax) * bz
    size = cosine * cosine + sine * sine
    return (cosine * cosine - sine * sine) / size, 2.0 * cosine * sine / size


@numba.njit(cache=True, nogil=True, error_model="numpy")
def shadowing(kind: int, slope_sd: float, cosine: float) -> float:
    """Share of the facing facets that a direction sees."""
    if kind != _SMITH and kind != _FIT:
        return 1.0
    sine2 = 1.0 - cosine * cosine
    if sine2 <= 0.0:
        return 1.0
    a = cosine / (math.sqrt(2.0 * sine2) * slope_sd)
    if kind == _FIT:
        return 1.0 if a >= 1.6 else (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a)
    if a > 6.0:
        return 1.0  # to 1e-17
    if a <= 0.0:
        return 0.0
    return 1.0 / (1.0 + math.exp(-a * a) / (2.0 * a * math.sqrt(math.pi)) - 0.5 * math.erfc(a))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def fresnel_parts(row: Floats, cosine: float) -> tuple[float, float, float, float]:
    """a, b, c, d of the facets' own reflection."""
    ss, pp = amplitudes_kernel(complex(row[N], row[K]), cosine, complex(row[FILM_N], row[FILM_K]), row[FILM_THICKNESS])
    rs, rp = ss.real * ss.real + ss.imag * ss.imag, pp.real * pp.real + pp.imag * pp.imag
    return (
        0.5 * (rs + rp),
        0.5 * (rs - rp),
        ss.real * pp.real + ss.imag * pp.imag,
        ss.imag * pp.real - ss.real * pp.imag,
    )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def evaluate(
    row: Floats,
    nx: float,
    ny: float,
    nz: float,
    ix: float,
    iy: float,
    iz: float,
    ox: float,
    oy: float,
    oz: float,
) -> Six:
    """Diffuse part, a, b, c, d (1/sr) and density (1/sr), without smooth lobes."""
    cos_in, cos_out = dot(nx, ny, nz, ix, iy, iz), dot(nx, ny, nz, ox, oy, oz)
    if not (cos_in > GRAZING and cos_out > GRAZING):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    lobe = int(row[LOBE])
    diffuse = row[DIFFUSE] / math.pi
    density = (1.0 - row[CHOICE]) * cos_in / math.pi
    if lobe in (_NONE, _SMOOTH):
        return diffuse, 0.0, 0.0, 0.0, 0.0, density
    hx, hy, hz = ix + ox, iy + oy, iz + oz
    length = math.sqrt(dot(hx, hy, hz, hx, hy, hz))
    cos_half = min(dot(nx, ny, nz, hx, hy, hz) / length, 1.0)
    cos_facet = min(0.5 * length, 1.0)
    tan2 = max(1.0 - cos_half * cos_half, 0.0) / (cos_half * cos_half)
    alpha = row[SAMPLED]
    drawn = math.exp(-tan2 / (alpha * alpha)) / (math.pi * alpha * alpha * cos_half * cos_half * cos_half)
    density += row[CHOICE] * drawn / (4.0 * cos_facet)
    if lobe != _FACETS:
        alpha = row[ROUGHNESS]
        exponent = tan2
        if lobe == _THESIS:
            off = 2.0 * cos_in * cos_out - dot(ix, iy, iz, ox, oy, oz)
            if off <= 0.0:
                return diffuse, 0.0, 0.0, 0.0, 0.0, density
            exponent = max((1.0 - off * off) / (off * off), 0.0)
        peak = row[SPECULAR] * math.exp(-exponent / (alpha * alpha)) / (math.pi * alpha * alpha)
        if lobe == _BOUNDED:
            diffuse += peak / (length * length * cos_half * cos_half * cos_half * cos_half)
        else:
            diffuse += peak / (4.0 * math.sqrt(cos_in * cos_out))
        return diffuse, 0.0, 0.0, 0.0, 0.0, density
    sd = row[ROUGHNESS]
    # The density of slopes: that of the sampled facets but for their cosine.
    slopes = drawn / cos_half
    if slopes < 1e-30:
        return diffuse, 0.0, 0.0, 0.0, 0.0, density
    kind = int(row[SHADOWING])
    strength = row[SPECULAR] * slopes * shadowing(kind, sd, cos_in) * shadowing(kind, sd, cos_out)
    strength /= 4.0 * cos_in * cos_out
    a, b, c, d = fresnel_parts(row, cos_facet)
    return diffuse, strength * a, strength * b, strength * c, strength * d, density


@numba.njit(cache=True, nogil=True, error_model="numpy")
def sample(
    row: Floats,
    nx: float,
    ny: float,
    nz: float,
    ox: float,
    oy: float,
    oz: float,
    choice: float,
    u: float,
    v: float,
) -> tuple[float, float, float, bool]:
    """Draw where light comes from; the last value tells of the smooth lobe."""
    specular = choice < row[CHOICE]
    if specular and int(row[LOBE]) == _SMOOTH:
        twice = 2.0 * dot(nx, ny, nz, ox, oy, oz)
        return twice * nx - ox, twice * ny - oy, twice * nz - oz, True
    if specular:
        alpha = row[SAMPLED]
        cosine = 1.0 / math.sqrt(1.0 - math.log1p(-u) * alpha * alpha)
    else:
        cosine = math.sqrt(1.0 - u)
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    angle = 2.0 * math.pi * v
    tx, ty, tz = any_axis(nx, ny, nz)
    bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
    p, q = sine * math.cos(angle), sine * math.sin(angle)
    x, y, z = p * tx + q * bx + cosine * nx, p * ty + q * by + cosine * ny, p * tz + q * bz + cosine * nz
    if specular:
        twice = 2.0 * dot(x, y, z, ox, oy, oz)
        x, y, z = twice * x - ox, twice * y - oy, twice * z - oz
    return x, y, z, False
