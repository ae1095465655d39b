"""Kernels of :func:`processing.optics.mosaic_stokes.mosaic_stokes`: sixteen pixels at a time.

Of a pixel, ``own`` is its own angle, ``beside`` that of its row's other pixels, ``above`` that of its column's, and
``across`` the fourth. Whole counts behind ideal polarizers (or equal, imperfect ones) need sums and differences alone,
which float32 holds exactly (:func:`whole_band`); anything else is weighted in float64 (:func:`weighted_band`).
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from processing.simd import (
    LANES,
    fence,
    fma,
    load,
    maximum,
    splat,
    sqrt,
    store,
    stream,
    to_float32,
    to_float64,
    where_positive,
)

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

_HALF = np.float32(math.pi / 2)
_LOWEST = np.nextafter(-_HALF, np.float32(0))
_NAN = np.float32(np.nan)

# arctan(t) / t over t^2 from 0 to 1, least maximal relative error: 1.0e-7, with float32's rounding 1.5e-7.
_A0, _A1 = np.float32(0.99999990), np.float32(-0.33331992)
_A2, _A3 = np.float32(0.19969733), np.float32(-0.14019516)
_A4, _A5 = np.float32(0.09914363), np.float32(-0.059487122)
_A6, _A7 = np.float32(0.024252764), np.float32(-0.0046933393)

# Squares of what is between these neither vanish nor overflow.
_SMALL, _LARGE = np.float32(2.0**-40), np.float32(2.0**40)
_RAISE, _LOWER = np.float32(2.0**60), np.float32(2.0**-60)


@numba.njit(cache=True, nogil=True)
def whole_band(
    image: NDArray[Any],
    lanes: Singles,
    shares: Singles,
    level: Singles,
    saturation: float,
    first: int,
    end: int,
    streamed: bool,
    out: Singles,
) -> None:
    """Rows ``first`` to ``end`` of whole counts, of 16 columns or more.

    Args:
        image: (rows, columns) uint8 or uint16.
        lanes: (2, 3, 16) by the row's parity: above 0 where the own angle counts for S1, then gains with signs of S1
            and of S2.
        shares: (2, 3) of the sums of the two pixels beside, the two above and below, and the four across: in the
            difference of the own angle (whose share is 1) and its orthogonal one, and in that of the other two.
        level: four times the black level in two parts, the first a multiple of 1/4; then the gain of S0.
        saturation: counts from which a pixel is undefined.
        first, end: rows.
        streamed: write past the caches; needs rows and planes that begin at multiples of 64 bytes.
        out: (5, rows, columns) to fill.
    """
    rows, columns = image.shape
    above, here, below = _first_lines(image, first, saturation)
    own = (shares[0, 0], shares[0, 1], shares[0, 2])
    rest = (shares[1, 0], shares[1, 1], shares[1, 2])
    zero = (level[0], level[1], level[2])
    for row in range(first, end):
        _fill(image[row + 1 if row + 1 < rows else row - 1], saturation, below)
        # Read before the loop: for all the compiler knows, storing results might change them.
        by_parity = lanes[row % 2]
        turn, gain1, gain2 = load(by_parity[0], 0), load(by_parity[1], 0), load(by_parity[2], 0)
        o0, o1, o2, o3, o4 = out[0, row], out[1, row], out[2, row], out[3, row], out[4, row]
        for start in range(0, columns + LANES - 1, LANES):
            # The last sixteen may overlap those before; as columns are even, it begins in an even one.
            k = min(start, columns - LANES)
            s0, s1, s2 = _differences(above, here, below, k, turn, gain1, gain2, own, rest, zero)
            dolp, aop = _polarization(s0, s1, s2)
            if streamed:
                stream(o0, k, s0)
                stream(o1, k, s1)
                stream(o2, k, s2)
                stream(o3, k, dolp)
                stream(o4, k, aop)
            else:
                store(o0, k, s0)
                store(o1, k, s1)
                store(o2, k, s2)
                store(o3, k, dolp)
                store(o4, k, aop)
        above, here, below = here, below, above
    if streamed:
        fence()


@numba.njit(nogil=True)
def _differences(
    above: Singles,
    here: Singles,
    below: Singles,
    k: int,
    turn: Any,
    gain1: Any,
    gain2: Any,
    own: Any,
    rest: Any,
    zero: Any,
) -> Any:
    """S0, S1, S2 of sixteen pixels from column ``k`` on; exact but for the level's second part and the gains."""
    pixel = load(here, k + 1)
    beside = load(here, k) + load(here, k + 2)
    upright = load(above, k + 1) + load(below, k + 1)
    across = (load(above, k) + load(below, k)) + (load(above, k + 2) + load(below, k + 2))
    # Shares of 0 are multiplied too: one saturated pixel makes all of it undefined.
    nothing = pixel * splat(np.float32(0))
    one = fma(across, splat(own[2]), fma(upright, splat(own[1]), fma(beside, splat(own[0]), pixel)))
    other = fma(across, splat(rest[2]), fma(upright, splat(rest[1]), fma(beside, splat(rest[0]), nothing)))
    total = fma(across, splat(np.float32(0.25)), fma(beside + upright, splat(np.float32(0.5)), pixel))
    s0 = ((total - splat(zero[0])) - splat(zero[1])) * splat(zero[2])
    return s0, where_positive(turn, one, other) * gain1, where_positive(turn, other, one) * gain2


@numba.njit(cache=True, nogil=True)
def weighted_band(
    image: NDArray[Any],
    weights: Floats,
    offset: Floats,
    saturation: float,
    first: int,
    end: int,
    out: Singles,
) -> None:
    """Rows ``first`` to ``end``, of 16 columns or more.

    Args:
        image: (rows, columns) uint8, uint16 or float32.
        weights: (2, 3, 4) by the row's parity: of S by its angles at even and odd columns, then by its neighbours'.
        offset: (3,) what the black level adds to each S.
        saturation: counts from which a pixel is undefined.
        first, end: rows.
        out: (5, rows, columns) to fill.
    """
    rows, columns = image.shape
    above, here, below = _first_lines(image, first, saturation)
    alternating = np.empty(LANES, dtype=np.float32)
    for lane in range(LANES):
        alternating[lane] = 1 - 2 * (lane % 2)
    even = load(alternating, 0)
    for row in range(first, end):
        _fill(image[row + 1 if row + 1 < rows else row - 1], saturation, below)
        w = weights[row % 2]
        a = (w[0, 0], w[0, 1], w[0, 2], w[0, 3], -offset[0])
        b = (w[1, 0], w[1, 1], w[1, 2], w[1, 3], -offset[1])
        c = (w[2, 0], w[2, 1], w[2, 2], w[2, 3], -offset[2])
        o0, o1, o2, o3, o4 = out[0, row], out[1, row], out[2, row], out[3, row], out[4, row]
        for start in range(0, columns + LANES - 1, LANES):
            k = min(start, columns - LANES)
            s0, s1, s2 = _weighted(above, here, below, k, even, a, b, c)
            store(o0, k, s0)
            store(o1, k, s1)
            store(o2, k, s2)
            # Ratios stay, and squares neither vanish nor overflow.
            size = maximum(maximum(s1, -s1), maximum(s2, -s2))
            one = splat(np.float32(1))
            scale = where_positive(splat(_SMALL) - size, splat(_RAISE), one)
            scale = where_positive(size - splat(_LARGE), splat(_LOWER), scale)
            dolp, aop = _polarization(s0 * scale, s1 * scale, s2 * scale)
            store(o3, k, dolp)
            store(o4, k, aop)
        above, here, below = here, below, above


@numba.njit(nogil=True)
def _weighted(above: Singles, here: Singles, below: Singles, k: int, even: Any, a: Any, b: Any, c: Any) -> Any:
    """S0, S1, S2 of sixteen pixels from the even column ``k`` on."""
    two, four = splat(np.float32(0.5)), splat(np.float32(0.25))
    pixel = load(here, k + 1)
    beside = (load(here, k) + load(here, k + 2)) * two
    upright = (load(above, k + 1) + load(below, k + 1)) * two
    across = ((load(above, k) + load(above, k + 2)) + (load(below, k) + load(below, k + 2))) * four
    i00 = to_float64(where_positive(even, pixel, beside))
    i01 = to_float64(where_positive(even, beside, pixel))
    i10 = to_float64(where_positive(even, upright, across))
    i11 = to_float64(where_positive(even, across, upright))
    return _mixed(i00, i01, i10, i11, a), _mixed(i00, i01, i10, i11, b), _mixed(i00, i01, i10, i11, c)


@numba.njit(nogil=True)
def _mixed(i00: Any, i01: Any, i10: Any, i11: Any, weights: Any) -> Any:
    total = fma(i00, splat(weights[0]), splat(weights[4]))
    total = fma(i01, splat(weights[1]), total)
    total = fma(i10, splat(weights[2]), total)
    return to_float32(fma(i11, splat(weights[3]), total))


@numba.njit(nogil=True)
def _polarization(s0: Any, s1: Any, s2: Any) -> Any:
    """DOLP and AOP; undefined without light, AOP also where S1 and S2 vanish (0 / 0)."""
    nan = splat(_NAN)
    size = sqrt(fma(s1, s1, s2 * s2))
    # The tangent of half the angle that (|S1|, S2) makes is within -1 and 1: one series and no octants.
    t = s2 / (size + maximum(s1, -s1))
    z = t * t
    series = fma(splat(_A7), z, splat(_A6))
    series = fma(series, z, splat(_A5))
    series = fma(series, z, splat(_A4))
    series = fma(series, z, splat(_A3))
    series = fma(series, z, splat(_A2))
    series = fma(series, z, splat(_A1))
    series = fma(series, z, splat(_A0))
    angle = series * t
    # Where S1 < 0 from the nearer end of (-90, 90] degrees, of which the lower does not belong to it.
    angle = where_positive(s1, angle, where_positive(-s2, splat(_LOWEST), splat(_HALF)) - angle)
    return where_positive(s0, size / s0, nan), where_positive(s0, angle, nan)


@numba.njit(cache=True, nogil=True)
def _first_lines(image: NDArray[Any], first: int, saturation: float) -> tuple[Singles, Singles, Singles]:
    """Three lines of the image with a pixel more at each end, mirrored at the border: the row before ``first``, that
    row, and room for the one after. No line is converted twice."""
    width = image.shape[1] + 2
    above, here, below = np.zeros(width, np.float32), np.zeros(width, np.float32), np.zeros(width, np.float32)
    _fill(image[first - 1 if first > 0 else 1], saturation, above)
    _fill(image[first], saturation, here)
    return above, here, below


@numba.njit(cache=True, nogil=True)
def _fill(counts: NDArray[Any], saturation: float, line: Singles) -> None:
    """A line of the image as float32, saturated pixels undefined, mirrored at both ends."""
    columns = counts.size
    for column in range(columns):
        value = np.float32(counts[column])
        line[column + 1] = _NAN if value >= saturation else value
    line[0] = line[2]
    line[columns + 1] = line[columns - 1]
