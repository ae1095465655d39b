"""Ranges from a block of pulses to a patch of sixteen pixels: where its centre lies, and how its pixels differ.

The range of the patch's centre is float64. Its pixels follow from an expansion in float32 offsets, of the fourth order
along a line of equidistant pixels and of the third order otherwise, where a bound says that this is exact enough, and
each in float64 where it is not.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from processing.sar.phasors import INSIDE, power, turned, turned_exactly
from processing.sar.segments import MARGIN
from processing.simd import (
    INDEX_BITS,
    fma,
    load,
    maximum,
    minimum,
    rint,
    splat,
    sqrt,
    store,
    store_whole,
    to_float32,
    to_float64,
    where_positive,
)

PULSES = 128
"""Pulses in a block, a multiple of 16; its numbers for one patch, and the bins that a tile reads, stay in the core's
caches."""

ROOM16, ROOM32 = 7.25, 15.25
"""Bins from a patch's centre that windows of 16 and 32 bins reach, rounding included."""

C = 299_792_458.0

STRICT: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
"""How functions are compiled that are loops themselves."""

# Rows of a block's float32 numbers for one patch, in bins. On a line of pixels: coefficients of the first to fourth
# power of the place on it. Otherwise: slope of range along x, y, z, its curvature, second and third order of the
# expansion. For both: place in the window and phase, half turns, of the centre; lowest bin of the table from there.
LINE1, LINE2, LINE3, LINE4 = (PULSES * row for row in range(4))
_X, _Y, _Z, _BEND, _SECOND, _THIRD = (PULSES * row for row in range(6))
PLACE, PHASE, LOWEST, NUMBERS = (PULSES * row for row in range(6, 10))

# Rows of what is kept for every pulse and pixel where channels share it: bin, place beyond it, phasor, antennas' gain.
BIN, BEYOND, COS, SIN, GAIN, KEPT = (16 * row for row in range(6))

LANES = (np.arange(16) - 7.5) / 8
"""Place of each pixel of a patch on its line."""
_LANES32 = LANES.astype(np.float32)
_UP = np.arange(16.0)


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


class Table(NamedTuple):
    """How tables are laid out (:func:`processing.sar.segments.segment_tables`)."""

    degree: int
    channels: int
    bins: int
    stride: int


@njit(**INSIDE)
def _inverse(distance: Any) -> Any:
    """1 / distance within 3e-14 of it: float32 division and one step of Newton's, twice as fast as float64's own."""
    rough = to_float64(splat(np.float32(1)) / to_float32(distance))
    return rough * (splat(2.0) - distance * rough)


@njit(**STRICT)
def centre_on_line(
    p: int, step: int, count: int, centre: Any, track: Any, signal: Any, numbers: Any, places: Any, most: Any
) -> Any:
    """The centre of a line of sixteen equidistant pixels as a block of pulses sees it.

    Range along the line is ``R(t) = sqrt(R^2 + 2 b t + E t^2)``, E the square of the line's half, b its product with
    the sight; here are its derivatives at the middle up to the fourth. Returns how far apart its pixels' bins lie (0, 1
    or 2: within a window of 16, of 32, or neither) and whether offsets in float32 are too coarse (1).

    Args:
        p: first pulse.
        step: pulses from one row of the track to the next.
        count: pulses.
        centre: x, y, z and the line's half along each axis.
        track: as for :func:`processing.sar.backprojection_kernel.add_pulses`.
        signal: the radar.
        numbers: (NUMBERS,) float32 that coefficients go to.
        places: (PULSES,) float64 that the centre's bins go to, from the middle of the first segment.
        most: (32,) float64 to work in.
    """
    cx, cy, cz = splat(centre[0]), splat(centre[1]), splat(centre[2])
    ex, ey, ez = splat(centre[3]), splat(centre[4]), splat(centre[5])
    square = centre[3] * centre[3] + centre[4] * centre[4] + centre[5] * centre[5]
    bins = splat(signal.bins_per_m)
    widest, worst = splat(0.0), splat(0.0)
    for q in range(0, count, 16):
        at = p + q
        dx, dy, dz = cx - load(track, at), cy - load(track, at + step), cz - load(track, at + 2 * step)
        distance = maximum(sqrt(fma(dx, dx, fma(dy, dy, dz * dz))), splat(1e-12))
        inverse = _inverse(distance)
        slope = fma(dx, ex, fma(dy, ey, dz * ez)) * inverse
        bend = (splat(square) - slope * slope) * inverse * splat(0.5)
        turns = distance * splat(signal.turns_per_m)
        near = to_float32(inverse)
        slope32, bend32 = to_float32(slope), to_float32(bend * bins)
        tilt = slope32 * near
        third = -bend32 * tilt
        store(numbers, LINE1 + q, to_float32(slope * bins))
        store(numbers, LINE2 + q, bend32)
        store(numbers, LINE3 + q, third)
        fourth = fma(tilt * splat(np.float32(1.25)), tilt, splat(np.float32(-0.25 * square)) * near * near)
        store(numbers, LINE4 + q, bend32 * fourth)
        store(numbers, PHASE + q, to_float32((turns - rint(turns)) * splat(2.0)))
        store(places, q, (distance - load(track, at + 9 * step)) * bins - splat(0.5))
        widest = maximum(widest, fma(inverse, splat(0.5 * square), maximum(slope, -slope)))
        worst = maximum(worst, inverse)
    store(most, 0, widest)
    store(most, 16, worst)
    reach, inverse_m = 0.0, 0.0
    for lane in range(16):
        reach, inverse_m = max(reach, most[lane]), max(inverse_m, most[16 + lane])
    # Remainder of the series from the fifth power on, and six roundings of numbers as large as the reach.
    u = min(math.sqrt(square) * inverse_m, 1.0)
    error = signal.turns_per_m * (0.14 * u * u * u * u * math.sqrt(square) + 3.6e-7 * reach)
    bound = reach * signal.bins_per_m
    return int(bound > ROOM16) + int(bound > ROOM32), int(error > signal.small_turns or u > 0.25)


@njit(**STRICT)
def centre_of_patch(
    p: int, step: int, count: int, centre: Any, track: Any, signal: Any, numbers: Any, places: Any, most: Any
) -> Any:
    """As :func:`centre_on_line` for any sixteen pixels, to the third order.

    ``centre`` holds x, y, z, the largest offsets from there along each axis, and the largest in any direction.
    """
    cx, cy, cz, size = splat(centre[0]), splat(centre[1]), splat(centre[2]), centre[6]
    ex, ey, ez = splat(centre[3]), splat(centre[4]), splat(centre[5])
    bins = splat(signal.bins_per_m)
    widest, worst, closest = splat(0.0), splat(0.0), splat(0.0)
    for q in range(0, count, 16):
        at = p + q
        dx, dy, dz = cx - load(track, at), cy - load(track, at + step), cz - load(track, at + 2 * step)
        distance = maximum(sqrt(fma(dx, dx, fma(dy, dy, dz * dz))), splat(1e-12))
        inverse = _inverse(distance)
        scale = bins * inverse
        turns = distance * splat(signal.turns_per_m)
        store(numbers, _X + q, to_float32(dx * scale))
        store(numbers, _Y + q, to_float32(dy * scale))
        store(numbers, _Z + q, to_float32(dz * scale))
        store(numbers, _BEND + q, to_float32(scale * splat(0.5)))
        second = inverse * splat(-0.5 / signal.bins_per_m)
        store(numbers, _SECOND + q, to_float32(second))
        store(numbers, _THIRD + q, to_float32(second * inverse * splat(-1 / signal.bins_per_m)))
        store(numbers, PHASE + q, to_float32((turns - rint(turns)) * splat(2.0)))
        store(places, q, (distance - load(track, at + 9 * step)) * bins - splat(0.5))
        along = fma(maximum(dx, -dx), ex, fma(maximum(dy, -dy), ey, maximum(dz, -dz) * ez))
        reach = (along + splat(0.5 * size * size)) * inverse
        # Remainder of the series for sqrt(1 + u) after u^3, and four roundings of numbers as large as the reach.
        u = minimum(reach * inverse * splat(2.0), splat(1.0))
        widest = maximum(widest, reach)
        closest = maximum(closest, u)
        worst = maximum(worst, fma(distance * splat(0.08), u * u * (u * u), reach * splat(2.4e-7)))
    store(most, 0, widest)
    store(most, 16, worst)
    reach_m, error = 0.0, 0.0
    for lane in range(16):
        reach_m, error = max(reach_m, most[lane]), max(error, most[16 + lane])
    store(most, 0, closest)
    most_u = 0.0
    for lane in range(16):
        most_u = max(most_u, most[lane])
    bound = reach_m * signal.bins_per_m
    coarse = int(error * signal.turns_per_m > signal.small_turns or most_u > 0.5)
    return int(bound > ROOM16) + int(bound > ROOM32 or most_u > 0.9), coarse


@njit(**STRICT)
def centre_general(
    p0: int, step: int, count: int, centre: Any, size: float, track: Any, signal: Any, places: Any
) -> int:
    """As :func:`centre_of_patch` for two antennas or motion, where offsets are never small: only places, and how far
    apart they lie. ``size``: the largest offset in any direction, m."""
    cx, cy, cz = centre[0], centre[1], centre[2]
    wide = 0
    for q in range(count):
        p = p0 + q
        vx, vy, vz = track[6 * step + p], track[7 * step + p], track[8 * step + p]
        distance, radial, nearest = 0.0, 0.0, math.inf
        for antenna in range(0, 6, 3):
            dx = cx - track[antenna * step + p]
            dy = cy - track[(antenna + 1) * step + p]
            dz = cz - track[(antenna + 2) * step + p]
            r = max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-12)
            distance += 0.5 * r
            nearest = min(nearest, r)
            radial -= 0.5 * (dx * vx + dy * vy + dz * vz) / r
        reach = size
        if signal.moving:
            speed = math.sqrt(vx * vx + vy * vy + vz * vz)
            flown = distance - distance * radial / C
            walk = signal.walk_s - 2 * flown / C
            distance = flown + radial * walk
            reach += abs(walk) * speed * size / max(nearest - size, 1e-12)
        places[q] = (distance - track[9 * step + p]) * signal.bins_per_m - 0.5
        wide = max(wide, int(reach * signal.bins_per_m > ROOM16) + int(reach * signal.bins_per_m > ROOM32))
    return wide


@njit(**STRICT)
def lay_windows(half: int, p: int, count: int, places: Any, layout: Any, numbers: Any, firsts: Any, rows: Any) -> None:
    """Lay a window of twice ``half`` + 2 bins around every pulse's place, within its table."""
    step = float(layout.channels * 2 * (layout.degree + 1) * layout.stride)
    last = splat(layout.bins + MARGIN - 3.0 - 2 * half)
    lowest = splat(-1.0 * MARGIN)
    away = splat(half + 0.5)
    for q in range(0, count, 16):
        place = load(places, q)
        first = minimum(maximum(rint(place - away), lowest), last)
        store(firsts, q, first)
        store(numbers, PLACE + q, to_float32(place - first))
        store(numbers, LOWEST + q, to_float32(lowest - first))
        start = (load(_UP, 0) + splat(float(p + q))) * splat(step)
        store_whole(rows, q, start + first + splat(1.0 * MARGIN))


@njit(**INSIDE)
def offset_on_line(t: Any, t2: Any, t3: Any, t4: Any, numbers: Any, q: int) -> Any:
    """Bins from the centre of a line's pixels, for one pulse."""
    d = fma(t3, splat(numbers[LINE3 + q]), t4 * splat(numbers[LINE4 + q]))
    return fma(t, splat(numbers[LINE1 + q]), fma(t2, splat(numbers[LINE2 + q]), d))


@njit(**INSIDE)
def offset_in_patch(x: Any, y: Any, z: Any, squares: Any, numbers: Any, q: int) -> Any:
    """Bins from the centre of a patch's pixels, for one pulse."""
    m = fma(z, splat(numbers[_Z + q]), squares * splat(numbers[_BEND + q]))
    m = fma(x, splat(numbers[_X + q]), fma(y, splat(numbers[_Y + q]), m))
    return fma(m * m, fma(m, splat(numbers[_THIRD + q]), splat(numbers[_SECOND + q])), m)


@njit(**INSIDE)
def segment_of(window: int, place: Any, lowest: np.float32, reach: Any) -> Any:
    """Segments as lookups take them, and places beyond their middles; ``window`` 0: held within the table."""
    bits = place + splat(INDEX_BITS)
    n = bits - splat(INDEX_BITS)
    if window == 0:
        n = minimum(maximum(n, splat(lowest)), splat(lowest) + reach)
        bits = n + splat(INDEX_BITS)
    return bits, place - n


@njit(**STRICT)
def keep_small(
    window: int, line: bool, count: int, offsets: Any, numbers: Any, turns_per_bin: Any, layout: Any, kept: Any
) -> None:
    """Work out for a block of pulses what all channels share, offsets in float32.

    Args:
        window: 0 where segments are looked up in memory.
        line: whether the pixels lie on a line.
        count: pulses.
        offsets: (64,) float32, powers of the places on a line, or x, y, z and their square sum.
        numbers: of :func:`centre_on_line` or :func:`centre_of_patch`, and of :func:`lay_windows`.
        turns_per_bin: turns of phase per bin.
        layout: of the table.
        kept: (KEPT * pulses,) float32 that results go to.
    """
    halves = splat(np.float32(2) * turns_per_bin)
    reach = splat(np.float32(layout.bins + 2 * MARGIN - 2))
    a, b, c, d = load(offsets, 0), load(offsets, 16), load(offsets, 32), load(offsets, 48)
    for q in range(count):
        offset = offset_on_line(a, b, c, d, numbers, q) if line else offset_in_patch(a, b, c, d, numbers, q)
        bits, beyond = segment_of(window, offset + splat(numbers[PLACE + q]), numbers[LOWEST + q], reach)
        cosine, sine = turned(fma(halves, offset, splat(numbers[PHASE + q])))
        at = KEPT * q
        store(kept, at + BIN, bits)
        store(kept, at + BEYOND, beyond)
        store(kept, at + COS, cosine)
        store(kept, at + SIN, sine)


@njit(**INSIDE)
def seen_exactly(x: Any, y: Any, z: Any, at: int, step: int, track: Any, signal: Any) -> Any:
    """Range at which sixteen pixels appear to one pulse, turns of phase there (both float64), and the cosine (float32)
    of the angle from the antennas' axis; of two antennas the geometric mean, 0 behind either.

    Args:
        x: of the pixels, m.
        y: likewise.
        z: likewise.
        at: the pulse.
        step: pulses from one row of the track to the next.
        track: as for :func:`processing.sar.backprojection_kernel.add_pulses`.
        signal: the radar.
    """
    half = splat(0.5)
    dx, dy, dz = x - splat(track[at]), y - splat(track[step + at]), z - splat(track[2 * step + at])
    distance = sqrt(fma(dx, dx, fma(dy, dy, dz * dz)))
    along = fma(dx, splat(signal.axis_x), fma(dy, splat(signal.axis_y), dz * splat(signal.axis_z)))
    cosine = to_float32(along) / to_float32(distance)
    radial = distance
    if signal.moving:
        radial = _closing(dx, dy, dz, track, step, at) / distance
    if signal.bistatic:
        dx, dy, dz = x - splat(track[3 * step + at]), y - splat(track[4 * step + at]), z - splat(track[5 * step + at])
        back = sqrt(fma(dx, dx, fma(dy, dy, dz * dz)))
        along = fma(dx, splat(signal.axis_x), fma(dy, splat(signal.axis_y), dz * splat(signal.axis_z)))
        received, none = to_float32(along) / to_float32(back), splat(np.float32(0))
        mean = sqrt(maximum(cosine * received, none))
        cosine = where_positive(cosine, where_positive(received, mean, none), none)
        if signal.moving:
            radial = (radial + _closing(dx, dy, dz, track, step, at) / back) * half
        distance = (distance + back) * half
    seen = distance
    turns = distance * splat(signal.turns_per_m)
    if signal.moving:
        distance = distance - distance * radial * splat(1 / C)
        seen = fma(radial, splat(signal.walk_s) - distance * splat(2 / C), distance)
        turns = fma((seen - distance) * (seen + distance), splat(signal.video), distance * splat(signal.turns_per_m))
    return seen, turns, cosine


@njit(**STRICT)
def keep_exact(
    window: int, p: int, step: int, count: int, pixels: Any, track: Any, firsts: Any, signal: Any, layout: Any,
    kept: Any,
) -> None:  # fmt: skip
    """Work out for a block of pulses what all channels share, ranges in float64; with pattern and motion.

    Args:
        window: 0 where segments are looked up in memory.
        p: first pulse.
        step: pulses from one row of the track to the next.
        count: pulses.
        pixels: (48,) x, y and z of the patch's pixels.
        track: as for :func:`processing.sar.backprojection_kernel.add_pulses`.
        firsts: first bin of every pulse's window.
        signal: the radar.
        layout: of the table.
        kept: (KEPT * pulses,) float32 that results go to.
    """
    x, y, z = load(pixels, 0), load(pixels, 16), load(pixels, 32)
    for q in range(count):
        at = p + q
        seen, turns, cosine = seen_exactly(x, y, z, at, step, track, signal)
        place = (seen - splat(track[9 * step + at])) * splat(signal.bins_per_m) - splat(firsts[q] + 0.5)
        n = rint(place)
        if window == 0:
            n = minimum(maximum(n, splat(-MARGIN - firsts[q])), splat(layout.bins + MARGIN - 2 - firsts[q]))
        c, s = turned_exactly(to_float32(turns - rint(turns)))
        k = KEPT * q
        if signal.exponent > 0:
            gain = power(cosine, np.float32(signal.exponent))
            c, s = c * gain, s * gain
            store(kept, k + GAIN, gain)
        store(kept, k + BIN, to_float32(n) + splat(INDEX_BITS))
        store(kept, k + BEYOND, to_float32(place - n))
        store(kept, k + COS, c)
        store(kept, k + SIN, s)


@njit(**INSIDE)
def _closing(dx: Any, dy: Any, dz: Any, track: Any, step: int, p: int) -> Any:
    vx, vy, vz = splat(track[6 * step + p]), splat(track[7 * step + p]), splat(track[8 * step + p])
    return -fma(dx, vx, fma(dy, vy, dz * vz))
