"""The compiled kernel of back-projection.

Pixels are taken sixteen at a time, a *patch* of neighbours (16 x 1, 8 x 2, … of the grid), and pulses in blocks. For
one patch and one pulse the range of the patch's centre is float64. Its sixteen pixels follow from a third-order
expansion in float32 offsets where a bound says that this is exact enough, and each in float64 where it is not. Bins are
looked up in a window of the pulse's table that is held in registers where they lie close enough together, and in memory
otherwise: the same numbers either way. Tables hold polynomials between bins (:mod:`processing.sar.segments`), so that a
long filter costs hardly more than a short one. A few pulses are summed in float32, their sums in float64.

Each pixel sums its pulses in their order, whatever the number of threads.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit, prange

from processing import simd
from processing.sar.segments import MARGIN
from processing.simd import (
    INDEX_BITS,
    fma,
    gather,
    load,
    log2_parts,
    maximum,
    minimum,
    rint,
    splat,
    sqrt,
    store,
    times_power_of_two,
    to_float32,
    to_float64,
    where_positive,
)

PULSES = 128
"""Pulses in a block; its numbers for one patch, and the bins that a tile reads, stay in the core's caches."""

RUN = 16
"""Pulses that are summed in float32."""

PATCHES = 16
"""Patches in a tile, which is one work unit."""

ROOM16, ROOM32 = 7.25, 15.25
"""Bins from a patch's centre that windows of 16 and 32 bins reach, rounding included."""

C = 299_792_458.0

_look16 = simd.lookup16 if simd.PERMUTES else gather
_look32 = simd.lookup32 if simd.PERMUTES else gather

_STRICT: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
_INSIDE: dict[str, Any] = {**_STRICT, "forceinline": True}

# Rows of a block's float32 numbers for one patch: slope of range along x, y, z, its curvature, second and third order
# of the expansion, in bins; place in the window and phase, turns, of the centre; lowest bin of the table from there.
_X, _Y, _Z, _BEND, _SECOND, _THIRD, _PLACE, _PHASE, _LOWEST, _NUMBERS = (PULSES * row for row in range(10))

# Rows of what is kept for every pulse and pixel where channels share it: bin, place beyond it, phasor, antennas' gain.
_BIN, _BEYOND, _COS, _SIN, _GAIN, _KEPT = (16 * row for row in range(6))


class Signal(NamedTuple):
    """What the kernel needs to know of the radar."""

    bins_per_m: float
    turns_per_m: float
    """Turns of phase per metre of range (two-way)."""
    bistatic: bool
    moving: bool
    walk_s: float
    """f_c / K: apparent range per radial velocity."""
    video: float
    """2 K / c^2: turns of residual video phase per square metre."""
    axis_x: float
    """The antennas' axis; with the exponent of their pattern, 0 for none."""
    axis_y: float
    axis_z: float
    exponent: float
    small_turns: float
    """Bound of the phase error, turns, up to which offsets within a patch are float32."""


class Ground(NamedTuple):
    """Some rows of a grid, and how its places lie in flat arrays: index steps from row to row and column to column."""

    rows: int
    columns: int
    first_row: int
    """Row of the image that the first of these is."""
    across: int
    """Columns of a patch, a divisor of 16; it has 16 / ``across`` rows."""
    x_row: int
    x_column: int
    y_row: int
    y_column: int
    z_row: int
    z_column: int


class Table(NamedTuple):
    """How tables are laid out (:func:`processing.sar.segments.segment_tables`)."""

    degree: int
    channels: int
    bins: int
    stride: int


# cos(2 pi x) = sum c x^2k and sin(2 pi x) = x sum s x^2k for |x| <= 1/2, from Chebyshev series: within 1e-8 and 2e-7.
_C0, _C1, _C2, _C3, _C4, _C5, _C6 = (
    np.float32(c) for c in (1.0, -19.7392045, 64.9391174, -85.4501386, 60.1676231, -25.9675685, 6.52861337)
)
_S0, _S1, _S2, _S3, _S4, _S5 = (
    np.float32(s) for s in (6.28318492, -41.3415892, 81.5999425, -76.6144616, 41.3428263, -12.4711438)
)


@njit(**_INSIDE)
def _turned(x: Any) -> Any:
    """Cosine and sine of float32 angles in turns, -1/2 to 1/2."""
    z = x * x
    c = fma(z, fma(z, fma(z, splat(_C6), splat(_C5)), splat(_C4)), splat(_C3))
    c = fma(z, fma(z, fma(z, c, splat(_C2)), splat(_C1)), splat(_C0))
    s = fma(z, fma(z, fma(z, splat(_S5), splat(_S4)), splat(_S3)), splat(_S2))
    s = x * fma(z, fma(z, s, splat(_S1)), splat(_S0))
    return c, s


@njit(**_INSIDE)
def _turned_exactly(x: Any) -> Any:
    """As :func:`_turned`, folded to a quarter turn, where Taylor series are good to float32's own rounding, 6e-8."""
    size = maximum(x, -x)
    far = size - splat(np.float32(0.25))
    v = where_positive(far, splat(np.float32(0.5)) - size, size) * splat(np.float32(2 * math.pi))
    u = v * v
    c = fma(u, splat(np.float32(1 / 479001600)), splat(np.float32(-1 / 3628800)))
    c = fma(u, fma(u, c, splat(np.float32(1 / 40320))), splat(np.float32(-1 / 720)))
    c = fma(u, fma(u, c, splat(np.float32(1 / 24))), splat(np.float32(-1 / 2)))
    c = fma(u, c, splat(np.float32(1)))
    s = fma(u, splat(np.float32(-1 / 39916800)), splat(np.float32(1 / 362880)))
    s = fma(u, fma(u, s, splat(np.float32(-1 / 5040))), splat(np.float32(1 / 120)))
    s = v * fma(u, fma(u, s, splat(np.float32(-1 / 6))), splat(np.float32(1)))
    return where_positive(far, -c, c), where_positive(x, s, -s)


@njit(**_INSIDE)
def _power(x: Any, exponent: np.float32) -> Any:
    """``x^exponent`` of float32, 0 where x is not positive; exponents are not negative."""
    one = splat(np.float32(1))
    e, m = log2_parts(maximum(x, splat(np.float32(1e-30))))
    s = (m - one) / (m + one)
    z = s * s
    # log2 m = 2 / ln 2 (s + s^3 / 3 + s^5 / 5 + ...), |s| < 0.172: what is left out is below 1e-9.
    series = fma(z, fma(z, splat(np.float32(2 / 9)), splat(np.float32(2 / 7))), splat(np.float32(2 / 5)))
    series = fma(z, fma(z, series, splat(np.float32(2 / 3))), splat(np.float32(2)))
    y = fma(s * series, splat(np.float32(1 / math.log(2))), e) * splat(exponent)
    n = rint(y)
    f = (y - n) * splat(np.float32(math.log(2)))
    p = fma(f, fma(f, splat(np.float32(1 / 720)), splat(np.float32(1 / 120))), splat(np.float32(1 / 24)))
    p = fma(f, fma(f, fma(f, p, splat(np.float32(1 / 6))), splat(np.float32(1 / 2))), one)
    return where_positive(x, times_power_of_two(fma(f, p, one), n), splat(np.float32(0)))


@njit(**_INSIDE)
def _look(window: int, table: Any, first: int, places: Any) -> Any:
    if window == 16:
        return _look16(table, first, places)
    if window == 32:
        return _look32(table, first, places)
    return gather(table, first, places)


@njit(**_INSIDE)
def _sample(window: int, table: Any, first: int, stride: int, degree: int, places: Any, beyond: Any) -> Any:
    """Real and imaginary part of a profile between bins, by Horner's rule."""
    re = _look(window, table, first, places)
    im = _look(window, table, first + stride, places)
    first += 2 * stride
    re = fma(re, beyond, _look(window, table, first, places))
    im = fma(im, beyond, _look(window, table, first + stride, places))
    if degree == 1:
        return re, im
    for _ in range(1, degree):
        first += 2 * stride
        re = fma(re, beyond, _look(window, table, first, places))
        im = fma(im, beyond, _look(window, table, first + stride, places))
    return re, im


@njit(**_INSIDE)
def _small(window: int, offsets: Any, numbers: Any, q: int, turns: Any, reach: Any) -> Any:
    """Bins (as lookups take them), places beyond and phases, turns, of a patch for one pulse, by its expansion."""
    x, y, z, squares = load(offsets, 0), load(offsets, 16), load(offsets, 32), load(offsets, 48)
    m = fma(z, splat(numbers[_Z + q]), squares * splat(numbers[_BEND + q]))
    m = fma(x, splat(numbers[_X + q]), fma(y, splat(numbers[_Y + q]), m))
    d = fma(m * m, fma(m, splat(numbers[_THIRD + q]), splat(numbers[_SECOND + q])), m)
    place = d + splat(numbers[_PLACE + q])
    bits = place + splat(INDEX_BITS)
    n = bits - splat(INDEX_BITS)
    if window == 0:
        lowest = splat(numbers[_LOWEST + q])
        n = minimum(maximum(n, lowest), lowest + reach)
        bits = n + splat(INDEX_BITS)
    angle = fma(turns, d, splat(numbers[_PHASE + q]))
    return bits, place - n, angle - rint(angle)


@njit(**_STRICT)
def _sum_small(
    window: int,
    degree: int,
    count: int,
    offsets: Any,
    numbers: Any,
    rows: Any,
    turns_per_bin: Any,
    layout: Any,
    table: Any,
    sums: Any,
    at: int,
) -> None:
    """Add a block of pulses of the only channel to a patch, offsets in float32."""
    turns, reach = splat(turns_per_bin), splat(np.float32(layout.bins + 2 * MARGIN - 2))
    for first in range(0, count, RUN):
        re = im = splat(np.float32(0))
        for q in range(first, min(first + RUN, count)):
            bits, beyond, angle = _small(window, offsets, numbers, q, turns, reach)
            c, s = _turned(angle)
            vr, vi = _sample(window, table, rows[q], layout.stride, degree, bits, beyond)
            re = fma(vr, c, fma(-vi, s, re))
            im = fma(vr, s, fma(vi, c, im))
        store(sums, at, load(sums, at) + to_float64(re))
        store(sums, at + 16, load(sums, at + 16) + to_float64(im))


@njit(**_STRICT)
def _keep_small(
    window: int, count: int, offsets: Any, numbers: Any, turns_per_bin: Any, layout: Any, kept: Any
) -> None:
    """Work out for a block of pulses what all channels share, offsets in float32."""
    turns, reach = splat(turns_per_bin), splat(np.float32(layout.bins + 2 * MARGIN - 2))
    for q in range(count):
        bits, beyond, angle = _small(window, offsets, numbers, q, turns, reach)
        c, s = _turned(angle)
        at = _KEPT * q
        store(kept, at + _BIN, bits)
        store(kept, at + _BEYOND, beyond)
        store(kept, at + _COS, c)
        store(kept, at + _SIN, s)


@njit(**_STRICT)
def _keep_exact(
    window: int, p0: int, count: int, pixels: Any, track: Any, firsts: Any, signal: Any, layout: Any, kept: Any
) -> None:
    """Work out for a block of pulses what all channels share, ranges in float64; with pattern and motion."""
    x, y, z = load(pixels, 0), load(pixels, 16), load(pixels, 32)
    half = splat(0.5)
    for q in range(count):
        p = p0 + q
        dx, dy, dz = x - splat(track[0, p]), y - splat(track[1, p]), z - splat(track[2, p])
        distance = sqrt(fma(dx, dx, fma(dy, dy, dz * dz)))
        along = fma(dx, splat(signal.axis_x), fma(dy, splat(signal.axis_y), dz * splat(signal.axis_z)))
        cosine = to_float32(along) / to_float32(distance)
        radial = distance
        if signal.moving:
            radial = _closing(dx, dy, dz, track, p) / distance
        if signal.bistatic:
            dx, dy, dz = x - splat(track[3, p]), y - splat(track[4, p]), z - splat(track[5, p])
            back = sqrt(fma(dx, dx, fma(dy, dy, dz * dz)))
            if signal.moving:
                radial = (radial + _closing(dx, dy, dz, track, p) / back) * half
            distance = (distance + back) * half
        seen = distance
        turns = distance * splat(signal.turns_per_m)
        if signal.moving:
            distance = distance - distance * radial * splat(1 / C)
            seen = fma(radial, splat(signal.walk_s) - distance * splat(2 / C), distance)
            turns = fma(
                (seen - distance) * (seen + distance), splat(signal.video), distance * splat(signal.turns_per_m)
            )
        place = (seen - splat(track[9, p])) * splat(signal.bins_per_m) - splat(firsts[q] + 0.5)
        n = rint(place)
        if window == 0:
            n = minimum(maximum(n, splat(-MARGIN - firsts[q])), splat(layout.bins + MARGIN - 2 - firsts[q]))
        c, s = _turned_exactly(to_float32(turns - rint(turns)))
        at = _KEPT * q
        if signal.exponent > 0:
            gain = _power(cosine, np.float32(signal.exponent))
            c, s = c * gain, s * gain
            store(kept, at + _GAIN, gain)
        store(kept, at + _BIN, to_float32(n) + splat(INDEX_BITS))
        store(kept, at + _BEYOND, to_float32(place - n))
        store(kept, at + _COS, c)
        store(kept, at + _SIN, s)


@njit(**_INSIDE)
def _closing(dx: Any, dy: Any, dz: Any, track: Any, p: int) -> Any:
    return -fma(dx, splat(track[6, p]), fma(dy, splat(track[7, p]), dz * splat(track[8, p])))


@njit(**_STRICT)
def _sum_kept(
    window: int, count: int, kept: Any, rows: Any, shift: int, layout: Any, table: Any, sums: Any, at: int
) -> None:
    """Add a block of pulses of one channel to a patch."""
    for first in range(0, count, RUN):
        re = im = splat(np.float32(0))
        for q in range(first, min(first + RUN, count)):
            k = _KEPT * q
            n, beyond = load(kept, k + _BIN), load(kept, k + _BEYOND)
            c, s = load(kept, k + _COS), load(kept, k + _SIN)
            vr, vi = _sample(window, table, rows[q] + shift, layout.stride, layout.degree, n, beyond)
            re = fma(vr, c, fma(-vi, s, re))
            im = fma(vr, s, fma(vi, c, im))
        store(sums, at, load(sums, at) + to_float64(re))
        store(sums, at + 16, load(sums, at + 16) + to_float64(im))


@njit(**_STRICT)
def _sum_gains(count: int, kept: Any, weights: Any, p0: int, gains: Any, at: int) -> None:
    """Add the squared gains of a block of pulses to a patch; weights (pulses,) float32."""
    total = load(gains, at)
    for q in range(count):
        gain = load(kept, _KEPT * q + _GAIN)
        total = fma(gain * splat(weights[p0 + q]), gain, total)
    store(gains, at, total)


@njit(**_STRICT)
def _centre(p0: int, count: int, centre: Any, track: Any, signal: Any, numbers: Any, places: Any) -> Any:
    """A patch's centre as a block of pulses sees it. Returns how far apart its pixels' bins lie (0, 1 or 2: within a
    window of 16, of 32, or neither) and whether offsets in float32 are too coarse (1).

    ``centre`` holds x, y, z, the largest offsets from there along each axis, and the largest in any direction.
    """
    cx, cy, cz, ex, ey, ez, size = centre[0], centre[1], centre[2], centre[3], centre[4], centre[5], centre[6]
    wide, coarse = 0, 0
    for q in range(count):
        p = p0 + q
        dx, dy, dz = cx - track[0, p], cy - track[1, p], cz - track[2, p]
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        inverse = 1.0 / max(distance, 1e-12)
        scale = signal.bins_per_m * inverse
        turns = signal.turns_per_m * distance
        numbers[_X + q] = dx * scale
        numbers[_Y + q] = dy * scale
        numbers[_Z + q] = dz * scale
        numbers[_BEND + q] = 0.5 * scale
        numbers[_SECOND + q] = -0.5 * inverse / signal.bins_per_m
        numbers[_THIRD + q] = 0.5 * inverse * inverse / (signal.bins_per_m * signal.bins_per_m)
        numbers[_PHASE + q] = turns - math.floor(turns + 0.5)
        places[q] = (distance - track[9, p]) * signal.bins_per_m - 0.5
        reach = (abs(dx) * ex + abs(dy) * ey + abs(dz) * ez) * inverse + 0.5 * size * size * inverse
        # Remainder of the series for sqrt(1 + u) after u^3, and four roundings of numbers as large as the reach.
        u = min(2 * reach * inverse, 1.0)
        error = signal.turns_per_m * (0.08 * distance * u * u * u * u + 2.4e-7 * reach)
        coarse = max(coarse, int(error > signal.small_turns or u > 0.5))
        bins = reach * signal.bins_per_m
        wide = max(wide, int(bins > ROOM16) + int(bins > ROOM32 or u > 0.9))
    return wide, coarse


@njit(**_STRICT)
def _centre_general(p0: int, count: int, centre: Any, track: Any, signal: Any, places: Any) -> int:
    """As :func:`_centre` for two antennas or motion, where offsets are never small; only places and how far apart."""
    cx, cy, cz, size = centre[0], centre[1], centre[2], centre[6]
    wide = 0
    for q in range(count):
        p = p0 + q
        distance, radial, nearest = 0.0, 0.0, math.inf
        for antenna in range(0, 6, 3):
            dx, dy, dz = cx - track[antenna, p], cy - track[antenna + 1, p], cz - track[antenna + 2, p]
            r = max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-12)
            distance += 0.5 * r
            nearest = min(nearest, r)
            radial -= 0.5 * (dx * track[6, p] + dy * track[7, p] + dz * track[8, p]) / r
        reach = size
        if signal.moving:
            speed = math.sqrt(track[6, p] ** 2 + track[7, p] ** 2 + track[8, p] ** 2)
            flown = distance - distance * radial / C
            walk = signal.walk_s - 2 * flown / C
            distance = flown + radial * walk
            reach += abs(walk) * speed * size / max(nearest - size, 1e-12)
        places[q] = (distance - track[9, p]) * signal.bins_per_m - 0.5
        wide = max(wide, int(reach * signal.bins_per_m > ROOM16) + int(reach * signal.bins_per_m > ROOM32))
    return wide


@njit(**_STRICT)
def _window(half: int, p0: int, count: int, places: Any, layout: Any, numbers: Any, firsts: Any, rows: Any) -> None:
    """Lay a window of twice ``half`` + 2 bins around every pulse's place, within its table."""
    step = layout.channels * 2 * (layout.degree + 1) * layout.stride
    last = layout.bins + MARGIN - 3.0 - 2 * half
    for q in range(count):
        first = min(max(math.floor(places[q]) - half, -1.0 * MARGIN), last)
        firsts[q] = first
        numbers[_PLACE + q] = places[q] - first
        numbers[_LOWEST + q] = -MARGIN - first
        rows[q] = (p0 + q) * step + MARGIN + int(first)


@njit(**_STRICT)
def _patch(pixel: Any, ground: Any, row: int, column: int, across: int, pixels: Any, offsets: Any, centre: Any) -> bool:
    """Places of a patch's pixels (those beyond the grid repeat its edge); False where none of them exists."""
    x, y, z = pixel
    found = 0
    for k in range(7):
        centre[k] = 0.0
    for lane in range(16):
        i, j = min(row + lane // across, ground.rows - 1), min(column + lane % across, ground.columns - 1)
        px = x[i * ground.x_row + j * ground.x_column]
        py = y[i * ground.y_row + j * ground.y_column]
        pz = z[i * ground.z_row + j * ground.z_column]
        pixels[lane], pixels[16 + lane], pixels[32 + lane] = px, py, pz
        if math.isfinite(px + py + pz):
            found += 1
            centre[0] += px
            centre[1] += py
            centre[2] += pz
    if not found:
        return False
    for k in range(3):
        centre[k] /= found
    for lane in range(16):
        squares = 0.0
        for k in range(3):
            away = pixels[16 * k + lane] - centre[k]
            offsets[16 * k + lane] = away
            squares += away * away
            if abs(away) > centre[3 + k]:
                centre[3 + k] = abs(away)
        offsets[48 + lane] = squares
        if squares > centre[6]:
            centre[6] = squares
    centre[6] = math.sqrt(centre[6])
    return True


@njit(parallel=True, cache=True, nogil=True, error_model="numpy")
def add_pulses(
    table: Any, layout: Any, signal: Any, track: Any, weights: Any, pixel: Any, ground: Any, total: Any, gains: Any
) -> None:
    """Add pulses to some rows of an image.

    Args:
        table: their profiles, weighted (:func:`processing.sar.segments.segment_tables`).
        layout: of the table.
        signal: the radar.
        track: (10, pulses) x, y, z of transmission, of reception, velocity, and range of the first bin.
        weights: (sets, pulses) float32 of the gains; one set for every plane of ``gains``.
        pixel: x, y and z of the rows' pixels, flat.
        ground: how they lie there.
        total: (channels, rows, columns) complex64 that weighted, turned profiles are added to.
        gains: (sets, rows, columns) float32 that weighted squared gains are added to; without a pattern not touched.
    """
    rows_all, columns_all, across = ground.rows, ground.columns, ground.across
    down = 16 // across
    high = min(PATCHES, (rows_all + down - 1) // down)
    broad = PATCHES // high
    tiles_across = (columns_all + across * broad - 1) // (across * broad)
    tiles_down = (rows_all + down * high - 1) // (down * high)
    pulses = track.shape[1]
    channels, sets = layout.channels, weights.shape[0] if signal.exponent > 0 else 0
    general = signal.bistatic or signal.moving
    for tile in prange(tiles_across * tiles_down):
        patches = high * broad
        pixels = np.empty((patches, 48))
        offsets = np.empty((patches, 64), np.float32)
        centres = np.empty((patches, 7))
        exists = np.empty(patches, np.bool_)
        sums = np.zeros(patches * channels * 32)
        gain_sums = np.zeros(patches * max(sets, 1) * 16, np.float32)
        numbers = np.empty(_NUMBERS, np.float32)
        places, firsts = np.empty(PULSES), np.empty(PULSES)
        rows = np.empty(PULSES, np.int64)
        kept = np.empty(_KEPT * PULSES, np.float32)
        for patch in range(patches):
            row = (tile // tiles_across * high + patch // broad) * down
            column = (tile % tiles_across * broad + patch % broad) * across
            exists[patch] = (
                row < rows_all
                and column < columns_all
                and _patch(pixel, ground, row, column, across, pixels[patch], offsets[patch], centres[patch])
            )
        for p0 in range(0, pulses, PULSES):
            count = min(PULSES, pulses - p0)
            for patch in range(patches):
                if not exists[patch]:
                    continue
                coarse = 1
                if general:
                    wide = _centre_general(p0, count, centres[patch], track, signal, places)
                else:
                    wide, coarse = _centre(p0, count, centres[patch], track, signal, numbers, places)
                if not simd.PERMUTES:
                    wide = 2
                _window(7 if wide == 0 else 15, p0, count, places, layout, numbers, firsts, rows)
                turns_per_bin = np.float32(signal.turns_per_m / signal.bins_per_m)
                at = patch * channels * 32
                if coarse == 0 and channels == 1 and signal.exponent == 0:
                    degree = layout.degree
                    if wide == 0 and degree == 1:
                        _sum_small(16, 1, count, offsets[patch], numbers, rows, turns_per_bin, layout, table, sums, at)
                    elif wide == 0:
                        _sum_small(
                            16, degree, count, offsets[patch], numbers, rows, turns_per_bin, layout, table, sums, at
                        )
                    elif wide == 1:
                        _sum_small(
                            32, degree, count, offsets[patch], numbers, rows, turns_per_bin, layout, table, sums, at
                        )
                    else:
                        _sum_small(
                            0, degree, count, offsets[patch], numbers, rows, turns_per_bin, layout, table, sums, at
                        )
                    continue
                if coarse == 0 and signal.exponent == 0:
                    _keep_small(16 if wide < 2 else 0, count, offsets[patch], numbers, turns_per_bin, layout, kept)
                else:
                    window = 16 if wide < 2 else 0
                    _keep_exact(window, p0, count, pixels[patch], track, firsts, signal, layout, kept)
                for channel in range(channels):
                    shift = channel * 2 * (layout.degree + 1) * layout.stride
                    if wide == 0:
                        _sum_kept(16, count, kept, rows, shift, layout, table, sums, at + 32 * channel)
                    elif wide == 1:
                        _sum_kept(32, count, kept, rows, shift, layout, table, sums, at + 32 * channel)
                    else:
                        _sum_kept(0, count, kept, rows, shift, layout, table, sums, at + 32 * channel)
                for k in range(sets):
                    _sum_gains(count, kept, weights[k], p0, gain_sums, (patch * sets + k) * 16)
        for patch in range(patches):
            row = (tile // tiles_across * high + patch // broad) * down
            column = (tile % tiles_across * broad + patch % broad) * across
            for lane in range(16):
                i, j = row + lane // across, column + lane % across
                if i >= rows_all or j >= columns_all:
                    continue
                i += ground.first_row
                for channel in range(channels):
                    at = (patch * channels + channel) * 32 + lane
                    if exists[patch]:
                        total[channel, i, j] += complex(sums[at], sums[at + 16])
                    else:
                        total[channel, i, j] = complex(np.nan, np.nan)
                for k in range(sets):
                    gains[k, i, j] += gain_sums[(patch * sets + k) * 16 + lane]
